"""surefoot: learn, test and ship push-recovery policies for humanoid robots."""

from __future__ import annotations

import contextlib
import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import tyro
from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from surefoot.errors import UserError
from surefoot.viewer.commands import Picture, Play, Video

if TYPE_CHECKING:
    from surefoot.scenarios import Scenario

DEMO_MARK = ".surefoot-demo"
"""An empty file by which a demo knows a folder as its own."""

console = Console(stderr=True)
"""Everything but the results goes to standard error."""


@dataclass(frozen=True)
class Train:
    """Learn a policy. Ctrl-C stops a run; --resume takes it up again."""

    algorithm: str = "trpo"
    """trpo, ppo or ddpg."""
    preset: str = "fast"
    """fast (a quarter of an hour on a laptop), gentle (a few minutes, smaller pushes) or paper (the paper's
    hyperparameters, pose and pushes)."""
    run: Path | None = None
    """Folder of the run; runs/PRESET-ALGORITHM-SEED without it."""
    minutes: float | None = None
    """Wall-clock budget; the preset's without it."""
    steps: int | None = None
    """Budget in policy steps; the run ends with the first budget that is used up."""
    seed: int = 0
    """Seed of everything random."""
    resume: Path | None = None
    """Go on with the run in this folder instead of starting one."""

    def main(self) -> None:
        with _needs_torch():
            from surefoot.learning.config import preset
            from surefoot.learning.run_folder import RunFolder
            from surefoot.learning.train import train, with_budget
        _positive("minutes", self.minutes)
        _positive("steps", self.steps)
        _not_negative("seed", self.seed)
        if self.resume is None:
            config = with_budget(preset(self.preset, self.algorithm), self.minutes, self.steps, self.seed)
            folder = self.run or Path("runs") / f"{config.preset}-{config.algorithm}-{config.seed}"
        else:
            config, folder = RunFolder(self.resume).config(), self.resume
            config = with_budget(config, self.minutes, self.steps, config.seed)
        console.print(f"learning with {config.algorithm} for {config.minutes:g} minutes in {folder}")
        console.print("the bar ends with the impulses about rejected now: forward/left/backward/right")
        try:
            with _training_bar() as show:
                train(config, folder, self.resume is not None, show)
        except KeyboardInterrupt:
            console.print(f"interrupted; go on with: surefoot train --resume {folder}")
            raise
        console.print(f"the best policy is {folder}/best.onnx; test it with: surefoot evaluate {folder}")


@dataclass(frozen=True)
class Evaluate:
    """Find how hard a push a policy survives, by the one definition of success (docs/method.md)."""

    policy: Annotated[str, tyro.conf.Positional]
    """A shipped policy's name, a policy file (.onnx), a run folder, or "nominal": the nominal pose held by the joint
    impedance alone."""
    suite: str = "pelvis"
    """pelvis (pushes at the pelvis), paper (everything that the paper tests), robustness (beyond the paper), or a
    scenario file (.toml, docs/scenarios.md)."""
    directions: int = 4
    """Number of directions of the pushes at the pelvis, evenly spaced."""
    results: Path = Path("results.sqlite")
    """Results table (SQLite); trials that are in it already are not run again."""
    json: str | None = None
    """Write the figures as one flat JSON object to this file; - for standard output."""
    export: Path | None = None
    """Write all trials of the results table to this .csv or .parquet file."""
    export_thresholds: Path | None = None
    """Write all thresholds of the results table to this .csv or .parquet file."""

    def main(self) -> None:
        from surefoot.results import Results, check_export

        if self.directions < 4 or self.directions % 4:
            raise UserError(f"directions must be a multiple of 4, not {self.directions}")
        for file in (self.export, self.export_thresholds):
            if file:
                check_export(file)
        scenarios = _scenarios(self.suite, self.directions)
        output = _results_console(self.json)
        figures = evaluate_policy(self.policy, scenarios, self.results, output, self.export_thresholds)
        if self.export:
            with Results(self.results) as results:
                results.export("trials", self.export)
        if self.json:
            _write_json(figures, self.json)


@dataclass(frozen=True)
class Table:
    """Print Table I from exported thresholds, beside the paper's."""

    thresholds: Annotated[Path, tyro.conf.Positional]
    """A .csv file that `surefoot evaluate --export-thresholds` wrote."""
    markdown: bool = False
    """As Markdown instead of a drawn table."""

    def main(self) -> None:
        from surefoot import tables
        from surefoot.results import read_thresholds
        from surefoot.robot import load_robot

        policies, robot = read_thresholds(self.thresholds), load_robot()
        if self.markdown:
            sys.stdout.write(tables.table_1(policies, robot).markdown())
        else:
            Console().print(tables.table_1(policies, robot).rich())


