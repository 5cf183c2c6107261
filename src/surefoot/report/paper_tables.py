"""Paper tables: our numbers beside those of the paper's Tables I to V and of other publications."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from surefoot.evaluation.outcome import Outcome, joint_groups
from surefoot.evaluation.scenarios import DIRECTIONS, direction_of
from surefoot.evaluation.threshold_search import Threshold
from surefoot.report import paper
from surefoot.report.bounds import main_bounds, worse_bounds
from surefoot.report.table import Table
from surefoot.report.thresholds import LATERAL, SAGITTAL, Fixed, by_scenario, has_main_directions, root_pushes, worse_of
from surefoot.robots import Robot


def table_1(policies: Mapping[str, Sequence[Threshold]], robot: Robot) -> Table:
    """Table I: one row per policy that was pushed at its root in the four main directions."""
    rows = []
    for name, thresholds in policies.items():
        pushes = root_pushes(thresholds)
        if not has_main_directions(pushes):
            continue
        sagittal, lateral = worse_of(pushes, SAGITTAL), worse_of(pushes, LATERAL)
        row = paper.algorithm_row(name)
        rows.append(
            [
                name,
                *(f"{pushes[d].size:g}" for d in DIRECTIONS),
                f"{sagittal.size:g}",
                f"{row.sagittal:.0f}" if row else "",
                f"{lateral.size:g}",
                f"{row.lateral:.0f}" if row else "",
            ]
        )
    bound = paper.TABLE_1[paper.NO_STEP_BOUND]
    sagittal_bound, lateral_bound = worse_bounds(robot)
    rows.append(
        [
            paper.NO_STEP_BOUND,
            *(f"{b:.0f}" for b in main_bounds(robot)),
            f"{sagittal_bound:.0f}",
            f"{bound.sagittal:.0f}",
            f"{lateral_bound:.0f}",
            f"{bound.lateral:.0f}",
        ]
    )
    columns = ["", *DIRECTIONS, "sagittal", "paper", "lateral", "paper"]
    note = (
        "Sagittal and lateral: the worse of the two directions. No-step bound: the impulse that a point mass over fixed"
        f" feet can reject in the pose {robot.default_pose}, equation (6) of the paper."
    )
    return Table("Table I: largest rejected impulse [Ns]", columns, rows, note)


def table_2(fixed: Fixed) -> Table:
    """Table II: which strategies the paper's four pushes bring out: share of the trials, and the paper's mark."""
    rows = []
    for scenario, theirs in paper.TABLE_2.items():
        by_direction: dict[str, list[Outcome]] = {}
        for trial, outcome in fixed.get(scenario, {}).items():
            by_direction.setdefault(direction_of(trial.push), []).append(outcome)
        for direction, outcomes in by_direction.items():
            ours = [[o.ankle, o.hip, o.foot_tilt, o.steps > 0] for o in outcomes]
            marks = ["yes" if mark else "no" for mark in theirs]
            shares = [f"{share:.0%} ({mark})" for share, mark in zip(np.mean(ours, axis=0), marks, strict=True)]
            recovered = f"{sum(o.recovered for o in outcomes)}/{len(outcomes)}"
            words, steps = f"{_words(scenario)} {direction}", np.median([o.steps for o in outcomes])
            rows.append([words, recovered, *shares, f"{steps:g}"])
    columns = ["push [Ns]", "recovered", "ankle", "hip", "foot tilt", "step", "steps"]
    note = (
        "Share of the trials in which a strategy was seen, and in brackets whether the paper marks it. Steps: median."
        " The table on quiet standing shows the policy's motion without pushes."
    )
    return Table("Table II: strategies", columns, rows, note)


def table_3(thresholds: Sequence[Threshold], robot: Robot, steps: Mapping[str, float]) -> Table:
    """Table III: pushes at other bodies.

    Args:
        thresholds: of one policy.
        robot: whose they are.
        steps: median number of steps by scenario, at the worst direction's threshold.
    """
    rows = []
    found = by_scenario(thresholds)
    for scenario, theirs in paper.TABLE_3.items():
        lines = found.get(scenario, {})
        if not has_main_directions(lines):
            continue
        worst = min(lines.values(), key=lambda t: t.size)
        torque = worst.size / worst.line.scenario.duration * theirs.lever
        pairs = [
            f"{worst.size:g} ({theirs.impulse:g})",
            f"{worst.size / robot.mass:.2f}",
            f"{torque:.0f} ({theirs.torque:.0f})",
            f"{steps[scenario]:g} ({theirs.steps})" if scenario in steps else f"({theirs.steps})",
        ]
        rows.append([_words(scenario.removesuffix("_push")), *(f"{lines[d].size:g}" for d in DIRECTIONS), *pairs])
    columns = ["body", *DIRECTIONS, "worst", "[Ns/kg]", "torque [Nm]", "steps"]
    note = (
        "Rejected impulse [Ns] with the paper's levers, and the paper's value in brackets. The torque about the CoM and"
        " the median number of steps are those at the worst direction's threshold."
    )
    return Table("Table III: other body parts", columns, rows, note)


def table_4(agents: Mapping[str, Sequence[Threshold]], robot: Robot) -> Table:
    """Table IV: the paper's studies A to G, those that are rebuilt as measured here, and ours."""
    rows = []
    for letter, study in paper.TABLE_4.items():
        steps = "yes" if study.stepping else "no"
        figures = [f"{study.mass:g}", f"{study.impulse:g}", f"{study.normalised:.2f}", f"{study.printed:.2f}", steps]
        rows.append([f"{letter} {study.study}", study.robot, *figures])
        rebuilt = paper.REBUILT.get(letter, "")
        if rebuilt in agents:
            rows += _measured(f"  {rebuilt}", by_scenario(agents[rebuilt]).get("root_push", {}), robot, steps)
    for name, thresholds in agents.items():
        if name not in paper.REBUILT.values():
            found = by_scenario(thresholds)
            rows += _measured(name, found.get("root_push_no_step", {}), robot, "no")
            rows += _measured(name, found.get("root_push", {}), robot, "yes")
    columns = ["study", "robot", "[kg]", "[Ns]", "[Ns/kg]", "printed", "steps"]
    note = (
        "Ns/kg is impulse per mass; the paper's printed figures do not all follow from its own numbers. C and D are"
        " hardware, the others simulation. Our measurements use one definition of success and give the worse side."
    )
    return Table("Table IV: push recovery studies", columns, rows, note)


