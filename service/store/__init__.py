"""Axes, runs, steps, values, alarms and model revisions in SQLite; the only place with rows."""
