"""What an axis' history says: its trend, and whether an alarm is raised or cleared. Pure numerics."""
