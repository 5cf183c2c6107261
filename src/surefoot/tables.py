"""Tables: thresholds beside the paper's numbers, for a person (text, Markdown) and for a machine (flat JSON)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from rich.table import Table

from surefoot import balance
from surefoot.evaluation import DIRECTIONS, Threshold
from surefoot.robot import Robot
from surefoot.simulation import Simulation


class PaperRow(NamedTuple):
    """A row of the paper's Table I [Ns]. It names no sides; its text calls only the 240 Ns a push with steps."""

    sagittal: float
    lateral: float


PAPER_TABLE_1 = {
    "trpo": PaperRow(240.0, 78.0),
    "ddpg": PaperRow(75.0, 160.0),
    "ppo": PaperRow(192.0, 36.0),
    "equation (6)": PaperRow(53.0, 78.0),
}


def capture_point_bound(robot: Robot, pose: str | np.ndarray, angles: Sequence[float]) -> list[float]:
    """Equation (6) on this robot [Ns]: what its sole and CoM allow without a step, per direction [rad].

    Args:
        pose: a named pose or joint angles (num_joints,) [rad].
    """
    joints = robot.pose(pose) if isinstance(pose, str) else pose
    start = Simulation(robot, 1).reset(np.array([0]), joints[None])
    # At rest before the first contact: both soles lie flat, so that all their corners support.
    polygon = start.flat_support_polygon()
    com = start.com_position[0, 0, :2]
    height = float(start.com_height[0, 0])
    return [
        balance.rejectable_impulse(
            robot.mass, height, balance.margin(polygon, com, np.array([np.cos(a), np.sin(a)])), robot.gravity
        )
        for a in angles
    ]


def worse_bounds(robot: Robot) -> tuple[float, float]:
    """Equation (6) in the paper's straight pose: the worse sagittal and the worse lateral direction [Ns]."""
    forward, left, backward, right = capture_point_bound(robot, "straight", list(DIRECTIONS.values()))
    return min(forward, backward), min(left, right)


def paper_row(name: str) -> PaperRow | None:
    """The paper's row for a policy whose name begins with its algorithm, such as "trpo" or "trpo-0"."""
    return PAPER_TABLE_1.get(name.split("-")[0].split(".")[0])


def worse_of(thresholds: Mapping[str, Threshold], names: Sequence[str]) -> Threshold:
    """The lowest of the named directions."""
    return min((thresholds[name] for name in names), key=lambda t: t.impulse)


def flat_figures(thresholds: Sequence[Threshold], robot: Robot, pose: np.ndarray, wall_s: float) -> dict[str, float]:
    """The figures of `surefoot evaluate --json`: documented in docs/figures.md, keys are stable.

    Impulses in Ns, shares from 0 to 1.
    """
    figures: dict[str, float] = {}
    for t in thresholds:
        key = f"pelvis_push.{t.line.name}"
        figures[key] = t.impulse
        figures[f"{key}.trials"] = t.trials
        figures[f"{key}.recovered"] = t.recovered
        figures[f"{key}.share_low"] = round(t.low, 4)
        figures[f"{key}.share_high"] = round(t.high, 4)
    impulses = [t.impulse for t in thresholds]
    figures["pelvis_push.worst"] = min(impulses)
    figures["pelvis_push.best"] = max(impulses)
    figures["pelvis_push.directions"] = len(impulses)
    figures["pelvis_push.worst_Ns_per_kg"] = round(min(impulses) / robot.mass, 4)
    figures["pelvis_push.best_Ns_per_kg"] = round(max(impulses) / robot.mass, 4)
    for name, bound in zip(DIRECTIONS, capture_point_bound(robot, pose, list(DIRECTIONS.values())), strict=True):
        figures[f"bound.{name}"] = round(bound, 1)
    figures["evaluate.wall_s"] = round(wall_s, 2)
    return figures


def direction_table(name: str, thresholds: Sequence[Threshold], robot: Robot, pose: np.ndarray) -> Table:
    """One policy, a row per direction."""
    table = Table(title=f"Rejected impulse at the pelvis: {name}", title_justify="left")
    for column in ("direction", "rejected [Ns]", "[Ns/kg]", "recovered", "Wilson 95 %", "eq. (6) [Ns]"):
        table.add_column(column, justify="left" if column == "direction" else "right")
    bounds = capture_point_bound(robot, pose, [t.line.angle for t in thresholds])
    for t, bound in zip(thresholds, bounds, strict=True):
        table.add_row(
            t.line.name,
            f"{t.impulse:.0f}",
            f"{t.impulse / robot.mass:.2f}",
            f"{t.recovered}/{t.trials}",
            f"{t.low:.2f} to {t.high:.2f}",
            f"{bound:.0f}",
        )
    return table


def table_1_rows(policies: Mapping[str, Sequence[Threshold]], robot: Robot) -> list[list[str]]:
    """Table I with ours beside the paper's: one row per policy, whose lines must hold the four main directions."""
    rows = []
    for name, thresholds in policies.items():
        by_name = {t.line.name: t for t in thresholds if not t.line.without_step and t.line.body == "pelvis"}
        sagittal = worse_of(by_name, ("forward", "backward"))
        lateral = worse_of(by_name, ("left", "right"))
        paper = paper_row(name)
        rows.append(
            [
                name,
                *(f"{by_name[d].impulse:.0f}" for d in DIRECTIONS),
                f"{sagittal.impulse:.0f} ({sagittal.impulse / robot.mass:.2f})",
                f"{paper.sagittal:.0f}" if paper else "",
                f"{lateral.impulse:.0f} ({lateral.impulse / robot.mass:.2f})",
                f"{paper.lateral:.0f}" if paper else "",
            ]
        )
    bound = PAPER_TABLE_1["equation (6)"]
    bounds = capture_point_bound(robot, "straight", list(DIRECTIONS.values()))
    sagittal_bound, lateral_bound = worse_bounds(robot)
    rows.append(
        [
            "equation (6)",
            *(f"{b:.0f}" for b in bounds),
            f"{sagittal_bound:.0f} ({sagittal_bound / robot.mass:.2f})",
            f"{bound.sagittal:.0f}",
            f"{lateral_bound:.0f} ({lateral_bound / robot.mass:.2f})",
            f"{bound.lateral:.0f}",
        ]
    )
    return rows


TABLE_1_COLUMNS = ["", *DIRECTIONS, "sagittal, worse (Ns/kg)", "paper", "lateral, worse (Ns/kg)", "paper"]


def table_1(policies: Mapping[str, Sequence[Threshold]], robot: Robot) -> Table:
    """Table I of the paper with our policies, for the terminal [Ns]."""
    table = Table(title="Table I: largest rejected impulse [Ns]", title_justify="left")
    for column in TABLE_1_COLUMNS:
        table.add_column(column, justify="right" if column else "left")
    for row in table_1_rows(policies, robot):
        table.add_row(*row)
    return table


def markdown(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [columns, ["---"] + ["---:"] * (len(columns) - 1), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"
