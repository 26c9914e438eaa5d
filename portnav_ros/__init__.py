"""Autonomous port navigation with ranging sensors: world, planners and ROS 2 nodes."""

import os
from pathlib import Path

from portnav_ros.kernel_cache import keep_kernels

__version__ = '0.1.0'

keep_kernels(Path(__file__).resolve().parent, os.environ)  # before numba reads its environment
