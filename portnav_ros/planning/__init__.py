"""Global planning: RRT* paths, clearance-cost routes, smoothing."""
