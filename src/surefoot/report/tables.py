"""Tables: a policy's results beside the paper's numbers, Tables I to V, for a terminal, Markdown or a page."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from rich import box
from rich.markup import escape
from rich.table import Table as RichTable

from surefoot.agents.agent import Named
from surefoot.evaluation.evaluate import Store, full_length_outcomes
from surefoot.evaluation.outcome import Outcome, joint_groups
from surefoot.evaluation.scenarios import DIRECTIONS
from surefoot.evaluation.suites import PAPER
from surefoot.evaluation.threshold_search import Threshold
from surefoot.evaluation.trials import Trial
from surefoot.physics import balance
from surefoot.physics.mujoco_engine import MujocoEngine
from surefoot.report import paper
from surefoot.robots import Robot

Fixed = Mapping[str, Mapping[Trial, Outcome]]
"""Outcomes of the scenarios in which nothing is searched, by scenario and trial."""


@dataclass(frozen=True)
class Table:
    """Texts in rows and columns; the first column names the row.

    Attributes:
        note: what a reader has to know, in a sentence or two.
    """

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""

    def rich(self) -> RichTable:
        """For the terminal."""
        title, note = escape(self.title), escape(self.note)
        table = RichTable(
            title=title,
            title_justify="left",
            title_style="bold",
            caption=note or None,
            caption_justify="left",
            box=box.SIMPLE_HEAD,
            pad_edge=False,
            collapse_padding=True,
        )
        for i, column in enumerate(self.columns):
            table.add_column(escape(column), justify="right" if i else "left")
        for row in self.rows:
            table.add_row(*map(escape, row))
        return table

    def markdown(self) -> str:
        """For a README."""
        lines = [self.columns, ["---"] + ["---:"] * (len(self.columns) - 1), *self.rows]
        return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def by_scenario(thresholds: Sequence[Threshold]) -> dict[str, dict[str, Threshold]]:
    """Scenario -> direction -> threshold."""
    found: dict[str, dict[str, Threshold]] = {}
    for t in thresholds:
        found.setdefault(t.line.scenario.name, {})[t.line.name] = t
    return found


def root_pushes(thresholds: Sequence[Threshold]) -> dict[str, Threshold]:
    """The thresholds of pushes at the root, steps allowed, by direction."""
    return by_scenario(thresholds).get("root_push", {})


def capture_point_bound(robot: Robot, pose: str | np.ndarray, angles: Sequence[float]) -> list[float]:
    """Equation (6) on this robot [Ns]: what its sole and CoM allow without a step, per direction [rad].

    Args:
        pose: a named pose or joint angles (num_joints,) [rad].
    """
    joints = robot.pose(pose) if isinstance(pose, str) else pose
    start = MujocoEngine(robot, 1).reset(np.array([0]), joints[None])
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


def paper_row(name: str) -> paper.AlgorithmRow | None:
    """The paper's row for a policy whose name begins with its algorithm, such as "trpo" or "trpo-0"."""
    return paper.TABLE_1.get(name.split("-")[0].split(".")[0])


def has_main_directions(lines: Mapping[str, Threshold]) -> bool:
    """Does a scenario, maybe one of a user's own, have the four that the paper's tables are made of?"""
    return set(DIRECTIONS) <= set(lines)


def worse_of(thresholds: Mapping[str, Threshold], names: Sequence[str]) -> Threshold:
    """The lowest of the named directions."""
    return min((thresholds[name] for name in names), key=lambda t: t.size)


