"""The simulated vessel and port: the driver's half of the contract, by the same World that trains."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any, ClassVar

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from nav_msgs.msg import Path
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger

from portnav_ros.nodes.messages import MessageError, nanoseconds, read_joints, read_path, read_stamp
from portnav_ros.nodes.parameters import NodeParams
from portnav_ros.nodes.runtime import Exit, Health, PortNode, run_node
from portnav_ros.nodes.sim_topics import TICK_NS, TICKS_PER_SCAN, SimTopics
from portnav_ros.params import ParamError, Ranges, check_ranges
from portnav_ros.sim.generator import find_scenario
from portnav_ros.sim.world import TICK_S, World
from portnav_ros.types import Actuation, Outcome

NAME = 'sim'
NEUTRAL = Actuation(0.0, 0.0)
FUTURE_NS = nanoseconds(0.1)
RESEND_S = 0.2  # what got no answer is sent again
MIN_TIMER_S = 0.001
RECORDER_LEAD_NS = nanoseconds(20.0)
MAX_CATCH_UP_TICKS = 10  # in one go; what is beyond is lost and lowers the achieved rate


@dataclass(frozen=True)
class SimParams(NodeParams):
    """Parameters of the node.

    difficulty: what a random port is drawn from, a name or a YAML file. scenario: a named scenario in place
    of the random port. chart: a chart file in place of the random port. seed: of what is drawn. lock_step:
    time waits for the command stamped with the present tick. rate: simulated seconds per second, where time
    does not wait. hold_until_plan: the world stands at t = 0 until there is a plan. publish_goal: send the
    scenario's goal to the global planner. publish_targets: tell where the other vessels are. exit_on_end:
    end the process with the episode. neutral_s: age of the command past which the actuators go neutral.
    wait_for_recorder: in lock-step, sail no further than 20 s ahead of what the recorder has, so that its
    queues cannot overflow. answer_timeout_s: patience with the stack in lock-step, by the wall clock; 0 is
    without end. plan_timeout_s: patience with the global planner, by the wall clock; 0 is without end.
    """

    difficulty: str = 'harbour'
    scenario: str = ''
    chart: str = ''
    seed: int = 0
    lock_step: bool = False
    rate: float = 1.0
    hold_until_plan: bool = True
    publish_goal: bool = True
    publish_targets: bool = True
    exit_on_end: bool = False
    neutral_s: float = 1.0
    wait_for_recorder: bool = False
    answer_timeout_s: float = 30.0
    plan_timeout_s: float = 120.0
    ranges: ClassVar[Ranges] = {
        'seed': (0, 2**63 - 1),
        'rate': (0.01, 1000.0),
        'neutral_s': (0.05, 60.0),
        'answer_timeout_s': (0.0, 3600.0),
        'plan_timeout_s': (0.0, 86400.0),
    }

    def __post_init__(self) -> None:
        """Refuse what cannot be run."""
        check_ranges(self)
        if self.scenario and self.chart:
            raise ParamError('scenario and chart exclude each other: a named scenario has its own chart')


DEFAULTS = SimParams()


class Sim(PortNode[SimParams]):
    """Advances a World of one vessel: by the clock, or in lock-step by the commands it gets.

    In lock-step the command stamped t advances the world from t by one tick.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(NAME, DEFAULTS, **options)

    def configure(self) -> None:
        """Make the port and its world, and speak and listen."""
        self.get_logger().info('preparing the port; the first start compiles kernels, up to 30 s')
        params = self.params
        chart = FilePath(params.chart) if params.chart else None
        self.scenario = find_scenario(params.difficulty, params.seed, params.scenario or None, chart)
        self.world = World([self.scenario])
        self.world.tick(np.zeros(1), np.zeros(1))
        self._topics = SimTopics(self, self.scenario, self.world, self.params.publish_targets)
        self._rudder, self._thrust = np.zeros(1), np.zeros(1)
        self._planned = not self.params.hold_until_plan
        self.subscribe('recorded', self._take_recorded)
        self.subscribe('cmd_actuators', self._take_command)
        self.subscribe('plan', self._take_plan, always=True)
        self.create_service(SetBool, '~/enable', self._enable)
        self.create_service(Trigger, '~/reset', self._reset)
        self.create_service(Trigger, '~/step', self._step)
        self.timer(RESEND_S, self._watch)
        if not self.params.lock_step:
            self.timer(max(TICK_S / self.params.rate, MIN_TIMER_S), self._follow_clock)

    def activate(self) -> None:
        """Begin at t = 0."""
        self._enabled = True
        self._driven = not self.params.hold_until_plan
        self._waits_for_recorder = self.lock_step and self.params.wait_for_recorder
        self._recorded_ns = -2 * RECORDER_LEAD_NS
        self._begin()

    @property
    def time_ns(self) -> int:
        """Simulated time."""
        return self._tick * TICK_NS

    @property
    def running(self) -> bool:
        """Whether the episode has not ended."""
        return bool(self.world.outcome[0] == Outcome.RUNNING)

    @property
    def held(self) -> bool:
        """Whether the world still stands at t = 0, waiting for a plan and for who follows it."""
        answered = self._command_ns == 0 if self.lock_step else self._driven
        return self._tick == 0 and not (self._planned and answered)

    def health(self) -> Health:
        """Tell pace and state of the episode."""
        values = {
            'time_s': self._tick * TICK_S,
            'outcome': Outcome(int(self.world.outcome[0])).name,
            'achieved_rate': f'{self._achieved_rate():.2f}',
            'enabled': self._enabled,
        }
        if self.held:
            return Health(DiagnosticStatus.OK, self._waiting_for(), values)
        if self.running and self._command_age_ns() > nanoseconds(self.params.neutral_s):
            return Health(DiagnosticStatus.ERROR, 'cmd_actuators is too old: actuators are neutral', values)
        return Health(values=values)

    def _begin(self) -> None:
        self.world.reset(0, self.scenario)
        self._tick = 0
        self._command, self._command_ns = NEUTRAL, -1
        self._least_clearance = self.world.clearance[0].copy()
        self._progress_s = self._due_s = time.monotonic()
        self._started_s = float('nan')
        self._topics.begin()
        self._topics.publish_episode(0, tuple(self._least_clearance))
        self._topics.publish(0)

    def _take_command(self, message: JointState) -> None:
        command, stamp_ns = read_joints(message), read_stamp(message.header.stamp)
        if stamp_ns > self.time_ns + FUTURE_NS:
            raise MessageError('stamp lies in the future')
        if stamp_ns >= self._command_ns:
            self._command, self._command_ns = command, stamp_ns
            self._advance_if_answered()

    def _take_plan(self, message: Path) -> None:
        if len(read_path(message)):
            self._planned = True
            if self.active:
                self._progress_s = time.monotonic()
                self._advance_if_answered()
        elif self.active and self.held and self.params.exit_on_end:
            self.get_logger().error('there is no route to the goal; the log of global_planner tells why')
            self.finish(Exit.NO_ANSWER)

    def _take_recorded(self, message: Clock) -> None:
        self._recorded_ns = read_stamp(message.clock)
        self._advance_if_answered()

    def _recorder_keeps_up(self) -> bool:
        return not self._waits_for_recorder or self.time_ns - self._recorded_ns <= RECORDER_LEAD_NS

    def _advance_if_answered(self) -> None:
        answered = self._planned and self._command_ns == self.time_ns
        if self.lock_step and answered and self.running and self._recorder_keeps_up():
            self._advance()

    def _advance(self) -> None:
        """Advance by one tick and publish."""
        was_running = self.running
        if self._tick == 0:
            self._started_s = time.monotonic()
        self._rudder[0], self._thrust[0] = self._allowed()
        self.world.tick(self._rudder, self._thrust)
        self._tick += 1
        if self._tick % TICKS_PER_SCAN == 0 or not self.running:
            self.world.sense()
            np.minimum(self._least_clearance, self.world.clearance[0], out=self._least_clearance)
        self._progress_s = time.monotonic()
        self._topics.publish(self._tick)
        if was_running and not self.running:
            self._end()

    def _allowed(self) -> Actuation:
        fresh = self._command_age_ns() <= nanoseconds(self.params.neutral_s)
        return self._command if self._enabled and fresh else NEUTRAL

    def _command_age_ns(self) -> int:
        return self.time_ns - self._command_ns

    def _end(self) -> None:
        outcome = Outcome(int(self.world.outcome[0]))
        self._topics.publish_episode(self._tick, tuple(self._least_clearance))
        self.get_logger().info(
            f'{outcome.name} after {self._tick * TICK_S:.2f} s, {self._achieved_rate():.1f} times real time'
        )
        if self.params.exit_on_end:
            self.finish()

    def _achieved_rate(self) -> float:
        return self._tick * TICK_S / max(self._progress_s - self._started_s, 1e-9) if self._tick else 0.0

    def _follow_clock(self) -> None:
        now_s, period_s = time.monotonic(), TICK_S / self.params.rate
        if self._tick == 0:
            self._due_s = now_s
        if self.held:
            return
        behind = math.floor((now_s - self._due_s) / period_s) + 1
        self._due_s += behind * period_s
        for _ in range(min(behind, MAX_CATCH_UP_TICKS)):
            self._advance()

    def _watch(self) -> None:
        """Send again what got no answer, and give up when patience ends."""
        if self.count_publishers('recorded') == 0 and self._tick:
            self._waits_for_recorder = False  # it has died, and the rest sails on
        if self.held and self.params.publish_goal and self._recorder_keeps_up():
            self._topics.publish_goal()
        self._driven = self._driven or self.count_publishers('setpoint') > 0
        silence_s = time.monotonic() - self._progress_s
        if self.held or (self.lock_step and self.running and silence_s > RESEND_S):
            self._topics.publish(self._tick)
        patience_s = self._patience_s()
        if self.running and patience_s and silence_s > patience_s:
            self.get_logger().error(f'{self._waiting_for()} for {silence_s:.0f} s: giving up')
            self.finish(Exit.NO_ANSWER)

    def _patience_s(self) -> float:
        if self._tick == 0 and not self._planned:
            return self.params.plan_timeout_s
        return self.params.answer_timeout_s if self.lock_step else 0.0

    def _waiting_for(self) -> str:
        if not self._recorder_keeps_up():
            return 'waiting for bag_recorder'
        if not self._planned:
            return 'waiting for a plan'
        if not self.lock_step:
            return 'waiting for a publisher of setpoint'
        return f'waiting for cmd_actuators stamped {self.time_ns} ns'

    def _enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self._enabled = request.data
        response.success = True
        response.message = 'enabled' if request.data else 'disabled: actuators are neutral'
        return response

    def _reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self.active:
            self._begin()
        response.success, response.message = self.active, self._time_or_state()
        return response

    def _step(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = self.active and self.running
        if response.success:
            self._advance()
        response.message = self._time_or_state()
        return response

    def _time_or_state(self) -> str:
        return f'time is {self._tick * TICK_S:.2f} s' if self.active else f'the sim is {self.state}'


def main() -> int:
    """Run the node."""
    return run_node(Sim)


if __name__ == '__main__':
    raise SystemExit(main())
