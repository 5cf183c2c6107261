"""Probe: a quick look at a policy in training, on trials held out from the evaluation proper."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surefoot.evaluation import DIRECTIONS, Line, push_lines
from surefoot.policy import Policy
from surefoot.trials import Trial, run_list

NUM_DIRECTIONS = 8
SPACING = 5
"""Cells of the grid from one probed impulse to the next: 30 Ns."""
NUM_IMPULSES = 12
FIRST_SEED = 1_000_000
"""Far from the evaluation's seeds, which count from 0."""


@dataclass(frozen=True)
class Probe:
    """What the held-out trials say.

    Attributes:
        recovered: share of all of them.
        fell: share that ended in a fall.
        rejected: the largest impulse below which nothing failed, by direction name [Ns]: one trial a cell, so a
            glance and not a measurement.
    """

    recovered: float
    fell: float
    rejected: dict[str, float]

    @property
    def score(self) -> float:
        """By which the best policy of a run is kept: all pushes, and the worst direction's without a hole."""
        largest = NUM_IMPULSES * SPACING * 6.0
        values = list(self.rejected.values())
        return self.recovered + (min(values) + float(np.mean(values))) / largest

    def main_directions(self) -> dict[str, float]:
        """Rejected impulses forward, left, backward and right."""
        return {name: self.rejected[name] for name in DIRECTIONS}


def probe(policy: Policy, num_threads: int = 0) -> Probe:
    """Run the held-out trials: 8 directions x 12 impulses from 30 to 360 Ns, one trial each."""
    lines = push_lines(num_directions=NUM_DIRECTIONS)
    trials = {(i, j): _trial(lines[i], i, j) for i in range(NUM_DIRECTIONS) for j in range(NUM_IMPULSES)}
    outcomes = run_list(policy, trials.values(), num_slots=len(trials), num_threads=num_threads)
    recovered = np.array(
        [[outcomes[trials[i, j]].recovered for j in range(NUM_IMPULSES)] for i in range(NUM_DIRECTIONS)]
    )
    unbroken = np.cumprod(recovered, axis=1).sum(axis=1) * SPACING * 6.0
    return Probe(
        recovered=float(recovered.mean()),
        fell=float(np.mean([outcome.reason == "fell" for outcome in outcomes.values()])),
        rejected={line.name: float(impulse) for line, impulse in zip(lines, unbroken, strict=True)},
    )


def _trial(line: Line, direction: int, impulse: int) -> Trial:
    return line.trial((impulse + 1) * SPACING, FIRST_SEED + direction * NUM_IMPULSES + impulse, whole=False)
