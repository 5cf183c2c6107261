"""Ring table: a comparison of any robots and policies, in units that make robots of different sizes comparable."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence

import numpy as np

from surefoot.evaluation.scenarios import limited_name
from surefoot.evaluation.threshold_search import Threshold
from surefoot.physics.mujoco_engine import MujocoEngine
from surefoot.report.evaluations import Evaluation
from surefoot.report.table import Table
from surefoot.report.thresholds import by_scenario
from surefoot.robots import load_robot

_TORSO, _HALF = "torso_com_push", "_half"


def ring_table(evaluations: Sequence[Evaluation]) -> Table:
    """A row per robot and agent: pushes at the root and at the torso, worst and best direction."""
    rows = [row for e in evaluations if (row := _row(e))]
    columns = [
        "robot", "agent", "directions", "within limits", "any", "[Ns/kg]", "J / (m sqrt(g z))", "J50", "no step",
        "torso", "torso J50", "quiet",
    ]  # fmt: skip
    note = (
        "Rejected impulses in the worst and the best direction [Ns]. Ns/kg and J / (m sqrt(g z)) are for any joint"
        " speeds; z is the height of the CoM above the soles. J50: half of the trials recover. Torso: pushes at"
        " its CoM. Quiet: drift of the CoM and mean power in 60 s without a push."
    )
    return Table("Robots and policies in the same ring", columns, rows, note)


def _row(e: Evaluation) -> list[str]:
    found = by_scenario(e.thresholds)
    root = found.get("root_push")
    if not root:
        return []
    worst, best = _worst_and_best(root)
    speed = math.sqrt(e.robot.gravity * _com_height(e.contract.robot, tuple(e.contract.nominal_pose)))
    return [
        e.robot.title,
        e.name.removesuffix(f" ({e.key.setup.robot})"),  # the robot has a column of its own
        str(len(root)),
        _span(found.get(limited_name("root_push"))),
        _span(root),
        f"{worst / e.robot.mass:.2f} / {best / e.robot.mass:.2f}",
        f"{worst / e.robot.mass / speed:.2f} / {best / e.robot.mass / speed:.2f}",
        _span(found.get("root_push" + _HALF)),
        _span(found.get("root_push_no_step")),
        _span(found.get(_TORSO)),
        _span(found.get(_TORSO + _HALF)),
        _quiet(e),
    ]


def _worst_and_best(lines: Mapping[str, Threshold]) -> tuple[float, float]:
    sizes = [t.size for t in lines.values()]
    return min(sizes), max(sizes)


def _span(lines: Mapping[str, Threshold] | None) -> str:
    if not lines:
        return ""
    worst, best = _worst_and_best(lines)
    return f"{worst:.3g} / {best:.3g}"


def _quiet(e: Evaluation) -> str:
    outcomes = list(e.fixed.get("quiet", {}).values())
    if not outcomes or not all(outcome.recovered for outcome in outcomes):
        return "does not stand" if outcomes else ""
    drift, power = max(o.quiet_drift for o in outcomes), max(o.quiet_power for o in outcomes)
    return f"{100 * drift:.1f} cm, {power:.1f} W"


@functools.cache
def _com_height(robot: str, pose: tuple[float, ...]) -> float:
    """Height of the CoM above the soles in a pose [m]; in the air, where no weight bends the joints."""
    start = MujocoEngine(load_robot(robot), 1).reset(np.array([0]), np.array([pose]), height=1.0)
    return float(start.com_height[0, 0])
