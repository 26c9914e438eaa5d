"""Planning in a process of its own, because OMPL holds the interpreter's lock while it searches.

The owner and the process talk over a socket pair. Its closing is the sign to end, so no process stays
behind, however the owner died. The child is a fresh interpreter that loads nothing but the planner.
"""

from __future__ import annotations

import itertools
import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from queue import SimpleQueue
from threading import Lock, Thread
from typing import NamedTuple

from shapely.geometry import box

from portnav_ros.harbour import Harbour
from portnav_ros.planning.plan_space import PlanError, PlanFailure, PlanSpace, Point, prepare
from portnav_ros.planning.rrt_star import PlanCancelledError, RrtStarParams, plan_in, plan_route
from portnav_ros.types import Array

_CHILD = 'import sys; from portnav_ros.planning.worker import serve; serve(int(sys.argv[1]))'
_GONE = (EOFError, OSError)  # what the other end of a connection leaves behind


class WorkerDiedError(RuntimeError):
    """The planning process died before it answered; another has been started."""


class Setup(NamedTuple):
    """What the process needs to know once."""

    harbour: Harbour
    params: RrtStarParams
    hull_clearance_m: float


class Request(NamedTuple):
    """One plan to make; without ends, the wish to give up the request of this number."""

    number: int
    ends: tuple[Point, Point] | None
    seed: int = 0


class Answer(NamedTuple):
    """A path [W, 2] in m, or why there is none; neither when the request was given up."""

    path: Array | None = None
    reason: PlanFailure | None = None
    detail: str = ''


class PlanTicket(NamedTuple):
    """A plan that was asked for.

    future: raises PlanError, PlanCancelledError or WorkerDiedError; its callbacks run in the worker's
    thread.
    """

    number: int
    future: Future[Array]


class PlanWorker:
    """A planning process and the thread that waits for it. Requests are answered one by one.

    ready: is done when the process has loaded its libraries and the chart. starts: of the process.
    """

    def __init__(self, harbour: Harbour, params: RrtStarParams, hull_clearance_m: float) -> None:
        self.ready: Future[None] = Future()
        self.starts = 0
        self._setup = Setup(harbour, params, hull_clearance_m)
        self._numbers = itertools.count(1)
        self._jobs: SimpleQueue[tuple[Request, Future[Array]] | None] = SimpleQueue()
        self._sending = Lock()
        self._closing = False
        self._start()
        self._thread = Thread(target=self._run, name='plan_worker', daemon=True)
        self._thread.start()

    @property
    def pid(self) -> int:
        """Number of the planning process."""
        return self._process.pid

    def submit(self, start_xy: Point, goal_xy: Point, seed: int) -> PlanTicket:
        """Queue a plan from x, y to x, y in m."""
        request = Request(next(self._numbers), (start_xy, goal_xy), seed)
        future: Future[Array] = Future()
        self._jobs.put((request, future))
        return PlanTicket(request.number, future)

    def cancel(self, ticket: PlanTicket) -> None:
        """Give up a plan, queued or begun; one that is done stays done."""
        if not ticket.future.cancel():
            with suppress(*_GONE):
                self._send(Request(ticket.number, None))

    def close(self) -> None:
        """End the process and the thread; futures that are still open are cancelled."""
        self._closing = True
        self._jobs.put(None)
        self._process.terminate()
        self._thread.join()
        self._process.wait()
        self._connection.close()

    def _start(self) -> None:
        self._connection, theirs = Pipe()
        self._process = subprocess.Popen(
            [sys.executable, '-c', _CHILD, str(theirs.fileno())],
            pass_fds=(theirs.fileno(),),
            stdin=subprocess.PIPE,
            env=os.environ | {'PYTHONPATH': os.pathsep.join(filter(None, sys.path))},
        )
        theirs.close()
        self.starts += 1

    def _send(self, request: Request) -> None:
        with self._sending:
            self._connection.send(request)

    def _hand_over(self) -> None:
        """Give a new process the chart, and wait until it is warm."""
        assert self._process.stdin is not None
        with self._process.stdin as pipe:
            pickle.dump(self._setup, pipe)
        self._connection.recv()

    def _run(self) -> None:
        with suppress(*_GONE):
            self._hand_over()
        self.ready.set_result(None)
        while job := self._jobs.get():
            request, future = job
            if future.set_running_or_notify_cancel():
                self._settle(request, future)

    def _settle(self, request: Request, future: Future[Array]) -> None:
        try:
            self._revive()
            self._send(request)
            answer = self._connection.recv()
        except _GONE:
            future.set_exception(self._bereaved())
            with suppress(*_GONE):
                self._revive()
            return
        if answer.path is not None:
            future.set_result(answer.path)
        elif answer.reason is not None:
            future.set_exception(PlanError(answer.reason, answer.detail))
        else:
            future.set_exception(PlanCancelledError())

    def _revive(self) -> None:
        """Start another process in the place of a dead one."""
        if self._process.poll() is not None and not self._closing:
            self._connection.close()
            self._start()
            self._hand_over()

    def _bereaved(self) -> Exception:
        code = self._process.wait()
        if self._closing:
            return PlanCancelledError()
        return WorkerDiedError(f'the planning process ended with code {code} before it answered')


def serve(descriptor: int) -> None:
    """Body of the planning process: answers requests until the owner is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the owner's business
    with suppress(*_GONE), Connection(descriptor) as connection:
        setup: Setup = pickle.load(sys.stdin.buffer)
        _warm_up()
        space = prepare(setup.harbour, setup.params.resolution_m, setup.hull_clearance_m)
        connection.send(Answer())
        _answer_all(connection, space, setup.params)


def _warm_up() -> None:
    """Load or compile every kernel, so that the first plan does not wait for it."""
    pond = Harbour('pond', box(0.0, 0.0, 1000.0, 1000.0) - box(400.0, -1.0, 600.0, 600.0))
    plan_route(pond, (200.0, 200.0), (800.0, 200.0), RrtStarParams(iterations=500), 10.0, 0)


def _answer_all(connection: Connection, space: PlanSpace, params: RrtStarParams) -> None:
    given_up = 0

    def cancelled() -> bool:
        nonlocal given_up
        while connection.poll():
            given_up = max(given_up, connection.recv().number)
        return given_up >= request.number

    while True:
        request: Request = connection.recv()
        if request.ends is None:
            given_up = max(given_up, request.number)
        else:
            connection.send(_answer(space, params, request, cancelled))


def _answer(
    space: PlanSpace, params: RrtStarParams, request: Request, cancelled: Callable[[], bool]
) -> Answer:
    assert request.ends is not None
    try:
        return Answer(path=plan_in(space, *request.ends, params, request.seed, cancelled))
    except PlanError as error:
        return Answer(reason=error.reason, detail=error.detail)
    except PlanCancelledError:
        return Answer()
