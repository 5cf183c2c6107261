"""Commands that test: evaluate, replay, table, bench."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
import tyro
from rich.console import Console

from surefoot.cli.terminal import check_positive, console, evaluation_bar, needs_torch, results_console, write_json
from surefoot.errors import UserError

if TYPE_CHECKING:
    from surefoot.agents.agent import Policy
    from surefoot.agents.controllers.controller import ControllerAgent
    from surefoot.evaluation.scenarios import Scenario
    from surefoot.evaluation.trials import Trial


@dataclass(frozen=True)
class Evaluate:
    """Find how hard a push a policy survives, by the one definition of success (docs/method.md)."""

    policy: Annotated[str, tyro.conf.Positional]
    """A shipped policy's name, a policy file (.onnx), a run folder, or "nominal": the nominal pose held by the joint
    impedance alone. A controller: controllers/NAME (docs/controllers.md), or FILE.py:CLASS of your own
    (docs/your-controller.md)."""
    suite: str = "root"
    """root (pushes at the root), paper (everything that the paper tests), robustness (beyond the paper), or a
    scenario file (.toml, docs/scenarios.md)."""
    directions: int = 4
    """Number of directions of the pushes at the root, evenly spaced."""
    results: Path = Path("results.sqlite")
    """Results table (SQLite); trials that are in it already are not run again."""
    json: str | None = None
    """Write the figures as one flat JSON object to this file; - for standard output."""
    export: Path | None = None
    """Write all trials of the results table to this .csv or .parquet file."""
    export_thresholds: Path | None = None
    """Write all thresholds of the results table to this .csv or .parquet file."""

    def main(self) -> None:
        from surefoot.evaluation.results import Results, check_export

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


@dataclass(frozen=True)
class Replay:
    """Run one trial of a results table again, bit for bit, and compare its outcome with the stored one.

    Exit code 1 if anything differs. The same bits are promised on the same kind of machine: another processor may
    round otherwise.
    """

    results: Annotated[Path, tyro.conf.Positional]
    """Results table (SQLite) of `surefoot evaluate`."""
    row: Annotated[int, tyro.conf.Positional]
    """Column `id` of its table `trials`; `surefoot evaluate --export` writes it out."""
    policy: str | None = None
    """A shipped policy, a policy file, a run folder or a controller; without it, the policy is looked for by its digest
    among the shipped ones and in runs/, a controller by its name."""
    video: Path | None = None
    """Film of the trial, .mp4 or .gif."""
    picture: Path | None = None
    """Film strip of the trial, .png or .jpg."""

    def main(self) -> None:
        from surefoot.evaluation import replay
        from surefoot.evaluation.results import open_results

        with open_results(self.results) as results:
            row = results.row(self.row)
        policy = replay.find_policy(row.policy_name, row.policy, self.policy)
        replay.check_setup(row.setup, policy.contract.robot, f"row {self.row} of {self.results}")
        outcome = replay.replay(row, policy)
        found = replay.differences(row.outcome, outcome)
        output = Console(soft_wrap=True, highlight=False, markup=False)
        output.print(f"{row.policy_name}, {row.scenario}, row {self.row}: {outcome.reason}, {outcome.seconds:.2f} s")
        for name, old, new in found:
            output.print(f"  {name}: stored {old}, now {new}")
        output.print("different" if found else "identical")
        self._show(policy, row.trial, output)
        if found:
            sys.exit(1)

    def _show(self, policy: Policy | ControllerAgent, trial: Trial, output: Console) -> None:
        if not (self.video or self.picture):
            return
        from surefoot.rendering.film import save_video
        from surefoot.rendering.image_files import save_picture
        from surefoot.rendering.recording import record
        from surefoot.rendering.strip import filmstrip

        recording = record(policy, trial)
        if self.video:
            save_video(self.video, recording)
            output.print(f"video: {self.video}")
        if self.picture:
            save_picture(self.picture, filmstrip([recording]))
            output.print(f"picture: {self.picture}")


@dataclass(frozen=True)
class Table:
    """Print a table of exported thresholds, for a terminal or a page."""

    thresholds: Annotated[Path, tyro.conf.Positional]
    """A .csv file that `surefoot evaluate --export-thresholds` wrote."""
    show: Literal["main", "worst", "seeds"] = "main"
    """main: Table I beside the paper's. worst: the worst direction of every scenario. seeds: median and range over the
    policies that one algorithm learned, which are named ALGORITHM-SEED."""
    markdown: bool = False
    """As Markdown instead of a drawn table."""

    def main(self) -> None:
        from surefoot.evaluation.results import read_thresholds
        from surefoot.report import tables
        from surefoot.robots.robot import load_robot

        policies = read_thresholds(self.thresholds)
        if self.show == "seeds":
            table = tables.seeds_table((name.rsplit("-", 1)[0], found) for name, found in policies.items())
        elif self.show == "worst":
            table = tables.worst_table(policies)
        else:
            table = tables.table_1(policies, load_robot())
        if self.markdown:
            sys.stdout.write(table.markdown())
        else:
            Console().print(table.rich())


@dataclass(frozen=True)
class Bench:
    """Measure the speed of every layer, as ratios in one run."""

    seconds: float = 20.0
    """Time for each ratio."""
    json: str | None = None
    """Write the figures as one flat JSON object to this file; - for standard output."""

    def main(self) -> None:
        check_positive("seconds", self.seconds)
        with needs_torch():
            import torch  # noqa: F401
        from surefoot.cli.benchmarks import bench_table, run_bench

        with console.status("measuring") as status:
            figures = run_bench(self.seconds, lambda stage: status.update(f"measuring {stage}"))
        results_console(self.json).print(bench_table(figures))
        if self.json:
            write_json(figures, self.json)


def evaluate_policy(
    name: str, scenarios: Sequence[Scenario], path: Path, output: Console, export: Path | None = None
) -> dict[str, float]:
    """Run, print and keep some scenarios of one policy; returns its flat figures."""
    from surefoot.agents.controllers import load_agent
    from surefoot.agents.controllers.controller import ControllerAgent
    from surefoot.evaluation.evaluate import run_scenarios
    from surefoot.evaluation.results import Results, setup_digest
    from surefoot.report import metrics as figures
    from surefoot.report import tables
    from surefoot.report import targets as goals
    from surefoot.report.step_timing import measure, timing_figures, timing_table
    from surefoot.robots.robot import load_robot

    policy = load_agent(name)
    robot, pose = load_robot(policy.contract.robot), np.array(policy.contract.nominal_pose)
    began = time.monotonic()
    with Results(path) as results:
        store = results.trials_of(policy)
        with evaluation_bar(sum(len(scenario.lines()) for scenario in scenarios)) as show:
            thresholds = run_scenarios(policy, scenarios, store, show)
        wall_s = time.monotonic() - began
        results.add_thresholds(policy, thresholds)
        results.add_scenarios(policy, scenarios, wall_s)
        if isinstance(policy, ControllerAgent) and policy.times.num_steps:
            results.add_timing(policy, measure(policy))
        timing = results.timing((policy.digest, setup_digest(robot.name)))
        if export:
            results.export("thresholds", export)
        fixed = results.fixed_outcomes(policy.name)
        found = figures.flat_metrics(thresholds, fixed, results.audit(policy), robot, pose, wall_s)
    steps = tables.median_steps(thresholds, store)
    lines = goals.targets_table(policy.name, policy.contract.training.get("algorithm", ""), found)
    for table in (*tables.all_tables(policy, thresholds, fixed, steps, robot), lines):
        if table.rows:  # a scenario file may have none of the lines to beat
            output.print(table.rich())
    if timing:
        output.print(timing_table({policy.name: timing}).rich())
        found |= timing_figures(timing)
    return found


def chosen_scenarios(suite_name: str, num_directions: int) -> list[Scenario]:
    from surefoot.evaluation.scenario_file import suite
    from surefoot.evaluation.scenarios import Scenario

    root = Scenario("root_push", directions=num_directions)
    if suite_name == "root":
        return [root]
    return [root if scenario == Scenario("root_push") else scenario for scenario in suite(suite_name)]