def all_tables(
    policy: Named, thresholds: Sequence[Threshold], fixed: Fixed, steps: Mapping[str, float], robot: Robot
) -> list[Table]:
    """Every table that one policy's results fill; `steps` as for `table_3`."""
    found = by_scenario(thresholds)
    tables: list[Table] = []
    if "root_push" in found:
        tables.append(direction_table(policy.name, thresholds, robot, np.array(policy.contract.nominal_pose)))
    if has_main_directions(root_pushes(thresholds)):
        tables.append(table_1({policy.contract.training.get("algorithm", policy.name): thresholds}, robot))
    tables.append(table_2(fixed))
    tables.append(table_3(thresholds, robot, steps))
    if has_table_4(policy.name, thresholds):
        tables.append(table_4({policy.name: thresholds}, robot))
    tables += table_5(fixed, robot)
    tables.append(quiet_table(fixed))
    if set(found) != {"root_push"}:
        tables.append(scenario_table(policy.name, thresholds))
    return [table for table in tables if table.rows]


def median_steps(thresholds: Sequence[Threshold], store: Store) -> dict[str, float]:
    """Median number of steps of the trials at the worst direction's threshold, by scenario."""
    steps = {}
    for name, lines in by_scenario(thresholds).items():
        outcomes = full_length_outcomes(min(lines.values(), key=lambda t: t.size), store)
        if outcomes:
            steps[name] = float(np.median([outcome.steps for outcome in outcomes]))
    return steps


def direction_table(name: str, thresholds: Sequence[Threshold], robot: Robot, pose: np.ndarray) -> Table:
    """Pushes of one policy at the root, a row per direction."""
    pushes = root_pushes(thresholds)
    bounds = capture_point_bound(robot, pose, [t.line.angle for t in pushes.values()])
    rows = [
        [
            t.line.name,
            f"{t.size:.0f}",
            f"{t.size / robot.mass:.2f}",
            f"{t.recovered}/{t.trials}",
            f"{t.low:.2f} to {t.high:.2f}",
            f"{bound:.0f}",
        ]
        for t, bound in zip(pushes.values(), bounds, strict=True)
    ]
    columns = ["direction", "rejected [Ns]", "[Ns/kg]", "recovered", "Wilson 95 %", "eq. (6) [Ns]"]
    return Table(f"Rejected impulse at the root: {name}", columns, rows)


def scenario_table(name: str, thresholds: Sequence[Threshold]) -> Table:
    """Every searched scenario of one policy: worst and best direction."""
    rows = []
    for scenario, lines in by_scenario(thresholds).items():
        worst, best = (choose(lines.values(), key=lambda t: t.size) for choose in (min, max))
        rows.append(
            [
                scenario,
                f"{worst.size:g} ({worst.line.name})",
                f"{best.size:g} ({best.line.name})",
                worst.line.scenario.unit,
                f"{worst.recovered}/{worst.trials}",
                f"{worst.low:.2f} to {worst.high:.2f}",
            ]
        )
    columns = ["scenario", "worst", "best", "unit", "recovered", "Wilson 95 %"]
    return Table(f"Largest recovered disturbance: {name}", columns, rows, "Recovered trials at the worst direction.")


def table_1(policies: Mapping[str, Sequence[Threshold]], robot: Robot) -> Table:
    """Table I: one row per policy that was pushed at the root in the four main directions."""
    rows = []
    for name, thresholds in policies.items():
        pushes = root_pushes(thresholds)
        if not has_main_directions(pushes):
            continue
        sagittal, lateral = worse_of(pushes, ("forward", "backward")), worse_of(pushes, ("left", "right"))
        row = paper_row(name)
        rows.append(
            [
                name,
                *(f"{pushes[d].size:.0f}" for d in DIRECTIONS),
                f"{sagittal.size:.0f}",
                f"{row.sagittal:.0f}" if row else "",
                f"{lateral.size:.0f}",
                f"{row.lateral:.0f}" if row else "",
            ]
        )
    bound = paper.TABLE_1["equation (6)"]
    bounds = capture_point_bound(robot, "straight", list(DIRECTIONS.values()))
    sagittal_bound, lateral_bound = worse_bounds(robot)
    rows.append(
        [
            "equation (6)",
            *(f"{b:.0f}" for b in bounds),
            f"{sagittal_bound:.0f}",
            f"{bound.sagittal:.0f}",
            f"{lateral_bound:.0f}",
            f"{bound.lateral:.0f}",
        ]
    )
    columns = ["", *DIRECTIONS, "sagittal", "paper", "lateral", "paper"]
    note = "Sagittal and lateral: the worse of the two directions. Equation (6): the paper's straight pose."
    return Table("Table I: largest rejected impulse [Ns]", columns, rows, note)


