"""Page tables: the tables of the report that compare policies, and those of a single policy and its trials."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from surefoot.evaluation.scenarios import DIRECTIONS
from surefoot.evaluation.suites import NOISE, ROBUSTNESS
from surefoot.evaluation.threshold_search import Threshold
from surefoot.report import paper
from surefoot.report.engine_table import engine_table
from surefoot.report.evaluations import Evaluation, has_several_robots, of_first_robot
from surefoot.report.metrics import share_kept
from surefoot.report.paper_tables import has_table_4, published_table, table_1, table_2, table_3, table_4, table_5
from surefoot.report.policy_tables import fixed_table, quiet_table
from surefoot.report.ring_table import ring_table
from surefoot.report.table import Table
from surefoot.report.threshold_tables import direction_table, scenario_table, seeds_table, worst_table
from surefoot.report.thresholds import (
    LATERAL,
    SAGITTAL,
    by_scenario,
    has_main_directions,
    root_words,
    scenario_words,
    worse_of,
)
from surefoot.report.timing_table import timing_table
from surefoot.robots import Robot

_ROBUSTNESS_NAMES = {scenario.name for scenario in ROBUSTNESS}


def side_by_side(evaluations: Sequence[Evaluation]) -> list[Table]:
    """Tables I and IV, published figures, share kept and quiet standing of all policies.

    With several robots the first table sets them side by side; the others are of the first evaluation's robot.
    """
    found = []
    if has_several_robots(evaluations) or any(t.line.scenario.half for e in evaluations for t in e.thresholds):
        found.append(ring_table(evaluations))
    evaluations = of_first_robot(evaluations)
    main = {e.name: e.thresholds for e in evaluations if e.has_main_directions}
    if main:
        found.append(table_1(main, evaluations[0].robot))
    if len(evaluations) > 1:
        seeds = [(e.algorithm, e.thresholds) for e in evaluations]
        found += [worst_table({e.name: e.thresholds for e in evaluations}, evaluations[0].robot), seeds_table(seeds)]
    studied = {name: thresholds for name, thresholds in main.items() if has_table_4(name, thresholds)}
    found += [table_4(studied, evaluations[0].robot), published_table()]
    found.append(timing_table({e.name: e.timing for e in evaluations if e.timing}))
    found += [engine_table(evaluations), share_kept_table(evaluations), quiet_side_by_side(evaluations)]
    return [table for table in found if table.rows]


def of_policy(evaluation: Evaluation) -> list[Table]:
    """Every table of one policy, in the order of the page."""
    e, robot = evaluation, evaluation.robot
    pose = np.array(e.contract.nominal_pose)
    others = [t for t in e.thresholds if t.line.scenario.name not in _ROBUSTNESS_NAMES]
    found = [direction_table(e.name, e.thresholds, robot, pose)]
    found += [table_2(e.fixed), table_3(e.thresholds, robot, e.steps), *table_5(e.fixed, robot)]
    found += [limits_table(e.thresholds), scenario_table(e.name, others, robot), robustness_table(e.thresholds, robot)]
    found += [fixed_table(e.fixed, robot), quiet_table(e.fixed), audit_table(e)]
    return [table for table in found if table.rows]


def share_kept_table(evaluations: Sequence[Evaluation]) -> Table:
    """The kept share of the rejected impulse under noise and beyond the paper, a row per scenario."""
    rows = []
    for name in [*NOISE, *(s.name for s in ROBUSTNESS)]:
        shares = [_share(e, name) for e in evaluations]
        if any(shares):
            rows.append([_words(name), *shares])
    note = (
        "Ratio of the rejected impulse under this condition to the undisturbed one, at most 100 %, as the mean over the"
        " directions. The paper says that its policy handles the noise, but gives no number."
    )
    return Table("Share kept of the rejected impulse", ["condition", *(e.name for e in evaluations)], rows, note)


def _share(evaluation: Evaluation, name: str) -> str:
    found = by_scenario(evaluation.thresholds)
    clean, disturbed = found.get("root_push", {}), found.get(name, {})
    if not disturbed or not disturbed.keys() <= clean.keys():
        return ""
    return f"{share_kept(clean, disturbed):.0%}"


def quiet_side_by_side(evaluations: Sequence[Evaluation]) -> Table:
    """Quiet standing of all policies, 60 s undisturbed."""
    rows = []
    for e in evaluations:
        table = quiet_table(e.fixed)
        rows += [[e.name, *row] for row in table.rows]
    blank = quiet_table({})
    return Table("Quiet standing, side by side", ["policy", "case", *blank.columns[1:]], rows, blank.note)


def limits_table(thresholds: Sequence[Threshold]) -> Table:
    """The paper's single figures of section V: landing, lift and push, the largest push without a step."""
    found = by_scenario(thresholds)
    rows = []
    for scenario, directions, words, theirs in (
        ("root_push_no_step", SAGITTAL, "without a step, sagittal", paper.WITHOUT_STEP.sagittal),
        ("root_push_no_step", LATERAL, "without a step, lateral", paper.WITHOUT_STEP.lateral),
        ("landing_height", None, "drop height", paper.LANDING_HEIGHT),
        ("landing_tilt", None, "tilt, dropped from 0.4 m", paper.LANDING_TILT),
        ("combined", None, "push after a lift of 500 Ns", paper.COMBINED[1]),
    ):
        lines = found.get(scenario, {})
        if lines and (directions is None or has_main_directions(lines)):
            worst = worse_of(lines, directions or list(lines))
            rows.append([words, f"{worst.size:g}", f"{theirs:g}", worst.line.scenario.unit, *_interval(worst)])
    columns = ["", "ours", "paper", "unit", "recovered", "Wilson 95 %"]
    return Table("Without a step, landing, combined", columns, rows, "Our values are those of the worst direction.")