@dataclass(frozen=True)
class Bench:
    """Measure the speed of every layer, as ratios in one run."""

    seconds: float = 20.0
    """Time for each ratio."""
    json: str | None = None
    """Write the figures as one flat JSON object to this file; - for standard output."""

    def main(self) -> None:
        _positive("seconds", self.seconds)
        with _needs_torch():
            import torch  # noqa: F401
        from surefoot.bench import bench_table, run_bench

        with console.status("measuring") as status:
            figures = run_bench(self.seconds, lambda stage: status.update(f"measuring {stage}"))
        _results_console(self.json).print(bench_table(figures))
        if self.json:
            _write_json(figures, self.json)


@dataclass(frozen=True)
class Demo:
    """The whole way in a few minutes: learn a policy, evaluate it, print the table, draw the pictures."""

    minutes: float = 3.0
    """Time for learning."""
    algorithm: str = "trpo"
    """trpo, ppo or ddpg."""
    out: Path = Path("runs/demo")
    """Folder for the run, its results and its pictures."""
    seed: int = 0
    """Seed of everything random."""

    def main(self) -> None:
        mark = self.out / DEMO_MARK
        if mark.exists():  # an earlier demo's folder; nothing else is ever removed
            for file in self.out.iterdir():
                file.unlink()
        Train(algorithm=self.algorithm, preset="gentle", run=self.out, minutes=self.minutes, seed=self.seed).main()
        mark.touch()
        pushes = _scenarios("pelvis", 4)
        evaluate_policy(str(self.out), pushes, self.out / "results.sqlite", Console(), self.out / "thresholds.csv")
        Pictures(self.out / "thresholds.csv", self.out, str(self.out), self.out).main()


@dataclass(frozen=True)
class Pictures:
    """Draw the pictures of results: bars beside the paper, polar map, learning curves, film strip."""

    thresholds: Path = Path("results/thresholds.csv")
    """A .csv file that `surefoot evaluate --export-thresholds` wrote."""
    curves: Path = Path("results/curves")
    """Folder with learning curves: ALGORITHM-SEED.csv, or the curve.csv of one run."""
    policy: str = "trpo"
    """The policy of the film strip, as for `surefoot evaluate`; it must be among the thresholds."""
    out: Path = Path("docs/pictures")
    """Folder for the pictures."""

    def main(self) -> None:
        from surefoot import pictures, plots
        from surefoot.policy import load_policy
        from surefoot.results import read_thresholds

        policies, policy = read_thresholds(self.thresholds), load_policy(self.policy)
        if policy.name not in policies:
            raise UserError(f"no thresholds of '{policy.name}' in {self.thresholds}; valid: {', '.join(policies)}")
        self.out.mkdir(parents=True, exist_ok=True)
        with console.status("drawing pictures"):
            drawn = pictures.draw_thresholds(policies, policy.robot, self.out)
            drawn.append(self.out / "curves.png")
            plots.learning_curves(_read_curves(self.curves, policy), drawn[-1])
            try:
                drawn.append(pictures.draw_strip(policy, policies[policy.name], self.out / "strip.png"))
            except UserError as error:  # a machine without OpenGL still gets the plots
                console.print(f"no film strip: {error}", markup=False, soft_wrap=True)
        for picture in drawn:
            console.print(f"picture: {picture}")


def evaluate_policy(
    name: str, scenarios: Sequence[Scenario], path: Path, output: Console, export: Path | None = None
) -> dict[str, float]:
    """Run, print and keep some scenarios of one policy; returns its flat figures."""
    from surefoot import figures, tables
    from surefoot.evaluation import run_scenarios
    from surefoot.policy import NominalPolicy, load_policy
    from surefoot.results import Results
    from surefoot.robot import load_robot

    policy = NominalPolicy() if name == "nominal" else load_policy(name)
    robot, pose = load_robot(policy.contract.robot), np.array(policy.contract.nominal_pose)
    began = time.monotonic()
    with Results(path) as results:
        store = results.trials_of(policy)
        with _evaluation_bar(sum(len(scenario.lines()) for scenario in scenarios)) as show:
            thresholds = run_scenarios(policy, scenarios, store, show)
        wall_s = time.monotonic() - began
        results.add_thresholds(policy, thresholds)
        results.add_scenarios(policy, scenarios, wall_s)
        if export:
            results.export("thresholds", export)
        fixed = results.fixed_outcomes(policy.name)
        found = figures.flat_figures(thresholds, fixed, results.audit(policy), robot, pose, wall_s)
    steps = tables.median_steps(thresholds, store)
    for table in tables.all_tables(policy, thresholds, fixed, steps, robot):
        output.print(table.rich())
    return found


