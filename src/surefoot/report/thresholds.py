"""Thresholds: queries on the results of searched scenarios, for tables, plots and metrics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from surefoot.evaluation.evaluate import Store, full_length_outcomes
from surefoot.evaluation.outcome import Outcome
from surefoot.evaluation.scenarios import DIRECTIONS, readable_name
from surefoot.evaluation.threshold_search import Threshold
from surefoot.evaluation.trials import Trial
from surefoot.robots import Robot

Fixed = Mapping[str, Mapping[Trial, Outcome]]
"""Outcomes of the scenarios in which nothing is searched, by scenario and trial."""

SAGITTAL, LATERAL = ("forward", "backward"), ("left", "right")
"""The main directions of each plane."""


def by_scenario(thresholds: Sequence[Threshold]) -> dict[str, dict[str, Threshold]]:
    """Scenario -> direction -> threshold."""
    found: dict[str, dict[str, Threshold]] = {}
    for t in thresholds:
        found.setdefault(t.line.scenario.name, {})[t.line.name] = t
    return found


def root_pushes(thresholds: Sequence[Threshold]) -> dict[str, Threshold]:
    """The thresholds of pushes at the root, steps allowed, by direction."""
    return by_scenario(thresholds).get("root_push", {})


def has_main_directions(lines: Mapping[str, Threshold]) -> bool:
    """Does a scenario, maybe one of a user's own, have the four that the paper's tables are made of?"""
    return set(DIRECTIONS) <= set(lines)


def worse_of(thresholds: Mapping[str, Threshold], names: Sequence[str]) -> Threshold:
    """The lowest of the named directions."""
    return min((thresholds[name] for name in names), key=lambda t: t.size)


def median_steps(thresholds: Sequence[Threshold], store: Store) -> dict[str, float]:
    """Median number of steps of the trials at the worst direction's threshold, by scenario."""
    steps = {}
    for name, lines in by_scenario(thresholds).items():
        outcomes = full_length_outcomes(min(lines.values(), key=lambda t: t.size), store)
        if outcomes:
            steps[name] = float(np.median([outcome.steps for outcome in outcomes]))
    return steps


def scenario_words(scenario: str, robot: Robot) -> str:
    """The name of a scenario as a reader says it, with the robot's own word for its root."""
    return readable_name(scenario, robot.root).replace("_", " ")


def root_words(robot: Robot) -> str:
    """The name of the robot's floating body, in words."""
    return robot.root.replace("_", " ")
