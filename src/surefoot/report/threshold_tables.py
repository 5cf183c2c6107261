"""Threshold tables: the largest disturbances from which one policy or several recovered."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from surefoot.evaluation.protocol import PROTOCOL
from surefoot.evaluation.scenarios import limited_name, readable_name
from surefoot.evaluation.setup import Measured
from surefoot.evaluation.suites import PAPER
from surefoot.evaluation.threshold_search import Threshold
from surefoot.physics.engines import DEFAULT_ENGINE
from surefoot.report import paper
from surefoot.report.bounds import capture_point_bound
from surefoot.report.table import Table
from surefoot.report.thresholds import (
    LATERAL,
    SAGITTAL,
    by_scenario,
    has_main_directions,
    root_pushes,
    root_words,
    scenario_words,
    worse_of,
)
from surefoot.robots import Robot, load_robot

LIMITS_NOTE = (
    f"Within limits: no joint exceeds {PROTOCOL.speed_share:g} times its speed limit as a mean over"
    f" {1000 * PROTOCOL.speed_time:g} ms; torques cannot exceed theirs."
)

_SUMMARY = (
    ("worst", "root_push", min),
    ("best", "root_push", max),
    ("within limits", limited_name("root_push"), min),
    ("without a step", "root_push_no_step", min),
)
"""Columns of the summary: words, the scenario, and which of its directions."""


def direction_table(name: str, thresholds: Sequence[Threshold], robot: Robot, pose: np.ndarray) -> Table:
    """Pushes of one policy at the robot's root, a row per direction."""
    pushes = root_pushes(thresholds)
    limited = by_scenario(thresholds).get(limited_name("root_push"), {})
    bounds = capture_point_bound(robot, pose, [t.line.angle for t in pushes.values()])
    rows = [
        [
            t.line.name,
            f"{limited[t.line.name].size:g}" if t.line.name in limited else "",
            f"{t.size:g}",
            f"{t.size / robot.mass:.2f}",
            f"{t.recovered}/{t.trials}",
            f"{t.low:.2f} to {t.high:.2f}",
            f"{bound:.0f}",
        ]
        for t, bound in zip(pushes.values(), bounds, strict=True)
    ]
    columns = [
        "direction",
        "within limits [Ns]",
        "any [Ns]",
        "[Ns/kg]",
        "recovered",
        "Wilson 95 %",
        f"{paper.NO_STEP_BOUND} [Ns]",
    ]
    return Table(f"Rejected impulse at the {root_words(robot)}: {name}", columns, rows, LIMITS_NOTE)


def scenario_table(name: str, thresholds: Sequence[Threshold], robot: Robot) -> Table:
    """Every searched scenario of one policy: worst and best direction."""
    rows = []
    for scenario, lines in by_scenario(thresholds).items():
        worst, best = (choose(lines.values(), key=lambda t: t.size) for choose in (min, max))
        rows.append(
            [
                readable_name(scenario, robot.root),
                f"{worst.size:g} ({worst.line.name})",
                f"{best.size:g} ({best.line.name})",
                worst.line.scenario.unit,
                f"{worst.recovered}/{worst.trials}",
                f"{worst.low:.2f} to {worst.high:.2f}",
            ]
        )
    columns = ["scenario", "worst", "best", "unit", "recovered", "Wilson 95 %"]
    return Table(f"Largest recovered disturbance: {name}", columns, rows, "Recovered: trials in the worst direction.")


def worst_table(policies: Mapping[str, Sequence[Threshold]], robot: Robot) -> Table:
    """The worst direction of every searched scenario of the paper, within limits and any: two rows per agent."""
    found = {name: by_scenario(thresholds) for name, thresholds in policies.items()}
    searched = [s for s in PAPER if s.search and any(s.name in of_one for of_one in found.values())]
    rows = []
    for name, of_one in found.items():
        for words, named in (("within limits", limited_name), ("any", str)):
            worst = [min((t.size for t in of_one.get(named(s.name), {}).values()), default=None) for s in searched]
            if any(size is not None for size in worst):
                rows.append([name, words, *("" if size is None else f"{size:g}" for size in worst)])
    columns = ["", "joint speeds", *(f"{scenario_words(s.name, robot)} [{s.unit}]" for s in searched)]
    note = f"Each value is the largest that holds in every tested direction. {LIMITS_NOTE}"
    return Table("The worst direction of every scenario", columns, rows, note)


def summary_table(policies: Mapping[Measured, Sequence[Threshold]]) -> Table:
    """The hardest pushes that each policy survives, one short row each: the paper's robot first, the strongest first.

    Another engine has a column. If there are several robots, the worst direction also stands per mass.
    """
    every = {key: by_scenario(thresholds) for key, thresholds in policies.items()}
    found = {key: of_one for key, of_one in every.items() if "root_push" in of_one and key.engine == DEFAULT_ENGINE}
    engines = [engine for engine in dict.fromkeys(key.engine for key in every) if engine != DEFAULT_ENGINE]
    names = {key.robot for key in found}
    robots = {name: load_robot(name) for name in names} if len(names) > 1 else {}
    num_directions = max((len(of_one["root_push"]) for of_one in found.values()), default=0)
    shown = {
        words: {key: _extreme(of_one, scenario, choose, num_directions) for key, of_one in found.items()}
        for words, scenario, choose in _SUMMARY
    }
    for engine in engines:
        there = {key: every.get(key._replace(engine=engine), {}) for key in found}
        shown[f"in {engine}"] = {key: _extreme(of, "root_push", min, num_directions) for key, of in there.items()}
    worst = {key: min(t.size for t in of_one["root_push"].values()) for key, of_one in found.items()}
    if robots:
        shown["worst [Ns/kg]"] = {key: f"{size / robots[key.robot].mass:.2f}" for key, size in worst.items()}
    shown = {words: cells for words, cells in shown.items() if any(cells.values())}
    order = sorted(found, key=lambda key: (bool(_robot_words(key.robot, robots)), key.robot, -worst[key]))
    rows = [[key.name + _robot_words(key.robot, robots), *(cells[key] for cells in shown.values())] for key in order]
    note = f"Values in Ns over {num_directions} directions; any other number of directions is given in brackets."
    return Table("Hardest push that each policy survives", ["", *shown], rows, note)


def _robot_words(name: str, robots: Mapping[str, Robot]) -> str:
    """What follows the name of a policy whose robot is not the paper's; nothing if all have the same robot."""
    robot = robots.get(name)
    return "" if robot is None or robot.is_of_the_paper else f" ({name}, {robot.mass:.0f} kg)"


def _extreme(of_one: Mapping[str, Mapping[str, Threshold]], scenario: str, choose: Any, num_directions: int) -> str:
    """The size of a scenario's worst or best direction, with their number if it is not the usual one."""
    lines = of_one.get(scenario, {})
    if not lines:
        return ""
    size = f"{choose(t.size for t in lines.values()):g}"
    return size if len(lines) == num_directions else f"{size} ({len(lines)})"


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
            row = paper.algorithm_row(algorithm)
            cells = [algorithm, str(len(several))]
            for plane, names in (("sagittal", SAGITTAL), ("lateral", LATERAL)):
                sizes = [worse_of(pushes, names).size for pushes in several]
                cells += [f"{np.median(sizes):g}", f"{min(sizes):g} to {max(sizes):g}"]
                cells.append(f"{getattr(row, plane):g}" if row else "")
            rows.append(cells)
    columns = ["algorithm", "seeds", "sagittal", "range", "paper", "lateral", "range", "paper"]
    return Table("Over seeds: rejected impulse [Ns]", columns, rows, "Median over seeds for the worse direction.")
