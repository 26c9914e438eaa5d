"""Plans the path that the local planner follows: RRT* in a process of its own, on request or for a goal."""

from __future__ import annotations

import itertools
import math
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import numpy as np
import shapely
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Goals, Odometry
from nav_msgs.srv import GetPlan
from rclpy.service import Service

from portnav_ros.charts import read_chart
from portnav_ros.nodes.messages import (
    MessageError,
    occupancy_message,
    path_message,
    read_odometry,
    read_pose,
    read_stamp,
)
from portnav_ros.nodes.parameters import NodeParams
from portnav_ros.nodes.runtime import Health, PortNode, run_node
from portnav_ros.params import ParamError, Ranges, check_ranges
from portnav_ros.planning.plan_space import PlanError, Point
from portnav_ros.planning.rrt_star import PlanCancelledError, RrtStarParams
from portnav_ros.planning.worker import PlanWorker, WorkerDiedError
from portnav_ros.types import Array

NO_PATH = np.zeros((0, 2))
SAME_GOAL_M = 0.5


@dataclass(frozen=True)
class GlobalPlannerParams(NodeParams):
    """Parameters of the node.

    chart: GeoJSON or nav2 map YAML. seed: of the search; the same gives the same path. hull_clearance_m:
    that a path keeps from quays and charted buoys. lock_step: time waits for the nodes. rrt_star.*: the
    search.
    """

    chart: str = ''
    seed: int = 0
    hull_clearance_m: float = 30.0
    lock_step: bool = False
    rrt_star: RrtStarParams = field(default_factory=RrtStarParams)
    ranges: ClassVar[Ranges] = {'seed': (0, 2**63 - 1), 'hull_clearance_m': (0.0, 500.0)}

    def __post_init__(self) -> None:
        """Refuse values without which nothing can be planned."""
        check_ranges(self)


DEFAULTS = GlobalPlannerParams()


class Route(NamedTuple):
    """A path with the goals that it leads through, and how far along it each lies in m."""

    path: Array  # [W, 2]
    goals: tuple[Point, ...]
    at_m: tuple[float, ...]

    def leads_to(self, goal: Point) -> bool:
        """Whether it ends there."""
        return math.dist(self.path[-1], goal) <= SAME_GOAL_M

    def ahead(self, place: Point) -> list[Point]:
        """Goals that a vessel at a place has not passed yet; the last one always counts."""
        passed_m = shapely.LineString(self.path).project(shapely.Point(place))
        stops = zip(self.goals[:-1], self.at_m[:-1], strict=True)
        return [goal for goal, at_m in stops if at_m > passed_m] + [self.goals[-1]]


class Itinerary:
    """The legs of one plan, in the hands of the worker."""

    def __init__(self, worker: PlanWorker, points: Sequence[Point], seed: int, time_ns: int) -> None:
        self.time_ns = time_ns
        self.began_s = time.monotonic()
        self._worker, self._goals = worker, tuple(points[1:])
        self._legs = [worker.submit(a, b, seed) for a, b in itertools.pairwise(points)]

    def when_done(self, callback: Callable[[], object]) -> None:
        """Call back in the worker's thread; legs are planned in order, so the last is the last."""
        self._legs[-1].future.add_done_callback(lambda _: callback())

    def cancel(self) -> None:
        """Give up what is not planned yet."""
        for leg in self._legs:
            self._worker.cancel(leg)

    def route(self) -> Route:
        """Join the legs.

        Raises:
            PlanError, PlanCancelledError, WorkerDiedError: a leg has no path.
        """
        legs = [leg.future.result(0.0) for leg in self._legs]
        path = np.vstack([legs[0], *(leg[1:] for leg in legs[1:])])
        at_m = itertools.accumulate(float(np.hypot(*np.diff(leg, axis=0).T).sum()) for leg in legs)
        return Route(path, self._goals, tuple(at_m))


