"""The adapter from topics to a Policy: what all local planners share."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from nav_msgs.msg import Odometry, Path
from sensor_msgs.msg import JointState, LaserScan

from portnav_ros.geometry import spaced_polyline, wrap_angle
from portnav_ros.nodes.inputs import Inputs
from portnav_ros.nodes.messages import (
    SECOND_NS,
    MessageError,
    fill_setpoint,
    nanoseconds,
    new_scan,
    new_setpoint,
    pose_message,
    read_joints,
    read_odometry,
    read_path,
    read_scan,
    read_stamp,
    status_message,
)
from portnav_ros.nodes.planner_params import PlannerParams
from portnav_ros.nodes.runtime import Health, PortNode
from portnav_ros.safety.plausibility import ray_misfit
from portnav_ros.safety.progress import Advance, ProgressWatch
from portnav_ros.sim.scenario import PATH_SPACING_M
from portnav_ros.task.observation import Observer
from portnav_ros.task.path_errors import advance, remaining_m
from portnav_ros.task.policy import Holding, Policy
from portnav_ros.types import RUDDER, STATE_SIZE, THRUST, YAW, Array, Setpoint, X, Y

ODOM, SCAN = 'odom', 'scan'
WATCH_S = 0.1
PASSING = 2.0  # goal radii of path ahead, from which on being near the goal is no arrival
DECISIONS = 1000  # that the latency is told of
EVERYONE = np.ones(1, dtype=bool)


class LocalPlanner(PortNode[PlannerParams]):
    """Answers each decision time with one setpoint, stamped as the odometry that it stands on.

    A decision is due at each multiple of the period and with each new plan. Time is the stamp of the newest
    odometry. What is missing or too old gives a stop setpoint on the present heading, with the reason in
    ``navigation_state``; a stop is repeated like any other setpoint, and the policy begins anew after it.
    """

    def __init__(
        self,
        name: str,
        make_policy: Callable[[Any], Policy],
        defaults: PlannerParams,
        **options: Any,
    ) -> None:
        super().__init__(name, defaults, **options)
        self._make_policy = make_policy
        self.steady_s = time.monotonic

    def configure(self) -> None:
        """Make the policy and compile it, and speak and listen."""
        params = self.params
        self._period_ns, self._age_ns = nanoseconds(params.period_s), nanoseconds(params.age_s)
        clock = None if self.lock_step else lambda: self.steady_s()
        limits_s = {ODOM: params.age_s, SCAN: params.age_s}
        self._inputs = Inputs(limits_s, params.rate, params.release_s, clock)
        self._watched = ProgressWatch(params.stuck_s)
        self._observer = Observer(1, params.lidar, params.observation)
        self.get_logger().info('preparing the planner; the first start compiles kernels, up to a minute')
        self._policy = self._make_policy(params)
        self._warm_up()
        self._path: Array | None = None
        self._arrived = False
        self._advance = Advance.SAIL_ON
        self._message = new_setpoint()
        self._setpoints = self.publisher('setpoint_raw')
        self._states = self.publisher('navigation_state')
        self._goals = self.publisher('goal_pose')
        self.subscribe('plan', self._take_plan, always=True)
        unwanted = self._between_decisions if self.lock_step else None
        self.subscribe(ODOM, self._take_odometry, unwanted)
        self.subscribe(SCAN, self._take_scan, unwanted)
        self.subscribe('joint_states', self._take_joints, unwanted)
        self.timer(WATCH_S, self._watch)

    def activate(self) -> None:
        """Know nothing yet but the plan."""
        self._forget()

    def deactivate(self) -> None:
        """Stop the vessel; in lock-step there is nobody to heed it."""
        if self._time_ns >= 0 and not self.lock_step:
            self._reason = 'the planner was deactivated'
            self._stop()

    def health(self) -> Health:
        """Tell why the vessel is being stopped, and how long a decision takes."""
        values = {
            'odom_ns': self._time_ns,
            'scan_ns': self._scan_ns,
            'stop_reason': self._reason,
            **self._latency(),
        }
        if self._time_ns < 0:
            return Health(DiagnosticStatus.WARN, 'no odom yet', values)
        if self._reason:
            return Health(DiagnosticStatus.WARN, f'stop: {self._reason}', values)
        if self._advance is not Advance.SAIL_ON:
            return Health(DiagnosticStatus.WARN, f'no progress along the plan: {self._advance.value}', values)
        if self._joints_lost:
            return Health(
                DiagnosticStatus.WARN, 'joint_states too old: rudder and thrust are taken as 0', values
            )
        return Health(values=values)

    def explain(self, decision_s: float) -> None:
        """Take note of a decision, once its setpoint is out, and of how long it took."""
        self._decisions_s.append(decision_s)

    def _latency(self) -> dict[str, str]:
        """Median and 99th percentile over the last decisions."""
        if not self._decisions_s:
            return {}
        p50, p99 = np.percentile(self._decisions_s, (50, 99))
        return {'decision_p50_ms': f'{1e3 * p50:.2f}', 'decision_p99_ms': f'{1e3 * p99:.2f}'}

    def _warm_up(self) -> None:
        """Compile what the first decision will need; the first plan makes the policy begin anew."""
        path = np.column_stack([np.arange(0.0, 500.0, PATH_SPACING_M), np.zeros(50)])
        self._observer.reset(EVERYONE, [path])
        self._policy.reset(EVERYONE)
        self.params.mounting.centred(read_scan(new_scan(self.params.lidar, self.params.period_s)))
        ranges = np.full((1, self.params.lidar.rays), np.float32(self.params.lidar.range_max_m))
        self._policy.act(self._observer.update(np.zeros((1, STATE_SIZE)), ranges, np.zeros((1, 2))))
        advance(path, len(path), 0.0, 0.0, 0.0)

    def _forget(self) -> None:
        """Start anew: nothing is known but the plan."""
        self._own = np.zeros((1, STATE_SIZE))
        self._ranges = np.zeros((1, self.params.lidar.rays), np.float32)
        self._setpoint = np.zeros((1, 2))
        self._time_ns = self._scan_ns = self._scan_seen_ns = self._joints_ns = -1
        self._joints_lost = False
        self._due_ns = 0
        self._reason = ''
        self._stop_yaw_rad: float | None = None
        self._decisions_s: deque[float] = deque(maxlen=DECISIONS)
        self._inputs.forget()
        self._begin_path()

    def _begin_path(self) -> None:
        self._advance = Advance.SAIL_ON
        if self._path is not None and len(self._path):
            self._observer.reset(EVERYONE, [self._path])
            self._policy.reset(EVERYONE)
            self._watched.begin(tuple(self._path[-1]), self.params.goal_radius_m)

    def _take_plan(self, message: Path) -> None:
        path = spaced_polyline(read_path(message), PATH_SPACING_M)
        same = self._path is not None and np.array_equal(path, self._path)
        if same and self._advance is not Advance.GIVE_UP:
            return
        self._path, self._arrived = path, False
        if self.active:
            self._begin_path()
            self._due_ns = 0
            self._decide_if_due()

    def _take_odometry(self, message: Odometry) -> None:
        state, time_ns = read_odometry(message), read_stamp(message.header.stamp)
        if self._inputs.note(ODOM, time_ns):
            self._forget()
            self._inputs.note(ODOM, time_ns)
        if time_ns < self._time_ns:
            return  # overtaken on its way
        self._own[0, :RUDDER], self._time_ns = state[:RUDDER], time_ns
        self._decide_if_due()

    def _take_scan(self, message: LaserScan) -> None:
        stamp_ns = read_stamp(message.header.stamp)
        try:
            scan = read_scan(message)
            if misfit := ray_misfit(scan, self._ranges.shape[1]):
                raise MessageError(misfit)
            self._inputs.note(SCAN, stamp_ns)
            self._ranges[0], self._scan_ns = self.params.mounting.centred(scan).ranges, stamp_ns
        finally:
            self._scan_seen_ns = stamp_ns
            self._decide_if_due()

    def _take_joints(self, message: JointState) -> None:
        feedback = read_joints(message)
        self._own[0, RUDDER], self._own[0, THRUST] = feedback
        self._joints_ns = read_stamp(message.header.stamp)
        self._decide_if_due()

    def _between_decisions(self, stamp_ns: int) -> bool:
        """Whether a message cannot matter in lock-step, where each decision has its own."""
        return self._due_ns - self._period_ns < stamp_ns < self._due_ns

    def _decide_if_due(self) -> None:
        if self._time_ns < self._due_ns or not self._complete():
            return
        self._due_ns = self._time_ns - self._time_ns % self._period_ns + self._period_ns
        self._inputs.judge(self._time_ns)
        self._forget_old_joints()
        self._reason = self._find_reason_to_stop()
        if self._reason:
            self._stop()
        else:
            self._sail()

    def _complete(self) -> bool:
        """Whether all that this decision needs has come, or cannot be waited for any longer."""
        if self.lock_step:
            same = self._time_ns == self._scan_seen_ns == self._joints_ns
            return same and self._path is not None
        return self._scan_seen_ns >= self._due_ns or self._time_ns - self._scan_seen_ns > self._age_ns

    def _find_reason_to_stop(self) -> str:
        if self._path is None or not len(self._path):
            return 'no plan'
        if self._inputs.reason:
            return self._inputs.reason
        if self._has_arrived(self._path):
            return 'goal reached'
        gave_up = self._advance is Advance.GIVE_UP and not self.lock_step
        return 'stuck: no progress along the plan' if gave_up else ''

    def _has_arrived(self, path: Array) -> bool:
        """Whether the vessel has come to the end of its path; once there it waits for another plan."""
        x_m, y_m = self._own[0, [X, Y]].tolist()
        if math.dist(path[-1], (x_m, y_m)) <= self.params.goal_radius_m:
            progress = advance(path, len(path), float(self._observer.progress[0]), x_m, y_m)
            left_m = remaining_m(path, progress)  # a path may pass by its own end
            self._arrived = self._arrived or left_m <= PASSING * self.params.goal_radius_m
        return self._arrived

    def _forget_old_joints(self) -> None:
        """Take rudder and thrust as 0, as without feedback, where the last feedback is too old."""
        self._joints_lost = 0 <= self._joints_ns < self._time_ns - self._age_ns
        if self._joints_lost:
            self._own[0, [RUDDER, THRUST]] = 0.0

    def _sail(self) -> None:
        if self._stop_yaw_rad is not None:
            self._policy.reset(EVERYONE)
        started_s = time.perf_counter()
        observation = self._observer.update(self._own, self._ranges, self._setpoint)
        setpoint = self._policy.act(observation)
        if not np.isfinite(setpoint).all():
            self._reason = 'the policy gave a setpoint that is not finite'
            self._stop()
            return
        self._setpoint[:] = setpoint
        decision_s = time.perf_counter() - started_s
        self._stop_yaw_rad = None
        self._publish()
        self._watch_progress()
        if not isinstance(self._policy, Holding) or self._policy.decided.any():
            self.explain(decision_s)

    def _watch_progress(self) -> None:
        """Ask once for another plan to the same goal, where the vessel gets no further; then give up."""
        progress_m = float(self._observer.progress[0]) * PATH_SPACING_M
        advance = self._watched.sail(self._time_ns / SECOND_NS, progress_m)
        if advance is Advance.SAIL_ON:
            return
        self._advance = advance
        self.get_logger().warning(f'no progress for {self.params.stuck_s:.0f} s: {advance.value}')
        if advance is Advance.PLAN_ANEW and not self.lock_step:
            self._goals.publish(pose_message(*self._path[-1], 0.0, self._time_ns))

    def _stop(self) -> None:
        self._watched.rest()
        if self._stop_yaw_rad is None:
            self._stop_yaw_rad = wrap_angle(self._own[0, YAW])
        self._setpoint[0] = self._stop_yaw_rad, 0.0
        self._publish()

    def _publish(self) -> None:
        path, ahead = self._path, (float(self._own[0, X]), float(self._own[0, Y]))
        if path is not None and len(path):
            spacings = round(self.params.observation.lookahead_m / PATH_SPACING_M)
            ahead = path[min(max(int(self._observer.progress[0]), 0) + spacings, len(path) - 1)]
        fill_setpoint(self._message, self._time_ns, Setpoint(*self._setpoint[0].tolist()), ahead)
        self._setpoints.publish(self._message)
        self._publish_state()

    def _publish_state(self) -> None:
        values: dict[str, object] = {'stamp': self._time_ns, 'stop_reason': self._reason}
        if self._path is not None and len(self._path):
            e_x, e_y, e_psi = self._observer.errors[0].tolist()
            values |= {
                'goal': '{:.2f} {:.2f}'.format(*self._path[-1]),
                'progress': f'{max(self._observer.progress[0], 0.0) / (len(self._path) - 1):.4f}',
                'e_x_m': f'{e_x:.3f}',
                'e_y_m': f'{e_y:.3f}',
                'e_psi_rad': f'{e_psi:.4f}',
            }
        level = DiagnosticStatus.WARN if self._reason else DiagnosticStatus.OK
        text = f'stop: {self._reason}' if self._reason else 'sailing'
        self._states.publish(status_message(self.get_name(), level, text, values))

    def _watch(self) -> None:
        """Stop between decisions when a sensor has gone silent; in lock-step time itself waits."""
        if self.lock_step or self._time_ns < 0:
            return
        was_stopped = self._inputs.reason
        if reason := self._inputs.judge(self._time_ns):
            self._reason = reason
            self._stop()
        elif was_stopped:
            self._due_ns = 0
            self._decide_if_due()