def worst_table(policies: Mapping[str, Sequence[Threshold]]) -> Table:
    """The worst direction of every searched scenario of the paper: a row per policy or controller."""
    found = {name: by_scenario(thresholds) for name, thresholds in policies.items()}
    searched = [s for s in PAPER if s.search and any(s.name in of_one for of_one in found.values())]
    rows = []
    for name, of_one in found.items():
        worst = [min((t.size for t in of_one.get(s.name, {}).values()), default=None) for s in searched]
        rows.append([name, *("" if size is None else f"{size:g}" for size in worst)])
    columns = ["", *(f"{_words(s.name)} [{s.unit}]" for s in searched)]
    note = "The largest value that holds in every direction that was tested."
    return Table("The worst direction of every scenario", columns, rows, note)


def seeds_table(policies: Iterable[tuple[str, Sequence[Threshold]]]) -> Table:
    """Median and range over the policies that one algorithm learned, beside the paper's single runs.

    Args:
        policies: each one's algorithm and thresholds; an algorithm with one policy gets no row.
    """
    groups: dict[str, list[dict[str, Threshold]]] = {}
    for algorithm, thresholds in policies:
        if has_main_directions(pushes := root_pushes(thresholds)):
            groups.setdefault(algorithm, []).append(pushes)
    rows = []
    for algorithm, several in groups.items():
        if len(several) > 1:
            row = paper_row(algorithm)
            cells = [algorithm, str(len(several))]
            for plane, names in (("sagittal", ("forward", "backward")), ("lateral", ("left", "right"))):
                sizes = [worse_of(pushes, names).size for pushes in several]
                cells += [f"{np.median(sizes):g}", f"{min(sizes):g} to {max(sizes):g}"]
                cells.append(f"{getattr(row, plane):g}" if row else "")
            rows.append(cells)
    columns = ["algorithm", "seeds", "sagittal", "range", "paper", "lateral", "range", "paper"]
    return Table("Over seeds: rejected impulse [Ns]", columns, rows, "Median over seeds of the worse direction.")


def table_2(fixed: Fixed) -> Table:
    """Table II: which strategies the paper's four pushes bring out: share of the trials, and the paper's mark."""
    rows = []
    for scenario, theirs in paper.TABLE_2.items():
        outcomes = list(fixed.get(scenario, {}).values())
        if not outcomes:
            continue
        ours = [[o.ankle, o.hip, o.foot_tilt, o.steps > 0] for o in outcomes]
        marks = ["yes" if mark else "no" for mark in theirs]
        shares = [f"{share:.0%} ({mark})" for share, mark in zip(np.mean(ours, axis=0), marks, strict=True)]
        recovered = f"{sum(o.recovered for o in outcomes)}/{len(outcomes)}"
        rows.append([_words(scenario), recovered, *shares, f"{np.median([o.steps for o in outcomes]):g}"])
    columns = ["push [Ns]", "recovered", "ankle", "hip", "foot tilt", "step", "steps"]
    note = (
        "Share of the trials in which a strategy was seen; in brackets whether the paper marks it. Steps: median. What"
        " a policy does unpushed is under quiet standing."
    )
    return Table("Table II: strategies", columns, rows, note)


