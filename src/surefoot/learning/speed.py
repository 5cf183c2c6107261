"""Speed: the measurement of a run's policy steps per second at its start, for a budget in minutes."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable

from stable_baselines3.common.callbacks import BaseCallback

from surefoot.learning.budget import MEASURED_S, MEASURED_SHARE, SPEED, SPENT
from surefoot.learning.config import TrainConfig
from surefoot.learning.crew import Crew, join
from surefoot.learning.learner import Learner

_FOREVER = 10**12


def learning_speed(
    config: TrainConfig, begin: Callable[[Learner], object], crew: Crew | None = None
) -> dict[str, float]:
    """Learn for some seconds, throw away what was learned, and return the speed of it [policy steps per second].

    Args:
        config: of the run.
        begin: gives a learner the networks that the run begins with.
        crew: workers that move the robots.
    """
    began = time.monotonic()
    hyper = dict(config.hyper)
    if "buffer_size" in hyper:
        hyper["buffer_size"] = min(hyper["buffer_size"], 100_000)
    learner = Learner(dataclasses.replace(config, hyper=hyper), lambda _: config.hyper["learning_rate"])
    begin(learner)
    if crew:
        join(learner, crew, lambda: (1.0, 0.0))
    clock = _Clock(learner, min(MEASURED_S, MEASURED_SHARE * 60.0 * config.minutes))
    learner.model.learn(_FOREVER, callback=clock, log_interval=_FOREVER, reset_num_timesteps=False)
    learner.venv.close()
    return {SPEED: round(clock.speed, 1), SPENT: round(time.monotonic() - began, 1)}


class _Clock(BaseCallback):
    """Times whole rounds of collecting and updating, from the first update on."""

    def __init__(self, learner: Learner, seconds: float):
        super().__init__()
        self.speed = 0.0
        self._learner = learner
        self._seconds = seconds
        self._begin: tuple[float, int] | None = None

    def _on_rollout_start(self) -> None:
        now, steps = time.monotonic(), self._learner.num_steps
        self._learner.advance(1.0, hold_actor=False)
        if self._begin is None:
            if getattr(self.model, "_n_updates", 0):
                self._begin = now, steps
        elif now - self._begin[0] >= self._seconds:
            self.speed = (steps - self._begin[1]) / (now - self._begin[0])

    def _on_step(self) -> bool:
        return not self.speed
