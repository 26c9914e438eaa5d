"""The device that torch learns on, as ``--device`` names it."""

from __future__ import annotations

import re

import torch

from portnav_ros.training.run_directory import TrainingError

DEVICE = re.compile(r'cpu|cuda(:(?P<index>\d+))?')


def check_device(name: str) -> None:
    """Refuse a device that torch does not have here.

    Args:
        name: cpu, or cuda with or without an index.

    Raises:
        TrainingError: says what to give instead.
    """
    match = DEVICE.fullmatch(name)
    if match is None:
        raise TrainingError(f'--device {name}: expected cpu or cuda; the second of several GPUs is cuda:1')
    if name == 'cpu':
        return
    if not torch.backends.cuda.is_built():  # type: ignore[no-untyped-call]
        raise TrainingError(f'--device {name}: this torch has no CUDA; leave it out or install a CUDA build')
    gpus = torch.cuda.device_count()
    if int(match['index'] or 0) >= gpus:
        raise TrainingError(
            f'--device {name}: GPUs that torch finds here: {gpus}; leave it out, or name one of them'
        )
