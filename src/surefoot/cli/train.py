"""surefoot train, select and ablate: learn policies, choose among them, and measure each part of the learning."""

from __future__ import annotations

import contextlib
import dataclasses
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from surefoot.cli.settings import print_settings, with_settings
from surefoot.cli.terminal import console, needs_torch, say, training_bar, working
from surefoot.cli.work import Work
from surefoot.errors import UserError

if TYPE_CHECKING:
    from surefoot.learning.config import TrainConfig
    from surefoot.learning.crew import Crew
    from surefoot.learning.selection import Candidate
    from surefoot.learning.stages import Stage
    from surefoot.learning.training_log import LogConfig


@dataclass(frozen=True)
class Train(Work):
    """Learn a policy. Ctrl-C stops a run; --resume continues it."""

    algorithm: str = "ddpg"
    """trpo, ppo or ddpg; the stages of the preset `best` set it themselves."""
    preset: str = "fast"
    """fast (minutes on a laptop), complete (hours: the curriculum stages that lead to the shipped policies),
    best (hours: a specialist that does not step, then a student of several policies), paper (the paper's
    hyperparameters, pose and pushes), or a TOML file of your own."""
    robot: str = ""
    """The robot that learns: a shipped robot's name, or a description (.toml, surefoot docs your-robot). The default
    is the preset's. The preset's pushes, heights, times and penalties are scaled by its mass and leg length."""
    stage: str | None = None
    """Learn only this stage of the preset `complete` or `best`, after the stage before it or after --warm-start. With
    --warm-start the default is the last stage. A wrong name is answered with the valid ones."""
    run: Path | None = None
    """Folder of the run. The default is runs/PRESET-ALGORITHM-SEED (runs/best-SEED), with the robot's name in front
    after --robot (runs/g1-PRESET-ALGORITHM-SEED)."""
    minutes: float | None = None
    """Minutes to train, for each stage if there are several. The default is the preset's. With --resume it is the
    total, including earlier sessions. The speed is measured first, and the minutes are converted into policy steps."""
    steps: int | None = None
    """Budget in policy steps instead of minutes, for each stage if there are several. The same steps and the same seed
    give the same policy on the same kind of machine."""
    seed: int = 0
    """Seed of all random numbers."""
    resume: Path | None = None
    """Continue the run in this folder instead of starting a new one."""
    warm_start: Path | None = None
    """Begin with the final networks of the run in this folder, or fine-tune a policy (a shipped one's name or a file).
    Fine-tuning learns a critic first."""
    logger: Literal["tensorboard", "wandb"] = "tensorboard"
    """tensorboard writes event files into the run folder. wandb sends the same to Weights & Biases, or keeps it in the
    run folder if the environment variable WANDB_MODE is "offline"."""
    film_minutes: float | None = None
    """Interval between films of the newest policy in the log, in minutes. The default is no films. Needs OpenGL."""
    list_settings: bool = False
    """List every setting of the preset (task, pushes, reward, networks, algorithm) with its value instead of learning.
    Each can be set after the other options, as in --env.disturbance.impulse 40 200 --hyper.gamma 0.98."""
    settings: Annotated[tuple[str, ...], tyro.conf.Suppress] = ()

    def main(self) -> None:
        """Learn."""
        with needs_torch():
            from surefoot.learning.run_folder import RunFolder
            from surefoot.learning.stages import has_stages, read_stages
        if self.list_settings:
            names = self._stages()
            print_settings(self._config(self.stage or names[-1] if names else ""))
            return
        if self.resume and self.warm_start:
            raise UserError("--warm-start is for a new run; one that is resumed knows what it began with")
        if self.resume is None:
            self._translated()._begin()
        elif has_stages(self.resume):
            self._run_stages(self.resume, read_stages(self.resume))
        else:
            self._run(with_settings(RunFolder(self.resume).config(), self.settings), self.resume, resume=True)

    def _translated(self) -> Train:
        """The same command in today's words, with a line on standard error for an old preset."""
        from surefoot.learning.preset_file import STAGED, old_stage

        told = old_stage(self.preset, self.algorithm) if self.preset != STAGED else None
        if told is None:
            return self
        _, _, stage = told.partition("/")
        say(f"--preset {self.preset} is now called --preset {STAGED} --stage {stage}")
        name = self.preset if self.preset == "wide" else told
        return dataclasses.replace(self, preset=name, run=self.run or self._folder(self.preset))

    def _begin(self) -> None:
        """Start a run, or go on with the stages of one."""
        from surefoot.learning.stages import begin_stages

        names = self._stages()
        if not names or self.warm_start:
            config = self._config(self.stage or names[-1] if names else "")
            self._run(config, self.run or self._folder(config.preset), resume=False)
            return
        if self.settings and not self.stage:
            raise UserError(f"{self.settings[0]} is for one stage; name it by --stage; valid: {', '.join(names)}")
        folder = self.run or self._folder(self.preset)
        stages = begin_stages(folder, {name: self._budgeted(self._config(name)) for name in names})
        self._run_stages(folder, [stage for stage in stages if self.stage in (None, stage.name)])

    def _stages(self) -> list[str]:
        """The names of the preset's stages; none if it has none."""
        from surefoot.learning.preset_file import stage_files

        names = list(stage_files(self.preset, self.algorithm))
        if self.stage and self.stage not in names:
            valid = ", ".join(names) or "none"
            raise UserError(f"unknown stage '{self.stage}' of {self.preset} for {self.algorithm}; valid: {valid}")
        return names

    def _config(self, stage: str) -> TrainConfig:
        """The preset, or a stage of it, for the robot that learns and with what the command line sets."""
        from surefoot.learning.preset_file import preset
        from surefoot.learning.robot_scale import for_robot

        config = preset(f"{self.preset}/{stage}" if stage else self.preset, self.algorithm)
        config = for_robot(config, self.robot or config.env.robot)
        return with_settings(config, self.settings) if self.stage in (None, stage) or not stage else config

    def _folder(self, preset: str) -> Path:
        from surefoot.learning.preset_file import MIXED

        algorithm = [] if preset.partition("/")[0] in MIXED else [self.algorithm]
        name = "-".join([*preset.split("/"), *algorithm, str(self.seed)])
        return Path("runs") / (f"{Path(self.robot).stem}-{name}" if self.robot else name)

    def _budgeted(self, config: TrainConfig) -> TrainConfig:
        from surefoot.learning.config import with_budget

        return with_budget(config, self.minutes, self.steps, config.seed if self.resume else self.seed)

    def _run(self, config: TrainConfig, folder: Path, resume: bool) -> None:
        """Learn one run."""
        from surefoot.learning.run_folder import RunFolder
        from surefoot.learning.train import is_done, train
        from surefoot.learning.warm_start import warm_start

        config = self._budgeted(config)
        if resume and is_done(RunFolder(folder), config):
            say(f"{folder} has spent its budget of {_budget_words(config)}; --minutes or --steps with more goes on")
        if self.warm_start:
            warm_start(config, self.warm_start)
        self._tell(config, folder)
        with _resumable(folder), self._crew() as crew, training_bar() as show:
            train(config, folder, resume, show, self.warm_start, self._log(), crew)
        say(f"the best policy is {folder}/best.onnx; test it with: surefoot evaluate {folder}")

    def _run_stages(self, folder: Path, stages: list[Stage]) -> None:
        """Learn the stages that are not done."""
        for stage in stages:
            stage = dataclasses.replace(stage, config=self._budgeted(stage.config))
            if stage.is_done:
                say(f"stage {stage.name}: done before")
                continue
            say(f"stage {stage.name}:")
            self._tell(stage.config, stage.folder)
            with _resumable(folder), self._crew() as crew, training_bar() as show:
                stage.run(show, self._log(), crew)
        last = stages[-1].folder
        say(f"the best policy is {last}/best.onnx; test it with: surefoot evaluate {last}")

    @contextlib.contextmanager
    def _crew(self) -> Iterator[Crew | None]:
        """The workers that move the robots; none for the executor local."""
        if self.executor == "local":
            with self.opened():  # which says what does not go with it
                yield None
            return
        if self.executor != "ray":
            raise UserError(f"one training is shared by --executor ray alone, not {self.executor}")
        from surefoot.cores import num_cores
        from surefoot.learning.ray_crew import RayCrew

        with RayCrew(self.address, self.workers or num_cores()) as crew:
            yield crew

    def _log(self) -> LogConfig:
        """Where the figures go."""
        from surefoot.learning.training_log import LogConfig

        if self.film_minutes is None:
            return LogConfig(self.logger)
        from surefoot.rendering.training_film import film_of

        return LogConfig(self.logger, film_of, self.film_minutes)

    def _tell(self, config: TrainConfig, folder: Path) -> None:
        say(f"learning with {config.algorithm} for {_budget_words(config)} in {folder}")
        say("the bar ends with the impulses that the policy now rejects, roughly: forward/left/backward/right")