def has_table_4(name: str, thresholds: Sequence[Threshold]) -> bool:
    """Is there enough for a row of Table IV?"""
    scenario = "root_push" if name in paper.REBUILT.values() else "root_push_no_step"
    return has_main_directions(by_scenario(thresholds).get(scenario, {}))


def _measured(name: str, lines: Mapping[str, Threshold], robot: Robot, steps: str) -> list[list[str]]:
    if not has_main_directions(lines):
        return []
    rows = []
    for plane, directions in (("sagittal", SAGITTAL), ("lateral", LATERAL)):
        size = worse_of(lines, directions).size
        figures = [f"{robot.mass:.0f}", f"{size:g}", f"{size / robot.mass:.2f}", "", steps]
        rows.append([f"{name}, {plane}", robot.title, *figures])
    return rows


def published_table() -> Table:
    """Push figures of other publications."""
    columns = ["source", "robot", "push", "Ns (Ns/kg)", "steps"]
    return Table("Published push figures", columns, [list(row) for row in paper.PUBLISHED])


def table_5(fixed: Fixed, robot: Robot) -> list[Table]:
    """Table V, torques and speeds apart: peaks per joint group over the trials of each case, and the paper's."""
    cases = {name: list(fixed[name].values()) for name in paper.TABLE_5 if fixed.get(name)}
    if not cases:
        return []
    order = [joint_groups(robot).index(group) for group in paper.PEAK_GROUPS]
    columns = ["", *(_words(group) for group in paper.PEAK_GROUPS)]
    tables = []
    for quantity, unit, digits in (("torque", "Nm", 0), ("speed", "rad/s", 2)):
        rows = [["limit", *(f"{limit:g}" for limit in getattr(paper.TABLE_5_LIMITS, quantity))]]
        for name, outcomes in cases.items():
            peaks = np.max([getattr(o, f"{quantity}_peaks") for o in outcomes], axis=0)
            rows.append([_words(name), *(f"{peaks[i]:.{digits}f}" for i in order)])
            rows.append(["  paper", *(f"{value:g}" for value in getattr(paper.TABLE_5[name], quantity))])
        title = f"Table V: peak joint {quantity} [{unit}]"
        tables.append(Table(title, columns, rows, "The values are the largest over the trials."))
    rows = []
    for name, outcomes in cases.items():
        longest = np.max([o.saturated_s for o in outcomes], axis=0)
        rows.append([_words(name), *(f"{longest[i]:.2f}" for i in order)])
    note = "The longest time that one joint of the group spent at its torque limit in one trial."
    return [*tables, Table("Time in saturation [s]", columns, rows, note)]


def _words(name: str) -> str:
    return name.replace("_", " ")
