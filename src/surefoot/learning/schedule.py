"""Schedule: the share of the budget that a run has used, and the values that change with it, by policy steps alone."""

from __future__ import annotations

import time
from dataclasses import dataclass

from surefoot.learning.budget import Budget
from surefoot.learning.config import TrainConfig
from surefoot.learning.validation import Validation


@dataclass
class Progress:
    """Where a run is, for whoever shows it.

    Attributes:
        share: of the budget used, 0 to 1.
        seconds: since the run began, earlier sittings included.
        steps: policy steps.
        steps_per_s: in the last seconds.
        episode_length: mean of the last episodes, in policy steps.
        validation: the last one.
    """

    share: float = 0.0
    seconds: float = 0.0
    steps: int = 0
    steps_per_s: float = 0.0
    episode_length: float = 0.0
    validation: Validation | None = None


class Schedule:
    """Where a run is.

    Args:
        config: it tells what is left at the end of the learning rate and of the exploration.
        budget: of the run.

    Attributes:
        seconds: since the run began, earlier sittings included; for records, nothing depends on it.
        share: of the budget used, 0 to 1.
    """

    def __init__(self, config: TrainConfig, budget: Budget):
        self.config = config
        self.budget = budget
        self.seconds = 0.0
        self.share = 0.0
        self._began: float | None = None

    def start(self) -> None:
        """Let the clock run."""
        self._began = time.monotonic() - self.seconds

    def update(self, num_steps: int) -> None:
        """Bring seconds and share up to date after `num_steps` policy steps of this run."""
        if self._began is not None:
            self.seconds = time.monotonic() - self._began
        self.share = self.budget.share(num_steps)

    @property
    def position(self) -> float:
        """Where everything is that changes in the course of the run, 0 to 1."""
        config = self.config
        return self.share * min(1.0, config.minutes / max(config.schedule_minutes, 1e-9))

    @property
    def exploration_share(self) -> float:
        """Share of the exploration that is left now."""
        return self._faded(self.config.final_noise)

    def learning_rate(self, _: float = 1.0) -> float:
        """The learning rate now; stable-baselines3 calls it with its own idea of what remains."""
        return float(self.config.hyper["learning_rate"] * self._faded(self.config.final_learning_rate))

    def _faded(self, final: float) -> float:
        """The present share of a quantity of which the share `final` is left at the end."""
        return 1.0 - (1.0 - final) * self.position
