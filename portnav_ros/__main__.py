"""``python -m portnav_ros`` is the command ``portnav``."""

import sys

from portnav_ros.cli import main

sys.exit(main())
