"""Targets: tables of the paper's value, surefoot's target and a policy's result for each line."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

from surefoot.evaluation.protocol import PROTOCOL, protocol_for
from surefoot.evaluation.targets import MAIN_DIRECTIONS, TARGET_VALUES
from surefoot.report import paper
from surefoot.report.table import Table
from surefoot.robots import Robot

_DIGITS = 4


class Target(NamedTuple):
    """A line to beat.

    Attributes:
        words: what the line is about.
        key: of the metrics, docs/figures.md.
        unit: of both figures.
        paper: its figure; None where it has none.
        value: what is to be reached at least; at most if `at_most`.
        at_most: is less better?
        directions: the line holds for evaluations with at least so many.
    """

    words: str
    key: str
    unit: str
    paper: float | None
    value: float
    at_most: bool = False
    directions: int = 4


def _target(words: str, key: str, unit: str, paper: float | None, at_most: bool = False, directions: int = 4) -> Target:
    """Return a line whose goal is in the table of targets."""
    return Target(words, key, unit, paper, TARGET_VALUES[key], at_most, directions)


TARGETS = (
    _target("within limits, worst of 16 directions", "root_push_within_limits.worst", "Ns", None, directions=16),
    _target("any joint speeds, worst of 16 directions", "root_push.worst", "Ns", None, directions=16),
    _target("best direction", "root_push.best", "Ns", 240.0),
    _target("without a step, better sagittal", "root_push_no_step.better_sagittal", "Ns", 72.0),
    _target("without a step, worse sagittal", "root_push_no_step.sagittal", "Ns", None),
    _target("without a step, worse side", "root_push_no_step.lateral", "Ns", 78.0),
    _target("without a step, worst of 16 directions", "root_push_no_step.worst", "Ns", None, directions=16),
    _target("upper torso, worst of four", "torso_push.worst", "Ns", 120.0),
    _target("thigh, worst of four", "thigh_push.worst", "Ns", 108.0),
    _target("shank, worst of four", "shank_push.worst", "Ns", 108.0),
    _target("landing within limits, height", "landing_within_limits.height_m", "m", 0.55),
    _target("landing, height", "landing.height_m", "m", 0.55),
    _target("landing, tilt before a drop from 0.4 m", "landing.angle_deg", "°", 5.0),
    _target("horizontal push after 500 Ns upwards", "combined.horizontal_Ns", "Ns", 70.0),
    _target("share kept under noise on the actions", "noise.action_share_kept", "", None),
    _target("share kept under noise on the state", "noise.observation_share_kept", "", None),
    _target("60 s undisturbed, drift of the CoM", "quiet.com_drift_m", "m", None, at_most=True),
    _target("60 s undisturbed, steps", "quiet.steps", "", None, at_most=True),
    _target("60 s undisturbed, mean power", "quiet.mean_power_W", "W", None, at_most=True),
    _target("from 5 s after a push, drift of the CoM", "quiet_after_push.com_drift_m", "m", None, at_most=True),
    _target("from 5 s after a push, steps", "quiet_after_push.steps", "", None, at_most=True),
    _target("from 5 s after a push, mean power", "quiet_after_push.mean_power_W", "W", None, at_most=True),
)


def targets_of(algorithm: str) -> tuple[Target, ...]:
    """All lines, those of Table I for an algorithm of the paper; the others as for its best, TRPO."""
    theirs = paper.TABLE_1.get(algorithm, paper.TABLE_1["trpo"])
    sagittal, lateral = MAIN_DIRECTIONS.get(algorithm, MAIN_DIRECTIONS["trpo"])
    return (
        Target("sagittal, worse of two", "root_push.sagittal", "Ns", theirs.sagittal, sagittal),
        Target("lateral, worse side", "root_push.lateral", "Ns", theirs.lateral, lateral),
        *TARGETS,
    )


def targets_for(robot: Robot, algorithm: str) -> tuple[Target, ...]:
    """All lines with the targets scaled to a robot: the same cells of its grid, heights by its legs, power by both.

    The paper's figures stand only beside its own robot.
    """
    lines = targets_of(algorithm)
    if robot.is_of_the_paper:
        return lines
    impulse = protocol_for(robot).impulse_step / PROTOCOL.impulse_step
    scales = {"Ns": impulse, "m": robot.length_scale, "W": robot.power_scale}
    return tuple(
        line._replace(value=round(line.value * scales.get(line.unit, 1.0), _DIGITS), paper=None) for line in lines
    )


FIVE_MINUTES = {"sagittal": (210.0, 234.0, 300.0), "lateral": (276.0, 282.0, 300.0)}
"""Result of five minutes of `surefoot train` on two cores, by plane: the lowest, median and highest of three seeds of
DDPG [Ns]; the worse of the plane's two directions, from results/seeds.csv."""


def first_table(name: str, algorithm: str, minutes: float, metrics: Mapping[str, float]) -> Table:
    """The results of a policy of a few minutes, beside the paper's policy and five minutes of learning.

    Args:
        name: of the policy.
        algorithm: which learned it.
        minutes: for how long.
        metrics: with `root_push.sagittal` and `root_push.lateral`.
    """
    theirs = paper.TABLE_1.get(algorithm, paper.TABLE_1["trpo"])
    rows = []
    for plane, words in (("sagittal", "forward or backward"), ("lateral", "to the left or right")):
        low, median, high = FIVE_MINUTES[plane]
        usual = f"{median:g} ({low:g} to {high:g})" if algorithm == "ddpg" else ""
        rows.append((words, f"{metrics[f'root_push.{plane}']:g}", usual, f"{getattr(theirs, plane):g}"))
    columns = ("hardest push [Ns]", f"{name}, {minutes:g} min", "five minutes", "the paper")
    note = (
        "Each value is that of the worse of the two directions. Five minutes: DDPG on two free cores, median and range"
        " of three seeds. The paper: its policy of the same algorithm, trained for up to two days."
    )
    return Table("How far it got", columns, rows, note)


def targets_table(name: str, algorithm: str, metrics: Mapping[str, float], robot: Robot) -> Table:
    """The results of a policy on the tested lines."""
    rows = []
    for target in targets_for(robot, algorithm):
        if target.key in metrics and metrics.get("root_push.directions", 0) >= target.directions:
            found = metrics[target.key]
            reached = found <= target.value if target.at_most else found >= target.value
            theirs = "" if target.paper is None else f"{target.paper:g}"
            value = "did not stand" if math.isnan(found) else f"{found:g}"
            sign = "≤" if target.at_most else "≥"
            rows.append(
                (target.words, target.unit, theirs, f"{sign} {target.value:g}", value, "yes" if reached else "no")
            )
    columns = ("line", "unit", "paper", "target", name, "reached")
    note = "Drift, steps and power are the largest values over all trials."
    if not robot.is_of_the_paper:
        note += " The targets are those for the paper's robot, scaled by mass and leg length."
    return Table("The lines to beat", columns, rows, note)