class GlobalPlanner(PortNode[GlobalPlannerParams]):
    """Node ``global_planner``."""

    def __init__(self, **options: object) -> None:
        super().__init__('global_planner', DEFAULTS, **options)

    def configure(self) -> None:
        """Read the chart, start the planning process, and speak and listen."""
        if not self.params.chart:
            raise ParamError('global_planner: parameter chart is missing: give it as -p chart:=FILE')
        harbour = read_chart(self.params.chart)
        self.worker = PlanWorker(harbour, self.params.rrt_star, self.params.hull_clearance_m)
        self._plan = self.publisher('plan')
        self._map = self.publisher('map')
        self.subscribe('odom', self._on_odometry)
        self.subscribe('goal_pose', self._on_goal)
        self.subscribe('goal_poses', self._on_goals)
        self._service = self.create_service(GetPlan, '~/get_plan', self._on_request)
        self._service.send_response = self._answer_later
        self._chart = occupancy_message(harbour.clearance(self.params.rrt_star.resolution_m, 'charted'), 0)
        self.worker.ready.result()

    def activate(self) -> None:
        """Publish the map; there is no goal yet."""
        self._goals: list[Point] = []
        self._odometry: Odometry | None = None
        self._itinerary: Itinerary | None = None
        self._route: Route | None = None
        self._outcome, self._request = Health(text='no goal yet'), Health(text='none')
        self._map.publish(self._chart)

    def deactivate(self) -> None:
        """Give up what is being planned."""
        if self._itinerary is not None:
            self._itinerary.cancel()

    def cleanup(self) -> None:
        """End the planning process."""
        self.worker.close()

    def health(self) -> Health:
        """Report the outcome of the last plan and request, and how often the process had to be started."""
        values = {
            'process_starts': self.worker.starts,
            'planning': self._itinerary is not None,
            'last_request': self._request.text,
            **{f'request_{key}': value for key, value in self._request.values.items()},
        }
        return self._outcome._replace(values={**self._outcome.values, **values})

    def _on_odometry(self, message: Odometry) -> None:
        self._odometry = message
        if self._goals:
            self._begin(message)

    def _on_goal(self, message: PoseStamped) -> None:
        goal = read_pose(message)[:2]
        self._pursue(self._goals_again(goal) or [goal])

    def _goals_again(self, goal: Point) -> list[Point]:
        """The goals still ahead, where the last route led to this one: it is to be planned anew."""
        if self._route is None or self._odometry is None or not self._route.leads_to(goal):
            return []
        place = self._odometry.pose.pose.position
        return self._route.ahead((place.x, place.y))

    def _on_goals(self, message: Goals) -> None:
        if not message.goals:
            raise MessageError('goals is empty')
        self._pursue([read_pose(goal)[:2] for goal in message.goals])

    def _pursue(self, goals: list[Point]) -> None:
        """Take new goals; the plan for the old ones is given up."""
        if self._itinerary is not None:
            self._itinerary.cancel()
            self._itinerary = None
        self._goals = goals
        self._outcome = Health(DiagnosticStatus.WARN, 'waiting for odometry to plan from')
        if self._odometry is not None:
            self._begin(self._odometry)

    def _begin(self, odometry: Odometry) -> None:
        """Hand the goals to the worker, with the vessel's own place as the start."""
        try:
            own = read_odometry(odometry)
        except MessageError as error:
            self._odometry = None
            self.refuse('odom', str(error))
            return
        points = [(own.x_m, own.y_m), *self._goals]
        self._goals = []
        stamp_ns = read_stamp(odometry.header.stamp)
        itinerary = Itinerary(self.worker, points, self.params.seed, stamp_ns)
        self._itinerary = itinerary
        self._outcome = Health(text='planning')
        itinerary.when_done(lambda: self._soon(self._publish, itinerary))

    def _soon(self, callback: Callable[..., None], *arguments: Any) -> None:
        """Hand over from the worker's thread; a node that is about to go has no executor any more."""
        if (executor := self.executor) is not None:
            executor.create_task(lambda: callback(*arguments) if self.active else None)

    def _publish(self, itinerary: Itinerary) -> None:
        if itinerary is self._itinerary:
            self._itinerary = None
            self._route, self._outcome = self._conclude(itinerary)
            path = NO_PATH if self._route is None else self._route.path
            self._plan.publish(path_message(path, itinerary.time_ns))
            if self._route is None:
                self.report_health()

    def _conclude(self, itinerary: Itinerary) -> tuple[Route | None, Health]:
        """Return the route, if there is one, and what is to be told of it."""
        took_s = time.monotonic() - itinerary.began_s
        try:
            route = itinerary.route()
        except PlanError as error:
            return None, self._failure(error.reason, str(error))
        except WorkerDiedError as error:
            return None, self._failure('PLANNER_DIED', str(error))
        except PlanCancelledError:
            return None, Health(text='cancelled')
        return route, Health(text='planned', values={'points': len(route.path), 'took_s': f'{took_s:.3f}'})

    def _failure(self, reason: str, text: str) -> Health:
        self.get_logger().warning(f'no plan: {text}')
        return Health(DiagnosticStatus.ERROR, text, {'reason': reason})

    def _on_request(self, request: GetPlan.Request, _: GetPlan.Response) -> Itinerary | None:
        if not self.active:
            return None
        try:
            ends = [read_pose(request.start)[:2], read_pose(request.goal)[:2]]
        except MessageError as error:
            self._note_request(self._failure('INVALID_POSE', str(error)))
            return None
        return Itinerary(self.worker, ends, self.params.seed, read_stamp(request.goal.header.stamp))

    def _answer_later(self, itinerary: Itinerary | None, header: Any) -> None:
        """Take the place of rclpy's send_response, which the executor calls as soon as it has asked."""
        if itinerary is None:
            self._answer(NO_PATH, 0, header)
        else:
            itinerary.when_done(lambda: self._soon(self._respond, itinerary, header))

    def _respond(self, itinerary: Itinerary, header: Any) -> None:
        route, outcome = self._conclude(itinerary)
        self._note_request(outcome)
        self._answer(NO_PATH if route is None else route.path, itinerary.time_ns, header)

    def _note_request(self, outcome: Health) -> None:
        """Tell how a request ended, which says nothing of the plan that the vessel follows."""
        self._request = outcome
        self.report_health()

    def _answer(self, path: Array, time_ns: int, header: Any) -> None:
        response = GetPlan.Response(plan=path_message(path, time_ns))
        Service.send_response(self._service, response, header)


def main() -> None:
    """Entry point of the executable."""
    sys.exit(run_node(GlobalPlanner))


if __name__ == '__main__':
    main()
