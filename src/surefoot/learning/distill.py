"""Distillation: one student from several teachers, by DAgger (Ross et al., 2011).

The student acts, and the teacher that fits labels the states that it meets. Teachers receive the observation without
noise. The student receives it with the noise of its sensors, and its own past in addition.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import torch

from surefoot.agents.network import NetworkAgent
from surefoot.checks import check_fields
from surefoot.errors import UserError
from surefoot.learning.budget import MEASURED_S, MEASURED_SHARE, SPEED, SPENT, budget_for
from surefoot.learning.config import TrainConfig
from surefoot.learning.interrupt import deferred_interrupt
from surefoot.learning.kept_policies import KeptPolicies
from surefoot.learning.run_folder import RunFolder
from surefoot.learning.schedule import Progress, Schedule
from surefoot.learning.standing import validate_graded
from surefoot.learning.student import LabelBuffer, MixtureStudent, Student
from surefoot.learning.teachers import Teachers, read_teachers
from surefoot.learning.training_record import training_record
from surefoot.learning.warm_start import Origin, origin_of
from surefoot.rates import CONTROL_HZ
from surefoot.task.environment import PushRecoveryVectorEnv

VALIDATION_S = 300.0
"""Time from one validation to the next, at the mean speed."""
CHECKPOINT_S = 60.0
"""Time from one checkpoint to the next at most."""
_WARM_UP, _FOREVER = 5, 10**12
SHOWN_S = 2.0
"""Time from one report of the progress to the next."""
RECOVERING_S = 1.5
"""Labels within this time of a push's beginning count more [s]."""
FOLLOWED_UNTIL = 0.1
"""Share of the run in which some robots follow their teacher."""


@dataclass(frozen=True)
class DistillConfig:
    """How a student learns: the table `hyper` of a preset for "dagger".

    Attributes:
        teachers: for each teacher its `policy` (a stage of the same run, or a shipped policy) and the cases that it
            labels, see `read_teacher`.
        learning_rate: initial learning rate of Adam.
        batch_size: number of labels in a gradient step.
        gradient_steps: number of gradient steps for each policy step of all robots.
        buffer_size: number of the newest labels that are kept.
        follow_share: share of the robots that follow their teacher at first. It falls to zero.
        either: see `Teachers.labels`.
        recovering_weight: weight of labels within `RECOVERING_S` of a push. Other labels have 1.
        mixture: build the student from its teachers, see `MixtureNetwork`.
    """

    teachers: tuple[Mapping[str, Any], ...]
    learning_rate: float = 1e-3
    batch_size: int = 512
    gradient_steps: float = 4.0
    buffer_size: int = 600_000
    follow_share: float = 0.3
    either: float = 0.0
    recovering_weight: float = 3.0
    mixture: bool = False

    @classmethod
    def from_hyper(cls, values: Mapping[str, Any]) -> DistillConfig:
        """Return what the table `hyper` of a configuration says.

        Raises:
            UserError: it has an unknown key, lacks one, or a value has another type.
        """
        check_fields(cls, values, "hyper")
        try:
            return cls(**values)
        except TypeError as error:
            raise UserError(f"hyper: {error}") from error