def table_3(thresholds: Sequence[Threshold], robot: Robot, steps: Mapping[str, float]) -> Table:
    """Table III: pushes at other bodies.

    Args:
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
            f"{worst.size:.0f} ({theirs.impulse:.0f})",
            f"{worst.size / robot.mass:.2f}",
            f"{torque:.0f} ({theirs.torque:.0f})",
            f"{steps[scenario]:g} ({theirs.steps})" if scenario in steps else f"({theirs.steps})",
        ]
        rows.append([_words(scenario.removesuffix("_push")), *(f"{lines[d].size:.0f}" for d in DIRECTIONS), *pairs])
    columns = ["body", *DIRECTIONS, "worst", "[Ns/kg]", "torque [Nm]", "steps"]
    note = (
        "Rejected impulse [Ns] with the paper's levers; in brackets the paper's. Torque about the CoM, and median"
        " number of steps, at the worst direction's threshold."
    )
    return Table("Table III: other body parts", columns, rows, note)


def table_4(entrants: Mapping[str, Sequence[Threshold]], robot: Robot) -> Table:
    """Table IV: the paper's studies A to G, those that are rebuilt as measured here, and ours."""
    rows = []
    for letter, study in paper.TABLE_4.items():
        steps = "yes" if study.stepping else "no"
        figures = [f"{study.mass:g}", f"{study.impulse:g}", f"{study.normalised:.2f}", f"{study.printed:.2f}", steps]
        rows.append([f"{letter} {study.study}", study.robot, *figures])
        rebuilt = paper.REBUILT.get(letter, "")
        if rebuilt in entrants:
            rows += _measured(f"  {rebuilt}", by_scenario(entrants[rebuilt]).get("root_push", {}), robot, steps)
    for name, thresholds in entrants.items():
        if name not in paper.REBUILT.values():
            found = by_scenario(thresholds)
            rows += _measured(name, found.get("root_push_no_step", {}), robot, "no")
            rows += _measured(name, found.get("root_push", {}), robot, "yes")
    columns = ["study", "robot", "[kg]", "[Ns]", "[Ns/kg]", "printed", "steps"]
    note = (
        "Ns/kg is impulse over mass; the paper prints figures that do not follow from its own. C and D are hardware,"
        " the others simulation. Measured here, by one definition of success: the worse side."
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
    for plane, directions in (("sagittal", ("forward", "backward")), ("lateral", ("left", "right"))):
        size = worse_of(lines, directions).size
        figures = [f"{robot.mass:.0f}", f"{size:.0f}", f"{size / robot.mass:.2f}", "", steps]
        rows.append([f"{name}, {plane}", "Valkyrie", *figures])
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
        tables.append(Table(f"Table V: peak joint {quantity} [{unit}]", columns, rows, "Largest over the trials."))
    rows = []
    for name, outcomes in cases.items():
        longest = np.max([o.saturated_s for o in outcomes], axis=0)
        rows.append([_words(name), *(f"{longest[i]:.2f}" for i in order)])
    note = "Longest time that one joint of the group spent at its torque limit in one trial."
    return [*tables, Table("Time in saturation [s]", columns, rows, note)]


def quiet_table(fixed: Fixed) -> Table:
    """Quiet standing: 60 s undisturbed, and from 5 s after recovered pushes on."""
    rows = []
    for scenario, outcomes in fixed.items():
        if not scenario.startswith("quiet"):
            continue
        stood = [o for o in outcomes.values() if o.recovered]
        values = ["", "", ""]
        if stood:
            drift, power = max(o.quiet_drift for o in stood), max(o.quiet_power for o in stood)
            values = [f"{100 * drift:.1f}", f"{power:.1f}", f"{sum(o.quiet_steps for o in stood):g}"]
        rows.append([_words(scenario), f"{len(stood)}/{len(outcomes)}", *values])
    columns = ["", "recovered", "CoM drift [cm]", "mean power [W]", "steps"]
    return Table("Quiet standing", columns, rows, "Largest drift and power, and all steps, of the recovered trials.")


def _words(name: str) -> str:
    return name.replace("_", " ")
