"""Runs a trial in several processes that share one queue of seeds."""

from __future__ import annotations

import multiprocessing
import signal
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from multiprocessing.sharedctypes import Synchronized

from portnav_ros.evaluation.episodes import sail
from portnav_ros.evaluation.planners import EvaluationError
from portnav_ros.evaluation.trial import EpisodeResult, Trial, judge

_SPAWN = multiprocessing.get_context('spawn')
Reply = EpisodeResult | str


def run_trial(
    trial: Trial, seeds: Sequence[int], batch: int, workers: int, keep_logs: bool = False
) -> Iterator[EpisodeResult]:
    """Yield a result for each seed as episodes end; which, but not what, depends on batch and workers.

    Args:
        trial: planner and source of scenarios.
        seeds: world seeds.
        batch: episodes at once in each process.
        workers: processes; 1 stays in this one.
        keep_logs: attach each episode's log.

    Raises:
        EvaluationError: no worker was asked for, or one failed; the message holds the reason.
    """
    if workers < 1:
        raise EvaluationError(f'workers = {workers} must be at least 1')
    workers = min(workers, len(seeds))
    batch = min(batch, -(-len(seeds) // workers))
    if workers == 1:
        for log in sail(trial.make_planner, trial.scenarios(iter(seeds)), batch):
            yield judge(log, trial, keep_logs)
        return
    counter: Synchronized[int] = _SPAWN.Value('q', 0)
    pipes: dict[Connection, SpawnProcess] = {}
    try:
        for _ in range(workers):
            receiver, sender = _SPAWN.Pipe(duplex=False)
            job = (sender, counter, trial, seeds, batch, keep_logs)
            pipes[receiver] = process = _SPAWN.Process(target=_work, args=job, daemon=True)
            with _interrupts_ignored():
                process.start()
            sender.close()
        yield from _collect(dict(pipes))
    finally:
        for process in pipes.values():
            process.terminate()
            process.join()


def _collect(pipes: dict[Connection, SpawnProcess]) -> Iterator[EpisodeResult]:
    while pipes:
        for pipe in wait(list(pipes)):
            assert isinstance(pipe, Connection)
            try:
                reply: Reply = pipe.recv()
            except EOFError:
                process = pipes.pop(pipe)
                process.join()
                if process.exitcode:
                    raise EvaluationError(f'a worker died with exit code {process.exitcode}') from None
                continue
            if isinstance(reply, str):
                raise EvaluationError(reply)
            yield reply


def _work(
    pipe: Connection,
    counter: Synchronized[int],
    trial: Trial,
    seeds: Sequence[int],
    batch: int,
    keep_logs: bool,
) -> None:
    try:
        for log in sail(trial.make_planner, trial.scenarios(_take(counter, seeds)), batch):
            pipe.send(judge(log, trial, keep_logs))
    except BrokenPipeError:
        return
    except Exception as error:
        ours = type(error).__module__.startswith('portnav_ros.')
        pipe.send(str(error) if ours else f'a worker failed\n{traceback.format_exc()}')


def _take(counter: Synchronized[int], seeds: Sequence[int]) -> Iterator[int]:
    while True:
        with counter.get_lock():
            index = counter.value
            counter.value += 1
        if index >= len(seeds):
            return
        yield seeds[index]


@contextmanager
def _interrupts_ignored() -> Iterator[None]:
    """Let a child inherit deafness to Ctrl-C: its parent ends it."""
    previous = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, previous)
