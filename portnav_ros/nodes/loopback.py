"""One message from one DDS participant to another: what ``portnav doctor`` runs as a process of its own."""

from __future__ import annotations

import json
import os
import sys
import time

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from std_msgs.msg import String

TIMEOUT_S = 10.0


def main() -> int:
    """Print JSON with the middleware's name and the time until the participants spoke."""
    sender, receiver = Context(), Context()
    try:
        sender.init()
        receiver.init()
        elapsed_s = _exchange(sender, receiver)
    finally:
        sender.try_shutdown()
        receiver.try_shutdown()
    if elapsed_s is None:
        print(f'no message came through within {TIMEOUT_S:.0f} s', file=sys.stderr)
        return 1
    print(json.dumps({'rmw': rclpy.get_rmw_implementation_identifier(), 'elapsed_s': elapsed_s}))
    return 0


def _exchange(sender: Context, receiver: Context) -> float | None:
    received: list[str] = []
    topic = f'portnav_doctor_{os.getpid()}'
    publisher = rclpy.create_node('doctor_sender', context=sender).create_publisher(String, topic, 1)
    listener = rclpy.create_node('doctor_receiver', context=receiver)
    listener.create_subscription(String, topic, lambda message: received.append(message.data), 1)
    executor = SingleThreadedExecutor(context=receiver)
    executor.add_node(listener)
    start_s = time.monotonic()
    while not received and time.monotonic() < start_s + TIMEOUT_S:
        publisher.publish(String(data='ping'))
        executor.spin_once(timeout_sec=0.05)
    return time.monotonic() - start_s if received else None


if __name__ == '__main__':
    sys.exit(main())