COMMANDS: dict[str, Callable[..., Any]] = {
    "train": Train,
    "evaluate": Evaluate,
    "table": Table,
    "bench": Bench,
    "demo": Demo,
    "pictures": Pictures,
    "play": Play,
    "video": Video,
    "picture": Picture,
}


def main() -> None:
    """Entry point: errors that a user can mend are one line and exit code 2; Ctrl-C is 130."""
    command = tyro.extras.subcommand_cli_from_dict(COMMANDS, prog="surefoot", description=__doc__)
    try:
        command.main()
    except UserError as error:
        console.print(f"surefoot: {error}", style="red", markup=False, highlight=False, soft_wrap=True)
        sys.exit(2)
    except KeyboardInterrupt:
        sys.exit(130)


@contextlib.contextmanager
def _needs_torch() -> Iterator[None]:
    try:
        yield
    except ModuleNotFoundError as error:
        raise UserError(f"this needs {error.name}: pip install 'surefoot[learn]'") from error


@contextlib.contextmanager
def _training_bar() -> Iterator:
    """A bar with time left, steps/s, episode length, and what the last probe rejected; it fits into 80 columns."""
    columns = (SpinnerColumn(), BarColumn(bar_width=12), TextColumn("{task.fields[says]}"))
    with Progress(*columns, console=console) as bar:
        task = bar.add_task("train", total=1.0, says="starting")

        def show(progress) -> None:
            left = progress.seconds * (1.0 - progress.share) / max(progress.share, 1e-9)
            says = (
                f"{_clock(left)} left, {progress.steps / 1000:,.0f}k steps, {progress.steps_per_s:,.0f}/s, "
                f"episode {progress.episode_length / 25:.1f} s"
            )
            if progress.probe:
                says += f", {'/'.join(f'{ns:.0f}' for ns in progress.probe.main_directions().values())} Ns"
            bar.update(task, completed=progress.share, says=says)

        yield show


@contextlib.contextmanager
def _evaluation_bar(num_lines: int) -> Iterator:
    """A bar of lines done, with what is reached along each line still searched; it fits into 80 columns."""
    columns = (SpinnerColumn(), BarColumn(bar_width=12), TextColumn("{task.fields[says]}"), TimeElapsedColumn())
    with Progress(*columns, console=console) as bar:
        task = bar.add_task("evaluate", total=num_lines, says="pushing")
        before = last_done = 0

        def show(num_trials: int, num_done: int, reached: list) -> None:
            nonlocal before, last_done
            if num_done < last_done:  # the next batch of lines has begun
                before += last_done
            last_done = num_done
            sizes = " ".join(f"{size:g}" for _, size in reached[:8])
            says = f"{num_trials:,} trials, {before + num_done}/{num_lines} lines, at {sizes}"
            bar.update(task, completed=before + num_done, says=says[:56])

        yield show


def _scenarios(suite_name: str, num_directions: int) -> list[Scenario]:
    from surefoot.scenarios import Scenario, suite

    pelvis = Scenario("pelvis_push", directions=num_directions)
    if suite_name == "pelvis":
        return [pelvis]
    return [pelvis if scenario == Scenario("pelvis_push") else scenario for scenario in suite(suite_name)]


def _read_curves(folder: Path, policy: Any) -> dict[str, list[list[dict[str, float]]]]:
    from surefoot.curve import read_curve

    single = folder / "curve.csv"
    if single.exists():
        return {policy.contract.training["algorithm"]: [read_curve(single)]}
    found: dict[str, list[list[dict[str, float]]]] = {}
    for file in sorted(folder.glob("*.csv")):
        found.setdefault(file.stem.split("-")[0], []).append(read_curve(file))
    return found


def _results_console(json_path: str | None) -> Console:
    """Standard output belongs to the JSON if it is asked for there."""
    return console if json_path == "-" else Console()


def _write_json(figures: dict[str, float], path: str) -> None:
    text = json.dumps(figures, indent=2) + "\n"
    if path == "-":
        sys.stdout.write(text)
        return
    try:
        Path(path).write_text(text)
    except OSError as error:
        raise UserError(f"cannot write {path}: {error.strerror}") from error


def _clock(seconds: float) -> str:
    return f"{int(seconds // 60)}:{int(seconds % 60):02d}"


def _positive(name: str, value: float | None) -> None:
    if value is not None and not (np.isfinite(value) and value > 0):
        raise UserError(f"{name} must be a positive number, not {value}")


def _not_negative(name: str, value: int) -> None:
    if value < 0:
        raise UserError(f"{name} must not be negative, not {value}")
