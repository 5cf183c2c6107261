"""Oracle: the hardest pushes that a robot can reject if it knows them, by sampling-based trajectory optimisation.

The cross-entropy method (R. Y. Rubinstein 1999) searches offsets to an agent's joint targets, in a batch of robots with
all limits in force. The offsets are given at knots and linear between them. All samples of an iteration are the same
trial, and each iteration has another seed, so that a motion must work from different start angles and ticks of a push.
A push that the oracle rejects is possible to reject. One that it does not may still be possible.
"""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from surefoot.evaluation.outcome import Outcome
from surefoot.evaluation.scenarios import Line
from surefoot.evaluation.trials import SETTLE_S, Trial, TrialSource, run_trials
from surefoot.rates import POLICY_HZ
from surefoot.task.agent import Agent, Command

NUM_SAMPLES = 128
NUM_ELITES = 16
NUM_KNOTS = 8
MOTION_S = 1.3
"""Time from the push's beginning in which the offsets act [s]."""
FIRST_DEVIATION = 0.1
"""Standard deviation of the offsets at the beginning of a search [rad]. With 0.25 rad nearly every sample falls."""
LEAST_DEVIATION = 0.01
SMOOTHING = 0.3
"""Share of the last iteration's mean and deviation in the next one's."""
MAX_ITERATIONS = 30
ENOUGH = 0.9
"""A search ends when so large a share of the samples succeeds."""
NUM_CHECKS = 16
MIN_SHARE = 0.5
"""A size is possible if the motion that was found succeeds in this share of `NUM_CHECKS` full-length trials."""
HORIZON = 4.0
"""Of the trials of the search, from the push on [s]."""
FIRST_SEED, CHECK_SEED = 8_000_000, 9_000_000
"""Far from the seeds of evaluation and validation."""


@dataclass(frozen=True)
class Possible:
    """The oracle's result along a line.

    Attributes:
        line: along which the push grows.
        size: the largest one that is possible, in the scenario's unit; 0 if none was found.
        succeeded: trials out of `NUM_CHECKS` in which the motion for it succeeded.
        knots: that motion: offsets to the joint targets (NUM_KNOTS, num_joints) [rad].
    """

    line: Line
    size: float
    succeeded: int
    knots: np.ndarray


class PlannedAgent:
    """An agent whose joint targets are moved by a plan of each robot, counted from the push on.

    Args:
        agent: at the policy's rate.
        plans: offsets (num_robots, num_steps, num_joints) [rad] to the joint targets.
    """

    def __init__(self, agent: Agent, plans: np.ndarray):
        self._agent = agent
        self._plans = plans
        self._steps_to_push = round(SETTLE_S * POLICY_HZ)
        self._step = np.zeros(len(plans), np.int64)
        self.failures: Counter[str] = Counter()

    def __getattr__(self, name: str) -> Any:
        """Everything else is the agent's."""
        return getattr(self._agent, name)

    def reset(self, ids: np.ndarray) -> None:
        """Forget robots `ids` (n,), whose plans begin with the push, after the time to settle."""
        self._agent.reset(ids)
        self._step[ids] = -self._steps_to_push

    def __call__(self, inputs: Any, ids: np.ndarray) -> Command:
        """Answer the agent's joint targets, moved by the plans of robots `ids` (n,)."""
        command = self._agent(inputs, ids)
        step, last = self._step[ids], self._plans.shape[1] - 1
        offset = self._plans[ids, np.clip(step, 0, last)] * ((step >= 0) & (step <= last))[:, None]
        self._step[ids] += 1
        return command._replace(joint_target=command.joint_target + offset)


def largest_possible(
    agent: Agent,
    line: Line,
    first: int,
    on_progress: Callable[[float, int, float], None] | None = None,
    num_threads: int = 0,
) -> Possible:
    """Go up the grid from a cell, each search beginning with the last motion, until a size is not possible.

    Args:
        agent: agent whose joint targets are varied.
        line: along which the push grows.
        first: cell of the first search; if it is not possible, smaller ones are tried.
        on_progress: told the size, the iteration and the share of the samples that succeeded.
        num_threads: of the physics; 0 for all cores.
    """
    found = Possible(line, 0.0, 0, np.zeros((NUM_KNOTS, agent.robot.num_joints)))
    rng = np.random.default_rng(FIRST_SEED)
    cell, upwards = first, True
    while 0 < cell <= line.num_cells:
        knots = found.knots
        for iteration, (mean, share) in enumerate(_search(agent, line, cell, found.knots, rng, num_threads)):
            knots = mean
            if on_progress:
                on_progress(line.size(cell), iteration, share)
        succeeded = _num_succeeded(agent, line, cell, knots, num_threads)
        if succeeded >= MIN_SHARE * NUM_CHECKS:
            found = Possible(line, line.size(cell), succeeded, knots)
        elif found.size:
            break
        else:
            upwards = False
        if found.size and not upwards:
            break
        cell += 1 if upwards else -1
    return found


