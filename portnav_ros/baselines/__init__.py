"""Local planners without learning, and the ceiling that knows the future."""
