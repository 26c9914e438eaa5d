"""The command that sails an episode again, from what its recording says of how it was run."""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterator, Mapping
from operator import itemgetter
from typing import Any

from portnav_ros.evaluation.episode_log import EpisodeLog
from portnav_ros.evaluation.planners import WITHOUT_NODE
from portnav_ros.evaluation.trial import SPLITS

OPTIONS, CONFIGURATION = 'options', 'configuration'  # keys of the metadata


def rerun_command(log: EpisodeLog) -> str:
    """Return the command that repeats the episode; empty where none does, as on a vessel's own trip.

    A planner that has no node is sailed by `portnav evaluate`, any other by `portnav demo`.
    """
    options = {'planner': log.planner, 'difficulty': log.difficulty, **_read(log, OPTIONS)}
    if not options['planner'] or not options['difficulty'] or 'sim' in options.get('without', ()):
        return ''
    model = options.get('model')
    if isinstance(model, Mapping):  # an evaluation's
        options |= {**model, 'model': model.get('file')}
    evaluated = options['planner'] in WITHOUT_NODE or bool(options.get('route'))
    parts = ['evaluate', *_of_split(log.seed)] if evaluated else ['demo', '--seed', str(log.seed)]
    parts += _named(options, 'difficulty', 'scenario', 'chart', 'planner', 'model')
    parts += ['--allow-mismatch'] if options.get('allow_mismatch') else []
    if evaluated:
        parts += _named(options, 'route', 'simulations')
    else:
        parts += _pace(options)
        parts += ['--config', 'FILE'] if set(_read(log, CONFIGURATION)) - {'bringup'} else []
    return shlex.join(['portnav', *parts])


def _read(log: EpisodeLog, key: str) -> dict[str, Any]:
    values = json.loads(log.metadata.get(key, '{}'))
    return values if isinstance(values, dict) else {}


def _named(options: Mapping[str, Any], *names: str) -> Iterator[str]:
    for name in names:
        if options.get(name) is not None:
            yield from (f'--{name}', str(options[name]))


def _of_split(seed: int) -> tuple[str, ...]:
    """Arguments that let an evaluation sail the world of a seed."""
    split, base = max((item for item in SPLITS.items() if item[1] <= seed), key=itemgetter(1))
    return '--episodes', '1', '--split', split, '--seed', str(seed - base)


def _pace(options: Mapping[str, Any]) -> tuple[str, ...]:
    if options.get('mode') != 'real_time':
        return ()
    rate = options.get('rate', 1.0)
    return ('--real-time',) if rate == 1.0 else ('--rate', f'{rate:g}')
