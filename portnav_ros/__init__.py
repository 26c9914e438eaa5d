"""Autonomous port navigation with ranging sensors: world, planners and ROS 2 nodes."""

__version__ = '0.1.0'
