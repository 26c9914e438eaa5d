"""The parameters of the task in one piece; a model's card holds them, and needs no environment for it."""

from __future__ import annotations

from dataclasses import dataclass, field

from portnav_ros.task.actions import ActionParams
from portnav_ros.task.observation import ObservationParams
from portnav_ros.task.reward import RewardParams


@dataclass(frozen=True)
class TaskParams:
    """What the agent sees, does and is paid for."""

    observation: ObservationParams = field(default_factory=ObservationParams)
    actions: ActionParams = field(default_factory=ActionParams)
    reward: RewardParams = field(default_factory=RewardParams)
