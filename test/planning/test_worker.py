import os
import select
import signal
import subprocess
import sys
from collections.abc import Iterator

import numpy as np
import pytest
from shapely.geometry import box

from portnav_ros.harbour import Harbour
from portnav_ros.planning.plan_space import PlanError
from portnav_ros.planning.rrt_star import PlanCancelledError, RrtStarParams, plan_route
from portnav_ros.planning.worker import PlanWorker, WorkerDiedError

PARAMS = RrtStarParams(iterations=1000)
ENDLESS = RrtStarParams(iterations=100_000_000, iterations_max=100_000_000, time_limit_s=600.0)
START, GOAL = (100.0, 900.0), (1900.0, 900.0)
WAIT_S = 60.0


def basin() -> Harbour:
    return Harbour('basin', box(0, 0, 2000, 1000) - box(900, 300, 1100, 1001))


@pytest.fixture(scope='module')
def shared() -> Iterator[PlanWorker]:
    worker = PlanWorker(basin(), PARAMS, 20.0)
    yield worker
    worker.close()


@pytest.fixture
def endless() -> Iterator[PlanWorker]:
    worker = PlanWorker(basin(), ENDLESS, 20.0)
    yield worker
    worker.close()


def test_a_plan_equals_the_one_made_here(shared: PlanWorker) -> None:
    path = shared.submit(START, GOAL, 5).future.result(WAIT_S)
    np.testing.assert_array_equal(path, plan_route(basin(), START, GOAL, PARAMS, 20.0, 5))


def test_a_failure_keeps_its_reason_and_the_process(shared: PlanWorker) -> None:
    with pytest.raises(PlanError, match='on land') as caught:
        shared.submit(START, (1000.0, 900.0), 0).future.result(WAIT_S)
    assert caught.value.reason == 'GOAL_OCCUPIED'
    assert len(shared.submit(START, GOAL, 0).future.result(WAIT_S)) > 100
    assert shared.starts == 1


def test_requests_are_answered_in_order(shared: PlanWorker) -> None:
    tickets = [shared.submit(START, GOAL, seed) for seed in range(4)]
    paths = [ticket.future.result(WAIT_S) for ticket in tickets]
    for seed, path in enumerate(paths):
        np.testing.assert_array_equal(path, shared.submit(START, GOAL, seed).future.result(WAIT_S))


def test_a_new_request_pre_empts_one_that_is_under_way(endless: PlanWorker) -> None:
    first, second = endless.submit(START, GOAL, 0), endless.submit(START, GOAL, 1)
    third = endless.submit(START, (1000.0, 900.0), 2)
    endless.cancel(second)
    endless.cancel(first)
    with pytest.raises(PlanError):
        third.future.result(WAIT_S)
    assert second.future.cancelled()
    assert first.future.cancelled() or isinstance(first.future.exception(), PlanCancelledError)
    assert endless.starts == 1


def test_a_killed_process_is_reported_and_replaced(endless: PlanWorker) -> None:
    endless.ready.result(WAIT_S)
    lost = endless.submit(START, GOAL, 0)
    os.kill(endless.pid, signal.SIGKILL)
    with pytest.raises(WorkerDiedError, match='-9'):
        lost.future.result(WAIT_S)
    with pytest.raises(PlanError):
        endless.submit(START, (1000.0, 900.0), 0).future.result(WAIT_S)
    assert endless.starts == 2


def test_closing_ends_the_process_and_what_it_was_at() -> None:
    worker = PlanWorker(basin(), ENDLESS, 20.0)
    worker.ready.result(WAIT_S)
    tickets = [worker.submit(START, GOAL, seed) for seed in range(2)]
    worker.close()
    for ticket in tickets:
        assert ticket.future.cancelled() or isinstance(ticket.future.exception(), PlanCancelledError)
    with pytest.raises(ProcessLookupError):
        os.kill(worker.pid, 0)


def test_no_process_outlives_a_killed_owner() -> None:
    script = (
        'import sys, time\n'
        'from shapely.geometry import box\n'
        'from portnav_ros.harbour import Harbour\n'
        'from portnav_ros.planning.rrt_star import RrtStarParams\n'
        'from portnav_ros.planning.worker import PlanWorker\n'
        'worker = PlanWorker(Harbour("h", box(0, 0, 2000, 1000)),'
        ' RrtStarParams(iterations=10**8, time_limit_s=600.0), 20.0)\n'
        'worker.ready.result()\n'
        'worker.submit((100.0, 100.0), (1900.0, 900.0), 0)\n'
        'print(worker.pid, flush=True)\n'
        'time.sleep(600.0)\n'
    )
    owner = subprocess.Popen([sys.executable, '-c', script], stdout=subprocess.PIPE, text=True)
    assert owner.stdout is not None
    planner = os.pidfd_open(int(owner.stdout.readline()))
    owner.kill()
    owner.wait()
    ended, _, _ = select.select([planner], [], [], WAIT_S)  # readable once the process has ended
    assert ended
    os.close(planner)
    owner.stdout.close()