def _num_succeeded(agent: Agent, line: Line, cell: int, knots: np.ndarray, num_threads: int) -> int:
    """In how many of `NUM_CHECKS` full-length trials of a cell a motion succeeds."""
    trials = [line.trial(cell, CHECK_SEED + i, full_length=True) for i in range(NUM_CHECKS)]
    outcomes = _run(agent, np.repeat(knots[None], NUM_CHECKS, axis=0), trials, num_threads)
    return sum(map(line.succeeded, outcomes))


def _search(
    agent: Agent, line: Line, cell: int, mean: np.ndarray, rng: np.random.Generator, num_threads: int
) -> Iterator[tuple[np.ndarray, float]]:
    """Search a motion for one cell; yields the mean of the knots and the share of samples that succeeded."""
    deviation = np.full_like(mean, FIRST_DEVIATION)
    for iteration in range(MAX_ITERATIONS):
        samples = mean + deviation * rng.standard_normal((NUM_SAMPLES, *mean.shape))
        trial = dataclasses.replace(line.trial(cell, FIRST_SEED + iteration, full_length=True), horizon=HORIZON)
        outcomes = _run(agent, samples, [trial] * NUM_SAMPLES, num_threads)
        elites = samples[np.argsort([_cost(line, outcome) for outcome in outcomes], kind="stable")[:NUM_ELITES]]
        mean = SMOOTHING * mean + (1.0 - SMOOTHING) * elites.mean(axis=0)
        spread = SMOOTHING * deviation + (1.0 - SMOOTHING) * elites.std(axis=0)
        deviation = np.maximum(spread, LEAST_DEVIATION)
        share = float(np.mean([line.succeeded(outcome) for outcome in outcomes]))
        yield mean, share
        if share >= ENOUGH:
            return


def _cost(line: Line, outcome: Outcome) -> float:
    """The cost to minimise: falls, early ones most, then steps, joint speeds, and a CoM that does not rest."""
    if not np.isfinite(outcome.com_speed):
        return 100.0 - outcome.seconds
    cost = outcome.com_speed + outcome.root_tilt
    if line.scenario.without_step:
        step = line.protocol.step_length
        cost += outcome.foot_shift / step + 10.0 * (outcome.foot_shift > step)
    if line.scenario.within_limits:
        cost += 10.0 * max(outcome.sustained_speed_ratio - line.protocol.speed_share, 0.0)
    return cost + 5.0 * (not outcome.recovered)


def _run(agent: Agent, knots: np.ndarray, trials: list[Trial], num_threads: int) -> list[Outcome]:
    """Outcomes of trials, each with its own knots (num_trials, NUM_KNOTS, num_joints)."""
    planned, source = PlannedAgent(agent, _plans(knots)), _InPlace(trials)
    # As many slots as trials: every trial then runs in the slot of its place, which is the robot of its plan.
    run_trials(planned, source, num_slots=len(trials), num_threads=num_threads)
    return [source.outcomes[place] for place in range(len(trials))]


class _InPlace(TrialSource):
    """Trials that may be alike, and their outcomes by their places."""

    def __init__(self, trials: list[Trial]):
        self._trials = [dataclasses.replace(trial) for trial in trials]  # one object each, by which they are told apart
        self._places = {id(trial): place for place, trial in enumerate(self._trials)}
        self._todo = iter(self._trials)
        self.outcomes: dict[int, Outcome] = {}

    def next(self) -> Trial | None:
        """The next of the trials."""
        return next(self._todo, None)

    def report(self, trial: Trial, outcome: Outcome) -> None:
        """Keep the outcome."""
        self.outcomes[self._places[id(trial)]] = outcome


def _plans(knots: np.ndarray) -> np.ndarray:
    """Offsets at every policy step (n, num_steps, num_joints), linear between the knots and zero after them."""
    when = np.linspace(0.0, MOTION_S, knots.shape[1] + 1)
    ends = np.concatenate([knots, np.zeros_like(knots[:, :1])], axis=1)
    steps = np.arange(round(MOTION_S * POLICY_HZ)) / POLICY_HZ
    below = np.minimum(np.searchsorted(when, steps, side="right") - 1, len(when) - 2)
    share = ((steps - when[below]) / (when[below + 1] - when[below]))[:, None]
    return (1.0 - share) * ends[:, below] + share * ends[:, below + 1]
