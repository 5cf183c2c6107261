"""Standing: the pushes that a policy rejects without a step, on trials held out from the evaluation proper."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from surefoot.evaluation.evaluate import push_lines
from surefoot.evaluation.protocol import protocol_for
from surefoot.evaluation.scenarios import Line, Scenario
from surefoot.evaluation.trials import NUM_SLOTS, run_list
from surefoot.learning.config import TrainConfig
from surefoot.learning.validation import FIRST_SEED, Validation, validate
from surefoot.task.agent import Agent

CELLS = tuple(range(5, 19))
"""Cells of the grid that are tried: 30 to 108 Ns."""
NUM_DIRECTIONS = 8
_SEED = FIRST_SEED + 500_000


@dataclass(frozen=True)
class GradedValidation(Validation):
    """The results of held-out trials for a policy that should step only where it must.

    Attributes:
        held: share of the small pushes that it recovers from without a step.
        standing: the largest impulse below which every push was recovered without a step, by direction name [Ns].
    """

    held: float = 0.0
    standing: dict[str, float] | None = None

    @property
    def score(self) -> float:
        """The score of all pushes, and twice the share of small ones that need no step."""
        return super().score + 2.0 * self.held

    def record(self) -> dict[str, float]:
        """Return what a policy's training record keeps."""
        return super().record() | {"held": round(self.held, 4)}

    def columns(self) -> dict[str, float]:
        """Return the columns of a learning curve."""
        standing = self.standing or {}
        return super().columns() | {"held": self.held} | {f"standing_{name}": standing[name] for name in standing}


def share_held(
    policy: Agent,
    lines: Sequence[Line],
    cells: Sequence[int] = CELLS,
    num_trials: int = 1,
    num_threads: int = 0,
    first_seed: int = _SEED,
) -> np.ndarray:
    """Return the share of trials that recover without a step, by line and cell (num_lines, num_cells).

    Args:
        policy: to be tested.
        lines: of pushes.
        cells: of the lines' grid.
        num_trials: of each cell.
        num_threads: of the physics; 0 for one per core.
        first_seed: of each cell's trials.
    """
    trials = {
        (i, j, k): line.trial(cell, first_seed + k, full_length=False)
        for i, line in enumerate(lines)
        for j, cell in enumerate(cells)
        for k in range(num_trials)
    }
    outcomes = run_list(policy, trials.values(), num_slots=min(NUM_SLOTS, len(trials)), num_threads=num_threads)
    share = np.zeros((len(lines), len(cells)))
    for (i, j, _), trial in trials.items():
        share[i, j] += outcomes[trial].is_without_step(lines[i].protocol.step_length) / num_trials
    return share


def validate_standing(policy: Agent, num_threads: int = 0) -> Validation:
    """Run held-out trials of small pushes, in which only recovering without a step counts as recovering."""
    lines = push_lines(2 * NUM_DIRECTIONS, policy.robot)[
        : NUM_DIRECTIONS + 1
    ]  # the right side is the left one's mirror image
    share = share_held(policy, lines, num_threads=num_threads)
    rejected = {line.name: impulse for line, impulse in zip(lines, _unbroken(share, lines[0].grid), strict=True)}
    held = float(share.mean())
    impulses = rejected | {"right": rejected["left"]}
    largest = CELLS[-1] * lines[0].grid
    # Pushes this small take no joint to its limit.
    return Validation(held, held, 1.0 - held, impulses, impulses, quiet=0.0, power=float("nan"), largest=largest)


def validate_graded(policy: Agent, num_threads: int = 0) -> GradedValidation:
    """Run the held-out trials of `validate`, and small pushes that need no step."""
    found, lines = validate(policy, num_threads), push_lines(NUM_DIRECTIONS, policy.robot)
    share = share_held(policy, lines, num_threads=num_threads)
    standing = {line.name: impulse for line, impulse in zip(lines, _unbroken(share, lines[0].grid), strict=True)}
    return GradedValidation(**vars(found), held=float(share.mean()), standing=standing)


def validation_for(config: TrainConfig) -> Callable[[Agent], Validation]:
    """Return the validation that fits a run: of small pushes too, or alone, if its robots must not step there."""
    if config.env.foot_shift_limit is None:
        return validate
    return validate_standing if config.env.foot_shift_impulse is None else validate_graded


def standing_thresholds(policy: Agent, scenario: Scenario, num_trials: int = 4, num_threads: int = 0) -> list[float]:
    """Return the largest impulse below which all pushes are held without a step, by line [Ns]."""
    lines, cells = scenario.lines(protocol_for(policy.robot)), range(2, 21)
    found, standing = np.zeros(len(lines)), np.ones(len(lines), bool)
    for cell in cells:
        tried = np.flatnonzero(standing)
        held = share_held(policy, [lines[i] for i in tried], [cell], num_trials, num_threads)[:, 0] == 1.0
        standing[tried] = held
        found[tried[held]] = [lines[i].size(cell) for i in tried[held]]
        if not standing.any():
            break
    return found.tolist()


def _unbroken(share: np.ndarray, grid: float) -> list[float]:
    """Return the largest impulse below which everything was held, for each line; 0 if the smallest one was not."""
    number = np.cumprod(share == 1.0, axis=1).sum(axis=1)
    return [float((CELLS[0] + n - 1) * grid) if n else 0.0 for n in number.tolist()]
