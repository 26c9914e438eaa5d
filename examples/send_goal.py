"""Send the vessel to a point of the map, as RViz's "2D Goal Pose" does: send_goal.py X Y, in m."""

import contextlib
import math
import sys

import rclpy
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from rclpy.executors import ExternalShutdownException
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.task import Future
from rclpy.utilities import remove_ros_args

REPEAT_S = 2.0  # a planner that is not active yet does not hear a goal
PATIENCE_S = 180.0  # the first start of a graph compiles kernels


def send(node, x_m, y_m):
    """Publish a goal until it is answered; returns a future of the number of points of the plan."""
    answer, goal = Future(), PoseStamped()
    goal.header.frame_id = 'map'
    goal.pose.position.x, goal.pose.position.y, goal.pose.orientation.w = x_m, y_m, 1.0
    goals = node.create_publisher(PoseStamped, 'goal_pose', 1)

    def take_plan(plan):
        end = plan.poses[-1].pose.position if plan.poses else None
        if end and math.hypot(end.x - x_m, end.y - y_m) < 1.0 and not answer.done():
            answer.set_result(len(plan.poses))

    def publish():
        if not answer.done():
            goals.publish(goal)

    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_subscription(Path, 'plan', take_plan, latched)
    node.create_timer(REPEAT_S, publish)
    return answer


def main():
    """Say what became of the goal; exit code 1 if there is no plan, 2 if there is no goal."""
    try:
        x_m, y_m = map(float, remove_ros_args(sys.argv)[1:])
    except ValueError:
        print('usage: send_goal.py X Y, two numbers in m', file=sys.stderr)
        return 2
    rclpy.init()
    node = rclpy.create_node('send_goal')
    answer = send(node, x_m, y_m)
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin_until_future_complete(node, answer, timeout_sec=PATIENCE_S)
    rclpy.try_shutdown()
    found = (
        f'a plan of {answer.result()} points' if answer.done() else 'no plan: see the log of global_planner'
    )
    print(found)
    return 0 if answer.done() else 1


if __name__ == '__main__':
    sys.exit(main())