class Distiller:
    """One distillation in its run folder.

    Args:
        config: what to learn; the algorithm is "dagger".
        folder: where to keep it; the folders beside it may hold teachers.
        resume: go on from the folder's checkpoint.
        on_progress: called every few seconds.
        start: a student of the same kind that this one begins as.
        num_threads: of the physics; 0 for one per core.

    Attributes:
        progress: where the run is.
        interrupted: a stop was asked for.
        losses: mean squared difference between label and action in the last labels, by teacher.
    """

    def __init__(
        self,
        config: TrainConfig,
        folder: RunFolder,
        resume: bool = False,
        on_progress: Callable[[Progress], None] | None = None,
        start: NetworkAgent | None = None,
        num_threads: int = 0,
    ):
        self.config, self.folder, self.on_progress = config, folder, on_progress
        self.told = told = DistillConfig.from_hyper(config.hyper)
        self.env = PushRecoveryVectorEnv(config.num_envs, config.env, num_threads)
        self.teachers = Teachers(read_teachers(told.teachers, config.env, folder, resume, num_threads), self.env)
        self.losses = np.zeros(len(told.teachers))
        speed = partial(distilling_speed, config, folder, start, num_threads)
        self.schedule = Schedule(config, budget_for(config, folder, speed, VALIDATION_S))
        self.progress, self.interrupted = Progress(), False
        self.rng = np.random.default_rng(config.seed)
        past = config.past_observations, config.past_actions
        torch.manual_seed(config.seed)
        torch.set_num_threads(1)  # sums depend on their number
        policies = [teacher.policy for teacher in self.teachers.teachers]
        student = partial(MixtureStudent, teachers=policies) if told.mixture else Student
        self.student = student(self.env, config.actor, *past, told.learning_rate)
        self.labels = LabelBuffer(told.buffer_size, len(self.student.normalise.mean), self.student.num_targets)
        self.kept = KeptPolicies(partial(validate_graded, num_threads=num_threads))
        self._deviation = np.linspace(*config.noise, config.num_envs)[:, None]
        self._drift = np.zeros((config.num_envs, self.env.robot.num_joints))
        self._clear = np.zeros((config.num_envs, self.student.num_observed))
        self._owed = 0.0
        self.origin = Origin()
        if start:
            self.student.take_policy(start)
            self.origin = origin_of(start)
        if resume:
            self._restore()

    def run(self) -> None:
        """Learn until the budget is used up.

        Raises:
            KeyboardInterrupt: on Ctrl-C, after a checkpoint; a second Ctrl-C does not wait for it.
        """
        if self.progress.share >= 1.0:
            return
        self.schedule.start()
        observations = self.begin()
        with deferred_interrupt(self._stop):
            self._learn(observations)
        if self.interrupted:
            self.checkpoint()
            raise KeyboardInterrupt
        self.keep()

    def begin(self) -> np.ndarray:
        """Start every robot anew; returns their observations with noise (N, num_observations)."""
        observations, _ = self.env.reset(seed=int(self.rng.integers(2**31)))
        self.student.memory.reset(np.arange(self.env.num_envs))
        self._clear = self._observe_clearly()
        self.teachers.begin(self._clear)
        return observations

    def _learn(self, observations: np.ndarray) -> None:
        """Take policy steps until the budget is used up or a stop is asked for; validate and report meanwhile."""
        saved = shown = time.monotonic()
        looked_at = self.progress.steps
        while self.schedule.share < 1.0 and not self.interrupted:
            observations = self.step(observations)
            self.update_progress()
            now = time.monotonic()
            before, looked_at = looked_at, self.progress.steps
            if self.schedule.budget.is_due(before, looked_at):
                self.keep()
                saved = shown = time.monotonic()
            elif now - saved > CHECKPOINT_S:
                self.checkpoint()
                saved = time.monotonic()
            if now - shown > SHOWN_S and self.on_progress:
                shown = now
                self.on_progress(self.progress)

    def _stop(self) -> None:
        self.interrupted = True

    def step(self, observations: np.ndarray) -> np.ndarray:
        """Let all robots take a policy step, and the student learn.

        Args:
            observations: with noise (N, num_observations).

        Returns:
            The next ones.
        """
        inputs = self.student.inputs(observations)
        actions = self._explored(self._labelled(inputs, self.student.act(inputs)))
        self.student.remember(observations, actions)
        observations, _, terminated, truncated, _ = self.env.step(actions)
        self.student.memory.reset(np.flatnonzero(terminated | truncated))
        self._clear = self._observe_clearly()
        self.teachers.update(self._clear, terminated | truncated)
        self._owed += self.told.gradient_steps
        while self._owed >= 1.0:
            self._owed -= 1.0
            self.student.descend(self.labels.draw(self.told.batch_size, self.rng), self.schedule.learning_rate())
        self.progress.steps += len(actions)
        return observations

    def keep(self) -> None:
        """Validate the student, keep it, and write a checkpoint."""
        self.update_progress()
        row = {"minutes": self.progress.seconds / 60.0, "steps": self.progress.steps}
        losses = {f"loss_{i}": float(loss) for i, loss in enumerate(self.losses)}
        record = training_record(self.config, self.progress, self.origin)
        self.progress.validation = self.kept.add(self.student.policy_bytes(record), row, losses)
        self.checkpoint()

    def checkpoint(self) -> None:
        """Write what is needed to go on from here; the labels are gathered anew."""
        self.update_progress()
        state = self.kept.state() | {
            "steps": self.progress.steps + self.origin.num_steps,
            "seconds": self.progress.seconds,
            "generator": self.rng.bit_generator.state,
            "inherited": self.origin.record,
            "teachers": [teacher.borders() for teacher in self.teachers.teachers],
        }
        self.folder.save_checkpoint(self.student.parameters(), state, self.kept.files)

    def update_progress(self) -> None:
        """Bring the progress up to date."""
        self.schedule.update(self.progress.steps)
        seconds = max(self.schedule.seconds, 1e-9)
        self.progress.seconds, self.progress.share = self.schedule.seconds, self.schedule.share
        self.progress.steps_per_s = self.progress.steps / seconds
        self.env.set_progress(self.schedule.position)

    def _labelled(self, inputs: np.ndarray, actions: np.ndarray) -> np.ndarray:
        """Keep what the teachers say; return actions (N, num_joints), some of which are the teachers' at first."""
        clear = self._clear
        labels, levels = self.teachers.labels(clear, actions, self.told.either)
        for i in range(len(self.losses)):
            if (rows := levels == i).any():
                self.losses[i] += 0.01 * (np.square(labels[rows] - actions[rows]).mean() - self.losses[i])
        _, since = self.env.random_pushes.latest(self.env.loop.tick)
        given = np.array([teacher.weight for teacher in self.teachers.teachers])[levels]
        weights = np.where(since < RECOVERING_S * CONTROL_HZ, self.told.recovering_weight * given, 1.0)
        self.labels.add(inputs, self.student.targets(labels, levels, clear), weights)
        share = self.told.follow_share * max(0.0, 1.0 - self.schedule.share / FOLLOWED_UNTIL)
        follows = self.rng.random(len(actions)) < share
        return np.where(follows[:, None], labels, actions)

    def _explored(self, actions: np.ndarray) -> np.ndarray:
        """Return actions with exploration, so that the student is also told how to mend what it does not do itself."""
        kept = self.config.noise_correlation
        fresh = self.rng.standard_normal(self._drift.shape)
        self._drift = kept * self._drift + np.sqrt(1.0 - kept**2) * fresh
        return actions + self._deviation * self._drift

    def _observe_clearly(self) -> np.ndarray:
        """Observations without noise (N, num_observations)."""
        return self.env.loop.observe(slice(None), with_errors=False)

    def _restore(self) -> None:
        parameters, state = self.folder.load_checkpoint()
        self.student.restore(parameters)
        self.kept.restore(state, self.folder.restore_files())
        self.origin = Origin(state["inherited"])
        self.rng.bit_generator.state = state["generator"]
        self.progress.steps = state["steps"] - self.origin.num_steps
        self.schedule.seconds = self.progress.seconds = state["seconds"]
        self.update_progress()


def distilling_speed(
    config: TrainConfig, folder: RunFolder, start: NetworkAgent | None, num_threads: int
) -> dict[str, float]:
    """Distil for some seconds, throw away what was learned, and return the speed of it, as `Budget.of` needs it."""
    began = time.monotonic()
    distiller = Distiller(dataclasses.replace(config, steps=_FOREVER), folder, False, None, start, num_threads)
    observations = distiller.begin()
    for _ in range(_WARM_UP):
        observations = distiller.step(observations)
    mark, steps, passed = time.monotonic(), distiller.progress.steps, 0.0
    while passed < min(MEASURED_S, MEASURED_SHARE * 60.0 * config.minutes):
        observations = distiller.step(observations)
        passed = time.monotonic() - mark
    return {SPEED: (distiller.progress.steps - steps) / passed, SPENT: time.monotonic() - began}
