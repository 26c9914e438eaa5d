"""What options of several commands have in common: numbers that can be, and a learned planner's model."""

from __future__ import annotations

import argparse
import math

from portnav_ros.evaluation.planners import ALGORITHMS, EvaluationError, ModelOptions


def check_at_least(arguments: argparse.Namespace, **least: float) -> None:
    """Refuse options, by their names in the namespace, below the least that they may be; None is let pass.

    Raises:
        EvaluationError: names the option, its value and the least.
    """
    for name, low in least.items():
        value = getattr(arguments, name)
        if value is not None and not low <= value < math.inf:
            bound = f'at least {low}' if math.isfinite(value) else 'finite'
            raise EvaluationError(f'--{name.replace("_", "-")} {value} must be {bound}')


def model_options(arguments: argparse.Namespace, *planners: str) -> ModelOptions:
    """Options ``--model``, ``--simulations`` and ``--allow-mismatch``, refused where no planner uses them.

    Raises:
        EvaluationError: names the option and the planners that it is for.
    """
    options = ModelOptions(arguments.model, arguments.simulations, arguments.allow_mismatch)
    given = ' and '.join(planners)
    if options != ModelOptions() and not set(planners) & set(ALGORITHMS):
        raise EvaluationError(
            f'--model, --simulations and --allow-mismatch are for {", ".join(ALGORITHMS)}, not for {given}; '
            'leave them out'
        )
    check_at_least(arguments, simulations=0)
    if options.simulations is not None and 'muzero' not in planners:
        raise EvaluationError(f'--simulations is for muzero; leave it out for {given}')
    return options