def _budget_words(config: TrainConfig) -> str:
    """A run's budget in words."""
    return f"{config.steps:,} policy steps" if config.steps else f"{config.minutes:g} minutes"


@contextlib.contextmanager
def _resumable(folder: Path) -> Iterator[None]:
    """Tell how to go on when Ctrl-C stops a run."""
    try:
        yield
    except KeyboardInterrupt:
        say(f"interrupted; go on with: surefoot train --resume {folder}")
        raise


@dataclass(frozen=True)
class Select(Work):
    """Choose the best policy of several runs by held-out trials that no training has seen."""

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Run folders and policy files. The best and the last policy of each run compete, and those of all stages if a run
    has stages."""
    out: Path | None = None
    """Write the best policy to this file, with the results in its training record."""
    rounds: int = 4
    """Number of sets of trials for each policy. A set has 128 trials of pushes at the root and 318 trials of all
    scenarios, up to our targets."""
    mean_minutes: float | None = None
    """Also let means of weights compete: over all policies that a run kept within this many minutes."""

    def main(self) -> None:
        """Validate all policies and choose one."""
        with needs_torch():
            from surefoot.learning.selection import best_candidate, files, means, shipped_bytes, validate_candidate
            from surefoot.whole_file import write_whole

        competing = files(self.runs)
        if self.mean_minutes:
            competing += [file for run in self.runs if run.is_dir() for file in means(run, self.mean_minutes)]
        tasks = [(file, self.rounds, file.read_bytes()) for file in competing]
        candidates: dict[int, Candidate] = {}
        with self.opened() as executor, working(f"validating {len(competing)} policies"):
            for place, found in executor.run(validate_candidate, tasks):
                candidates[place] = found
                self._say(found)
        best = best_candidate([candidates[place] for place in sorted(candidates)])
        say(f"best: {best.file}")
        if self.out:
            write_whole(self.out, shipped_bytes(best))

    def _say(self, found: Candidate) -> None:
        """Print the results of held-out trials of a policy."""
        worst = min(found.rejected, key=lambda name: found.rejected[name])
        say(
            f"{found.file}: {found.within_limits:.3f} recovered within limits ({found.recovered:.3f} in all), "
            f"{found.quiet:.2f} quiet, worst direction {worst} {found.rejected[worst]:.0f} Ns; "
            + ", ".join(f"{name} {share:.2f}" for name, share in found.passed.items())
        )


@dataclass(frozen=True)
class Ablate(Work):
    """Measure each part of the preset `fast` for DDPG: learn without one part at a time, and compare.

    Finished runs are skipped, so the same command continues after an interruption. Each takes about two minutes
    on two free cores.
    """

    without: tuple[str, ...] = ()
    """Parts to leave out. The default is every part, one at a time. A wrong name is answered with the valid ones."""
    steps: int = 250_000
    """Number of policy steps of each run, from the beginning of the preset's schedule."""
    seed: int = 0
    """Seed of all random numbers."""
    out: Path = Path("runs/ablations")
    """Folder of the run folders."""
    export: Path | None = None
    """Folder for the learning curves, NAME.csv."""

    def main(self) -> None:
        """Learn what is missing and print the table."""
        with needs_torch():
            from surefoot.learning.ablations import LEFT_OUT, ablate
        from surefoot.report.ablations import ablation_table

        names, curves = self._names() or list(LEFT_OUT), {}
        self.out.mkdir(parents=True, exist_ok=True)
        say(f"{self.steps:,} policy steps in {self.out}, without: {', '.join(names)}")
        with self.opened() as executor, training_bar() as show:
            tasks = [(name, self.out, self.steps, self.seed, show if executor.is_local else None) for name in names]
            for place, curve in executor.run(ablate, tasks):
                curves[names[place]] = curve
                say(f"done: without {names[place]}")
                if self.export:
                    self.export.mkdir(parents=True, exist_ok=True)
                    shutil.copy(self.out / names[place] / "curve.csv", self.export / f"{names[place]}.csv")
        console.print(ablation_table({name: curves[name] for name in names}).rich())

    def _names(self) -> list[str]:
        """The parts to leave out, by their present names."""
        from surefoot.learning.ablations import LEFT_OUT, OLD_NAMES

        for name in self.without:
            if name in OLD_NAMES:
                say(f"{name} is now called {OLD_NAMES[name]}; version 0.3 drops the old name")
            elif name not in LEFT_OUT:
                raise UserError(f"unknown part '{name}'; valid: {', '.join(LEFT_OUT)}")
        return [OLD_NAMES.get(name, name) for name in self.without]
