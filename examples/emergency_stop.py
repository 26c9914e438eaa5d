"""A switch at the keyboard: Enter stops the vessel, `go` and Enter lets it sail; the end of this stops it.

It asks safety_monitor for a stop that keeps steerage. No software takes the place of a
switch that cuts the engine.
"""

import signal
import sys

import rclpy
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Bool

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Switch:
    """Says stop or go, latched, so that a safety monitor that starts later hears it, too."""

    def __init__(self, node):
        self.orders = node.create_publisher(Bool, 'emergency_stop', LATCHED)

    def order(self, line):
        """Take a line from the keyboard; anything but `go` is a stop. Returns what was ordered."""
        stop = line.strip() != 'go'
        self.orders.publish(Bool(data=stop))
        return 'STOP' if stop else 'go'


def main():
    """Take orders until Ctrl-C or the end of input."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    switch = Switch(rclpy.create_node('emergency_switch'))
    print('Enter: stop; go and Enter: sail', flush=True)
    try:
        for line in sys.stdin:
            print(switch.order(line), flush=True)
    except KeyboardInterrupt:
        pass
    finally:
        print(switch.order(''))
        switch.orders.wait_for_all_acked(Duration(seconds=2))
        rclpy.try_shutdown()


if __name__ == '__main__':
    main()
