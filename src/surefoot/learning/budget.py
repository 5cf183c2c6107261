"""Budget: the conversion of minutes into policy steps at the start of a run, after which nothing depends on the clock.

The speed of learning is measured for some seconds with networks that are thrown away, and stored in the run folder.
From then on everything that changes in the course of the run follows its policy steps.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

from surefoot.checks import check_number
from surefoot.learning.config import TrainConfig
from surefoot.learning.run_folder import RunFolder

MEASURED_S, MEASURED_SHARE = 10.0, 0.05
"""The measurement lasts so long [s], or this share of the minutes if that is shorter, and at least one update."""
LASTING_SHARE = 0.85
"""Share of the speed at its start that a run has in the mean, validations included: about the median, 0.84, of the nine
curves in results/curves, whose speed over all was 0.78 to 0.98 of that until their first row."""
VALIDATION_S, MAX_VALIDATIONS = 30.0, 40
"""Time from one validation to the next, at the mean speed; a long run has so many of them at most."""
MIN_VALIDATION_STEPS = 10_000
"""Policy steps from one validation to the next at least."""
SPEED, SPENT = "policy_steps_per_s", "measuring_s"
"""Keys of what is stored of a measurement."""


@dataclasses.dataclass(frozen=True)
class Budget:
    """How many policy steps a run has.

    Attributes:
        steps: policy steps of the whole run.
        validation_steps: from one validation to the next.
    """

    steps: int
    validation_steps: int

    @classmethod
    def of(cls, config: TrainConfig, measured: Mapping[str, Any], validation_s: float = VALIDATION_S) -> Budget:
        """Return the budget of a configuration.

        Args:
            config: with the steps, or with the minutes.
            measured: the speed at the start, and how long it took to measure it; not needed for a configuration with
                steps.
            validation_s: time from one validation to the next, at the mean speed.

        Raises:
            UserError: the measurement is not one.
        """
        seconds = 60.0 * config.minutes
        steps = config.steps
        if steps is None:
            speed = check_number(SPEED, measured.get(SPEED), 0.0, 1e9, above=True)
            spent = check_number(SPENT, measured.get(SPENT), 0.0, 1e9)
            steps = max(1, round(LASTING_SHARE * speed * max(seconds - spent, MEASURED_SHARE * seconds)))
        return cls(steps, max(MIN_VALIDATION_STEPS, round(steps * max(validation_s / seconds, 1.0 / MAX_VALIDATIONS))))

    def share(self, num_steps: int) -> float:
        """Share of the budget that is used after `num_steps` policy steps, 0 to 1."""
        return min(1.0, num_steps / self.steps)

    def is_due(self, before: int, now: int) -> bool:
        """Is a validation due at policy step `now`, if the last look was at step `before`?"""
        return now // self.validation_steps > before // self.validation_steps


def budget_for(
    config: TrainConfig,
    folder: RunFolder,
    measure: Callable[[], dict[str, float]] | None = None,
    validation_s: float = VALIDATION_S,
) -> Budget:
    """Return the budget of a run, whose speed is measured unless its folder knows it.

    Args:
        config: of the run.
        folder: of the run.
        measure: learns for a while and returns what `Budget.of` needs; not called for a run with a checkpoint.
        validation_s: time from one validation to the next, at the mean speed.
    """
    measured = folder.beginning() if config.steps is None else {}
    if config.steps is None and SPEED not in measured:
        if folder.has_checkpoint:  # of version 0.1, which kept no speed
            measured = {SPEED: folder.num_steps() / max(folder.seconds(), 1.0) / LASTING_SHARE, SPENT: 0.0}
        elif measure:
            measured = measure()
        folder.note(**measured)
    return Budget.of(config, measured, validation_s)
