"""surefoot evaluate: find how hard a push a policy or a controller survives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import tyro
from rich.console import Console

from surefoot.cli.terminal import chosen_robot, evaluation_bar, results_console, say, write_json
from surefoot.cli.work import Work
from surefoot.errors import UserError

if TYPE_CHECKING:
    from surefoot.agents.controllers.step_times import Timing
    from surefoot.evaluation.evaluate import Evaluated
    from surefoot.evaluation.scenarios import Scenario
    from surefoot.executors import Executor
    from surefoot.report.thresholds import Fixed
    from surefoot.robots import Robot
    from surefoot.task.agent import Agent


@dataclass(frozen=True)
class Evaluate(Work):
    """Find how hard a push a policy survives, by the one definition of success (surefoot docs method)."""

    policy: Annotated[str, tyro.conf.Positional]
    """A shipped policy's name, a policy file (.onnx), a run folder, or "nominal" (the joint impedance alone holds the
    nominal pose). Also a controller: controllers/NAME (surefoot docs controllers), or your own FILE.py:CLASS
    (surefoot docs your-controller)."""
    suite: str = "push"
    """push (pushes at the floating body, the robot's root), paper (all tests of the paper), robustness (tests beyond
    the paper), ring (for any robot and any policy), or a scenario file (surefoot docs scenarios)."""
    directions: int | None = None
    """Number of directions of the pushes at the root, evenly spaced; the default is 4. In the suite ring it is
    the number for all pushes; the default is 16."""
    robot: str = ""
    """The robot of a controller or of "nominal": a shipped robot's name, or a description (.toml, surefoot docs
    your-robot). The default is the shipped policies' robot."""
    engine: str = "mujoco"
    """The physics engine: mujoco, or pybullet (needs the extra pybullet; no policy was trained in it)."""
    results: Path = Path("results.sqlite")
    """Results table (SQLite); trials already in it are not run again."""
    json: str | None = None
    """Write the figures as one flat JSON object to this file; - means standard output."""
    export: Path | None = None
    """Write all trials of the results table to this .csv or .parquet file."""
    export_thresholds: Path | None = None
    """Write all thresholds of the results table to this .csv or .parquet file."""

    def main(self) -> None:
        """Evaluate, print and write."""
        from surefoot.agents.load import load_agent
        from surefoot.evaluation.results import Results
        from surefoot.evaluation.results_export import check_export
        from surefoot.physics.engines import engine_kind

        if self.directions is not None and (self.directions < 4 or self.directions % 4):
            raise UserError(f"directions must be a multiple of 4, not {self.directions}")
        engine_kind(self.engine).title()  # is it there?
        for file in (self.export, self.export_thresholds):
            if file:
                check_export(file)
        agent = load_agent(self.policy, chosen_robot(self.robot))
        scenarios = chosen_scenarios(self.suite, self.directions, agent.robot)
        output = results_console(self.json)
        export, engine = self.export_thresholds, self.engine
        with self.opened() as executor:
            metrics = evaluate_agent(agent, scenarios, self.results, output, export, engine=engine, executor=executor)
        if self.export:
            with Results(self.results) as results:
                results.export("trials", self.export)
        if self.json:
            write_json(metrics, self.json)


def evaluate_agent(
    agent: Agent,
    scenarios: Sequence[Scenario],
    path: Path,
    output: Console,
    export: Path | None = None,
    learned_minutes: float | None = None,
    engine: str = "mujoco",
    executor: Executor | None = None,
) -> dict[str, float]:
    """Run, print and keep some scenarios of one agent.

    Args:
        agent: a policy or a controller.
        scenarios: what is run.
        path: of the results table.
        output: where the tables are printed.
        export: a file for all thresholds of the results table.
        learned_minutes: of a policy that has only begun to learn: it is set beside others of that age, and not beside
            the lines to beat.
        engine: name of the physics engine.
        executor: executor of the trials. The default is this process.

    Returns:
        Its metrics.
    """
    from surefoot.agents.controllers.controller import ControllerAgent
    from surefoot.evaluation.evaluate import evaluate_and_store
    from surefoot.evaluation.results import Results
    from surefoot.evaluation.step_timing import measure
    from surefoot.report.metrics import flat_metrics
    from surefoot.report.timing_table import timing_metrics

    robot, pose = agent.robot, np.array(agent.contract.nominal_pose)
    with Results(path, engine) as results:
        with evaluation_bar(sum(len(scenario.lines()) for scenario in scenarios)) as show:
            done = evaluate_and_store(agent, scenarios, results, show, executor)
        controller = ControllerAgent.among(agent)
        if controller and controller.times.num_steps:
            results.add_timing(agent, measure(controller))
        timing = results.timing(results.key_of(agent))
        if export:
            results.export("thresholds", export)
        fixed = results.fixed_outcomes(agent.name, robot=robot.name)
        metrics = flat_metrics(done.thresholds, fixed, results.audit(agent), robot, pose, done.wall_s)
    if timing:
        metrics |= timing_metrics(timing)
    _print_tables(agent, done, fixed, timing, metrics, output, learned_minutes)
    return metrics


def _print_tables(
    agent: Agent,
    done: Evaluated,
    fixed: Fixed,
    timing: Timing | None,
    metrics: dict[str, float],
    output: Console,
    learned_minutes: float | None,
) -> None:
    """Print every table that an evaluation fills, and what it reaches of the targets."""
    from surefoot.report.policy_tables import all_tables
    from surefoot.report.targets import first_table, targets_table
    from surefoot.report.thresholds import median_steps
    from surefoot.report.timing_table import timing_table

    steps, robot = median_steps(done.thresholds, done.store), agent.robot
    tables = all_tables(agent, done.thresholds, fixed, steps, robot)
    algorithm = agent.contract.training.get("algorithm", "")
    if learned_minutes is None:
        tables.append(targets_table(agent.name, algorithm, metrics, robot))
    else:
        tables.append(first_table(agent.name, algorithm, learned_minutes, metrics))
    if timing:
        tables.append(timing_table({agent.name: timing}))
    for table in tables:
        if table.rows:  # a scenario file may have none of the lines that are aimed at
            output.print(table.rich())


def chosen_scenarios(suite_name: str, num_directions: int | None, robot: Robot) -> list[Scenario]:
    """The scenarios of a suite for a robot, with so many directions of the pushes at the floating body.

    In the suite ring, all pushes have as many. Without a number, each suite has its usual one.

    Every scenario that is searched comes twice: as it is, and within the joints' limits.

    Raises:
        UserError: there is no such suite.
    """
    from surefoot.evaluation import evaluate as evaluation

    if suite_name == robot.root:  # the suite's name until version 0.1
        say(f"--suite {suite_name} is now called --suite push")
        suite_name = "push"
    return evaluation.chosen_scenarios(suite_name, num_directions, robot)
