"""What the command `portnav train` hands to an algorithm.

An algorithm is a module with ``Params``, a frozen dataclass that has at least the fields ``scenarios``
(ScenarioParams), ``schedule`` (ScheduleParams) and ``task`` (TaskParams), and ``train(params, job)``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from portnav_ros.params import Ranges, check_ranges


@dataclass(frozen=True)
class Job:
    """One run.

    out: its folder. seed: of everything random. resume: go on from the folder's last checkpoint.
    device: cpu, or cuda with or without an index. threads: of torch. provenance: command, version and
    git commit, for the run's files.
    """

    out: Path
    seed: int = 0
    resume: bool = False
    device: str = 'cpu'
    threads: int = 1
    provenance: Mapping[str, Any] = field(default_factory=dict)
    ranges: ClassVar[Ranges] = {'seed': (0, 2**31), 'threads': (1, 1024)}

    def __post_init__(self) -> None:
        """Refuse a negative seed and no thread at all."""
        check_ranges(self)
