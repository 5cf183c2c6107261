"""surefoot evaluate: find how hard a push a policy or a controller survives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import tyro
from rich.console import Console

from surefoot.cli.terminal import evaluation_bar, results_console, write_json
from surefoot.errors import UserError

if TYPE_CHECKING:
    from surefoot.evaluation.scenarios import Scenario


@dataclass(frozen=True)
class Evaluate:
    """Find how hard a push a policy survives, by the one definition of success (docs/method.md)."""

    policy: Annotated[str, tyro.conf.Positional]
    """A shipped policy's name, a policy file (.onnx), a run folder, or "nominal": the nominal pose held by the joint
    impedance alone. A controller: controllers/NAME (docs/controllers.md), or FILE.py:CLASS of your own
    (docs/your-controller.md)."""
    suite: str = "push"
    """push (pushes at the floating body, such as the pelvis), paper (everything that the paper tests), robustness
    (beyond the paper), or a scenario file (.toml, docs/scenarios.md)."""
    directions: int = 4
    """Number of directions of these pushes, evenly spaced."""
    results: Path = Path("results.sqlite")
    """Results table (SQLite); trials that are in it already are not run again."""
    json: str | None = None
    """Write the figures as one flat JSON object to this file; - for standard output."""
    export: Path | None = None
    """Write all trials of the results table to this .csv or .parquet file."""
    export_thresholds: Path | None = None
    """Write all thresholds of the results table to this .csv or .parquet file."""

    def main(self) -> None:
        from surefoot.evaluation.results import Results
        from surefoot.evaluation.results_export import check_export

        if self.directions < 4 or self.directions % 4:
            raise UserError(f"directions must be a multiple of 4, not {self.directions}")
        for file in (self.export, self.export_thresholds):
            if file:
                check_export(file)
        scenarios = chosen_scenarios(self.suite, self.directions)
        output = results_console(self.json)
        figures = evaluate_policy(self.policy, scenarios, self.results, output, self.export_thresholds)
        if self.export:
            with Results(self.results) as results:
                results.export("trials", self.export)
        if self.json:
            write_json(figures, self.json)


def evaluate_policy(
    name: str, scenarios: Sequence[Scenario], path: Path, output: Console, export: Path | None = None
) -> dict[str, float]:
    """Run, print and keep some scenarios of one policy; returns its flat figures."""
    from surefoot.agents.controllers import load_agent
    from surefoot.agents.controllers.controller import ControllerAgent
    from surefoot.evaluation.evaluate import evaluate_and_store
    from surefoot.evaluation.results import Results, key_of
    from surefoot.report import metrics as figures
    from surefoot.report import tables
    from surefoot.report import targets as goals
    from surefoot.report.step_timing import measure, timing_figures, timing_table
    from surefoot.robots import load_robot

    policy = load_agent(name)
    robot, pose = load_robot(policy.contract.robot), np.array(policy.contract.nominal_pose)
    with Results(path) as results:
        with evaluation_bar(sum(len(scenario.lines()) for scenario in scenarios)) as show:
            done = evaluate_and_store(policy, scenarios, results, show)
        if isinstance(policy, ControllerAgent) and policy.times.num_steps:
            results.add_timing(policy, measure(policy))
        timing = results.timing(key_of(policy))
        if export:
            results.export("thresholds", export)
        fixed = results.fixed_outcomes(policy.name)
        found = figures.flat_metrics(done.thresholds, fixed, results.audit(policy), robot, pose, done.wall_s)
    steps = tables.median_steps(done.thresholds, done.store)
    lines = goals.targets_table(policy.name, policy.contract.training.get("algorithm", ""), found)
    for table in (*tables.all_tables(policy, done.thresholds, fixed, steps, robot), lines):
        if table.rows:  # a scenario file may have none of the lines to beat
            output.print(table.rich())
    if timing:
        output.print(timing_table({policy.name: timing}).rich())
        found |= timing_figures(timing)
    return found


def chosen_scenarios(suite_name: str, num_directions: int) -> list[Scenario]:
    """The scenarios of a suite, with so many directions of the pushes at the floating body.

    Raises:
        UserError: there is no such suite.
    """
    from surefoot.evaluation.scenario_file import suite
    from surefoot.evaluation.scenarios import Scenario
    from surefoot.robots import load_robot

    root = Scenario("root_push", directions=num_directions)
    if suite_name == "push":
        return [root]
    return [root if scenario == Scenario("root_push") else scenario for scenario in suite(suite_name, load_robot())]
