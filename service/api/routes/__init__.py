"""The routes, one module per resource; each has one function that builds its router."""
