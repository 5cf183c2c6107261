"""Exam: held-out trials along every searched line of the paper suite, up to what we want to reach there.

A probe sees pushes at the root only; what a training run is after is more. The exam tells by scenario which share of
the way to the goal a policy goes, so that whole runs can be compared and one policy of many be chosen.
"""

from __future__ import annotations

import itertools

from surefoot.evaluation.scenarios import Line, Scenario
from surefoot.evaluation.suites import PAPER, ROOT_16
from surefoot.evaluation.trials import Trial, run_list
from surefoot.learning.probe import FIRST_SEED
from surefoot.task.agent import Agent
from surefoot.task.imperfections import PERFECT

NUM_SIZES = 6
"""Sizes that are tried along a line, evenly spaced up to the goal."""
UP_TO = {
    "root_push": 330.0,
    "root_push_no_step": 90.0,
    "torso_push": 264.0,
    "thigh_push": 360.0,
    "shank_push": 264.0,
    "landing_height": 1.5,
    "landing_tilt": 20.0,
    "combined": 240.0,
    "noise_observation": 240.0,
    "noise_action": 240.0,
    "noise_both": 240.0,
}
"""The goal of each scenario, in its unit; 0.8 of the one without noise for those with it."""
_SEEDS = FIRST_SEED // 2


def scenarios() -> list[Scenario]:
    """The scenarios of an exam; pushes at the root in 16 directions."""
    return [ROOT_16 if scenario.name == ROOT_16.name else scenario for scenario in PAPER if scenario.name in UP_TO]


def examine(policy: Agent, round: int = 0, num_threads: int = 0) -> dict[str, float]:
    """Share of the trials that succeeded, by scenario: one trial of each size in every direction.

    Args:
        round: which of many such sets of trials, that differ in their seeds.
    """
    lines = [line for scenario in scenarios() for line in scenario.lines()]
    seeds = itertools.count(_SEEDS + round * len(lines) * NUM_SIZES)
    # With noise nothing is ever quiet: only whole trials tell.
    trials = {
        line: [line.trial(cell, next(seeds), line.scenario.imperfections != PERFECT) for cell in _cells(line)]
        for line in lines
    }
    every: list[Trial] = [trial for asked in trials.values() for trial in asked]
    outcomes = run_list(policy, every, num_threads=num_threads)
    passed: dict[str, list[bool]] = {scenario.name: [] for scenario in scenarios()}
    for line, asked in trials.items():
        passed[line.scenario.name] += [line.succeeded(outcomes[trial]) for trial in asked]
    return {name: sum(each) / len(each) for name, each in passed.items()}


def _cells(line: Line) -> list[int]:
    end = UP_TO[line.scenario.name] / line.grid
    return [round(end * (k + 1) / NUM_SIZES) for k in range(NUM_SIZES)]
