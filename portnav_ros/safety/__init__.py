"""What stands between planner and autopilot: ages, plausibility, zones, and the decision to stop. No ROS."""
