"""Policy tables: all tables of one policy's results, in the order in which they are printed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from surefoot.evaluation.outcome import Outcome
from surefoot.evaluation.protocol import protocol_for
from surefoot.evaluation.scenarios import direction_of
from surefoot.evaluation.threshold_search import Threshold
from surefoot.report import paper
from surefoot.report.paper_tables import has_table_4, table_1, table_2, table_3, table_4, table_5
from surefoot.report.table import Table
from surefoot.report.threshold_tables import direction_table, scenario_table
from surefoot.report.thresholds import Fixed, by_scenario, has_main_directions, root_pushes
from surefoot.robots import Robot
from surefoot.task.agent import Agent


def all_tables(
    policy: Agent, thresholds: Sequence[Threshold], fixed: Fixed, steps: Mapping[str, float], robot: Robot
) -> list[Table]:
    """Every table that one policy's results fill; `steps` as for `table_3`."""
    found = by_scenario(thresholds)
    found_tables: list[Table] = []
    if "root_push" in found:
        found_tables.append(direction_table(policy.name, thresholds, robot, np.array(policy.contract.nominal_pose)))
    if robot.is_of_the_paper:
        found_tables += _tables_of_the_paper(policy, thresholds, fixed, steps)
    found_tables += [fixed_table(fixed, robot), quiet_table(fixed)]
    if set(found) != {"root_push"}:
        found_tables.append(scenario_table(policy.name, thresholds, robot))
    return [table for table in found_tables if table.rows]


def _tables_of_the_paper(
    policy: Agent, thresholds: Sequence[Threshold], fixed: Fixed, steps: Mapping[str, float]
) -> list[Table]:
    """The paper's tables I to V, with its figures beside those of a policy for its robot."""
    robot, found_tables = policy.robot, []
    if has_main_directions(root_pushes(thresholds)):
        found_tables.append(table_1({policy.contract.training.get("algorithm", policy.name): thresholds}, robot))
    found_tables += [table_2(fixed), table_3(thresholds, robot, steps)]
    if has_table_4(policy.name, thresholds):
        found_tables.append(table_4({policy.name: thresholds}, robot))
    return [*found_tables, *table_5(fixed, robot)]


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
        rows.append([scenario.replace("_", " "), f"{len(stood)}/{len(outcomes)}", *values])
    columns = ["", "recovered", "CoM drift [cm]", "mean power [W]", "steps"]
    return Table("Quiet standing", columns, rows, "Largest drift and power, and all steps, in the recovered trials.")


def fixed_table(fixed: Fixed, robot: Robot) -> Table:
    """The scenarios in which nothing is searched, a row per direction, without those that have tables of their own."""
    elsewhere = {*paper.TABLE_2, *paper.TABLE_5} if robot.is_of_the_paper else set()
    protocol = protocol_for(robot)
    rows = []
    for scenario, trials in fixed.items():
        if scenario in elsewhere or scenario.startswith("quiet"):
            continue
        by_direction: dict[str, list[Outcome]] = {}
        for trial, outcome in trials.items():
            by_direction.setdefault(direction_of(trial.push), []).append(outcome)
        for direction, outcomes in by_direction.items():
            up = [o for o in outcomes if o.recovered]
            counts = (
                len(up),
                sum(o.is_without_step(protocol.step_length) for o in up),
                sum(o.is_within_limits(protocol.speed_share) for o in up),
            )
            shown = [f"{count}/{len(outcomes)}" for count in counts]
            rows.append([scenario, direction, *shown, f"{np.median([o.steps for o in outcomes]):g}"])
    columns = ["scenario", "direction", "recovered", "without a step", "within limits", "steps"]
    return Table("Fixed disturbances", columns, rows, "Trials that recovered, of all. Steps: median over all trials.")