def robustness_table(thresholds: Sequence[Threshold], robot: Robot) -> Table:
    """The suite `robustness`: a row per scenario, with what is kept of the undisturbed thresholds."""
    found = by_scenario(thresholds)
    clean = found.get("root_push", {})
    rows = []
    for scenario in ROBUSTNESS:
        lines = found.get(scenario.name)
        if not lines:
            continue
        worst = worse_of(lines, list(lines))
        kept = f"{share_kept(clean, lines):.0%}" if lines.keys() <= clean.keys() else ""
        sizes = [f"{lines[d].size:g}" if d in lines else "" for d in DIRECTIONS]
        rows.append([_words(scenario.name), *sizes, kept, *_interval(worst)])
    columns = ["condition", *DIRECTIONS, "kept", "recovered", "Wilson 95 %"]
    at = root_words(robot)
    note = f"Rejected impulse at the {at} [Ns]. Kept: share of the undisturbed. Recovered: in the worst direction."
    return Table("Beyond the paper: robustness", columns, rows, note)


def audit_table(evaluation: Evaluation) -> Table:
    """Joint limits: every trial of every scenario, how it ended and what it used of the joints' limits."""
    counts = ("trials", "recovered", "fell", "restless", "tilted", "diverged", "controller")
    shares = ("torque_recovered", "speed_recovered", "torque", "speed")
    rows = [
        [
            scenario_words(row["scenario"], evaluation.robot),
            *(str(row[key]) for key in counts),
            *("" if row[key] is None else f"{row[key]:.2f}" for key in shares),
        ]
        for row in evaluation.audit
    ]
    columns = ["scenario", *counts, "torque", "speed", "torque, all", "speed, all"]
    note = (
        "The table counts every trial that was run; most are near the threshold. A trial that two scenarios share is"
        " counted in the first. Controller: the controller itself failed. Torque and speed: largest share of a joint's"
        " limit in a recovered trial, and in any trial including falls. Torques never exceed their limits. Joint speeds"
        " can, when a push or an impact drives the joint."
    )
    return Table("Use of the joints' limits", columns, rows, note)


def versions_table(evaluations: Sequence[Evaluation]) -> Table:
    """Where the figures come from."""
    rows = []
    for e in evaluations:
        training = e.contract.training
        learned = ", ".join(
            [
                f"{training[key]}" if key in ("algorithm", "preset") else f"{key.replace('_', ' ')} {training[key]}"
                for key in ("algorithm", "preset", "seed", "policy_steps", "minutes")
                if key in training
            ]
        )
        trials = sum(row["trials"] for row in e.audit)
        setup = e.key.setup
        robot = f"{setup.robot} {setup.robot_fingerprint[:18]}"
        rows.append(
            [
                e.name,
                e.key.agent[:12],
                f"{setup.protocol or 'older'}",
                robot,
                e.versions,
                learned or "not learned",
                f"{trials}",
                f"{e.wall_s / 60:.1f}",
            ]
        )
    columns = ["policy", "digest", "protocol", "robot", "versions", "learning", "trials", "evaluation [min]"]
    note = "Digest: SHA-256 of the policy, first 12 digits. Robot: its name and a fingerprint of its physical facts."
    return Table("Versions and digests", columns, rows, note)


def _interval(threshold: Threshold) -> list[str]:
    if not threshold.trials:  # not even the smallest cell holds
        return ["", ""]
    return [f"{threshold.recovered}/{threshold.trials}", f"{threshold.low:.2f} to {threshold.high:.2f}"]


def _words(name: str) -> str:
    return name.replace("_", " ")
