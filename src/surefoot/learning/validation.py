"""Validation: a quick test of a policy in training, on trials held out from the evaluation proper."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from surefoot.evaluation.evaluate import push_lines
from surefoot.evaluation.outcome import Outcome
from surefoot.evaluation.protocol import PROTOCOL
from surefoot.evaluation.scenarios import DIRECTIONS, Line
from surefoot.evaluation.trials import run_list
from surefoot.robots import Robot
from surefoot.task.agent import Agent

NUM_DIRECTIONS = 8
SPACING = 6
"""Cells of the grid from one impulse to the next: 36 Ns for the paper's robot."""
NUM_IMPULSES = 15
NUM_PUSHES = NUM_DIRECTIONS * NUM_IMPULSES
QUIET_CELL = 17
"""The whole trials that show how quietly a policy stands afterwards: 102 Ns in every direction for
the paper's robot."""
QUIET_POWER, QUIET_DRIFT = 20.0, 0.01
"""Standing is quiet with less than this mean power [W] and this drift of the CoM [m], both scaled to
the robot, and without a step."""
MAX_SCORE = 4.0
SCORE_VERSION = 1
"""Whoever changes the trials of a validation, or what a score makes of them, raises it: then scores of before do not
count any more."""
FIRST_SEED = 1_000_000
"""Far from the evaluation's seeds, which count from 0."""


@dataclass(frozen=True)
class Validation:
    """The results of the held-out trials.

    Attributes:
        recovered: share of all pushes.
        within_limits: share of all pushes that it recovers from within the joints' speed limits.
        fell: share that ended in a fall.
        rejected: the largest impulse below which nothing failed, by direction name [Ns]. With one trial of each
            impulse this is a glance, not a measurement.
        rejected_within_limits: the same, if a joint beyond its speed limit is a failure too.
        quiet: share of whole trials after which the robot stood quietly.
        power: median of the mean power in these from 5 s after the push on [W]; NaN if none stood to its end.
        largest: impulse that is tried [Ns].
    """

    recovered: float
    within_limits: float
    fell: float
    rejected: dict[str, float]
    rejected_within_limits: dict[str, float]
    quiet: float
    power: float
    largest: float = NUM_IMPULSES * SPACING * PROTOCOL.impulse_step

    @property
    def score(self) -> float:
        """The score by which a run's best policy is kept: share of all pushes, impulses without a hole, quiet standing.

        A joint beyond its speed limit is a failure here. Of the impulses below which nothing failed, those of the worst
        direction and of the mean count alike.
        """
        values = list(self.rejected_within_limits.values())
        return self.within_limits + (min(values) + float(np.mean(values))) / self.largest + self.quiet

    def record(self) -> dict[str, float]:
        """Return what a policy's training record keeps; its keys are those of version 0.1."""
        shares = {"recovered": round(self.recovered, 4), "within_limits": round(self.within_limits, 4)}
        return shares | {"calm": self.quiet}

    def columns(self) -> dict[str, float]:
        """Return the columns of a learning curve; their names are those of version 0.1."""
        shares = {"recovered": self.recovered, "within_limits": self.within_limits, "fell": self.fell}
        return shares | {"calm": self.quiet, "calm_power": self.power} | self.main_directions()

    def main_directions(self) -> dict[str, float]:
        """Return the rejected impulses forward, left, backward and right [Ns]."""
        return {name: self.rejected[name] for name in DIRECTIONS}


def validate(policy: Agent, num_threads: int = 0, round: int = 0) -> Validation:
    """Run the held-out trials: 8 directions x 15 impulses from 36 to 540 Ns, one trial each, and 8 whole ones.

    The impulses are those for the paper's robot, and the same cells of the grid for any other.

    Args:
        policy: to be validated.
        num_threads: of the physics; 0 for one per core.
        round: which of many such sets of trials, that differ in their seeds. Rounds 2 and 3, 6 and 7 and so on push
            half way between the directions of the others, since a policy may have a hole where its training never
            looks.
    """
    robot = policy.robot
    lines = push_lines(2 * NUM_DIRECTIONS, robot)[round // 2 % 2 :: 2]
    spacing = SPACING * lines[0].grid
    cells = [(i, j) for i in range(NUM_DIRECTIONS) for j in range(NUM_IMPULSES)]
    seeds = itertools.count(FIRST_SEED + round * (len(cells) + NUM_DIRECTIONS))
    trials = {(i, j): lines[i].trial((j + 1) * SPACING, next(seeds), full_length=False) for i, j in cells}
    whole = [line.trial(QUIET_CELL, next(seeds), full_length=True) for line in lines]
    todo = [*whole, *trials.values()]
    outcomes = run_list(policy, todo, num_slots=len(todo), num_threads=num_threads)
    pushed = [[outcomes[trials[i, j]] for j in range(NUM_IMPULSES)] for i in range(NUM_DIRECTIONS)]
    recovered = np.array([[outcome.recovered for outcome in row] for row in pushed])
    is_legal = np.array([[outcome.is_within_limits(PROTOCOL.speed_share) for outcome in row] for row in pushed])
    within_limits = recovered & is_legal
    stood = [outcomes[trial] for trial in whole if outcomes[trial].recovered]
    return Validation(
        recovered=float(recovered.mean()),
        within_limits=float(within_limits.mean()),
        fell=float(np.mean([outcome.reason == "fell" for row in pushed for outcome in row])),
        rejected=_unbroken(lines, recovered, spacing),
        rejected_within_limits=_unbroken(lines, within_limits, spacing),
        quiet=sum(_is_quiet(outcome, robot) for outcome in stood) / NUM_DIRECTIONS,
        power=float(np.median([outcome.quiet_power for outcome in stood])) if stood else float("nan"),
        largest=NUM_IMPULSES * spacing,
    )


def _unbroken(lines: Sequence[Line], holds: np.ndarray, spacing: float) -> dict[str, float]:
    """Return the largest impulse [Ns] below which everything holds (num_lines, num_impulses), by line name."""
    impulses = np.cumprod(holds, axis=1).sum(axis=1) * spacing
    return {line.name: float(impulse) for line, impulse in zip(lines, impulses, strict=True)}


def _is_quiet(outcome: Outcome, robot: Robot) -> bool:
    """Tell whether the robot stood quietly from 5 s after the push on."""
    power, drift = QUIET_POWER * robot.power_scale, QUIET_DRIFT * robot.length_scale
    return outcome.quiet_power < power and outcome.quiet_drift < drift and outcome.quiet_steps == 0
