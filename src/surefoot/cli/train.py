"""surefoot train, select and ablate: learn policies, choose among them, and tell what each part of learning gives."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from surefoot.cli.terminal import check_not_negative, check_positive, console, needs_torch, training_bar
from surefoot.errors import UserError


@dataclass(frozen=True)
class Train:
    """Learn a policy. Ctrl-C stops a run; --resume takes it up again."""

    algorithm: str = "ddpg"
    """trpo, ppo or ddpg."""
    preset: str = "fast"
    """fast (minutes on a laptop), wide (half an hour: larger pushes, on every body, and drops), steady (after a run of
    wide: standing still), complete (after one of steady: everything else, and no needless steps) or paper (the paper's
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
    warm_start: Path | None = None
    """Begin with the networks that the run in this folder ended with, or fine-tune a policy (a shipped one's name or a
    file): its critic is learned first."""

    def main(self) -> None:
        with needs_torch():
            from surefoot.learning.config import preset
            from surefoot.learning.inheritance import forerunner
            from surefoot.learning.run_folder import RunFolder
            from surefoot.learning.train import train, with_budget
        check_positive("minutes", self.minutes)
        check_positive("steps", self.steps)
        check_not_negative("seed", self.seed)
        if self.resume and self.warm_start:
            raise UserError("--warm-start is for a new run; one that is resumed knows what it began with")
        if self.resume is None:
            config = with_budget(preset(self.preset, self.algorithm), self.minutes, self.steps, self.seed)
            folder = self.run or Path("runs") / f"{config.preset}-{config.algorithm}-{config.seed}"
        else:
            config, folder = RunFolder(self.resume).config(), self.resume
            config = with_budget(config, self.minutes, self.steps, config.seed)
        if self.warm_start:
            forerunner(config, self.warm_start)
        console.print(f"learning with {config.algorithm} for {config.minutes:g} minutes in {folder}")
        console.print("the bar ends with the impulses about rejected now: forward/left/backward/right")
        try:
            with training_bar() as show:
                train(config, folder, self.resume is not None, show, self.warm_start)
        except KeyboardInterrupt:
            console.print(f"interrupted; go on with: surefoot train --resume {folder}")
            raise
        console.print(f"the best policy is {folder}/best.onnx; test it with: surefoot evaluate {folder}")


@dataclass(frozen=True)
class Select:
    """Choose the best of several runs' policies by held-out trials that no training has seen."""

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Run folders, whose best and last policies compete, and policy files."""
    out: Path | None = None
    """Write the best one to this file, with what was found in its training record."""
    rounds: int = 4
    """Sets of trials for each: 128 of pushes at the root, 318 of everything up to our goals."""
    mean_minutes: float | None = None
    """Let means compete too, of the weights of all policies that a run kept within so many minutes."""

    def main(self) -> None:
        with needs_torch():
            from surefoot.learning.selection import files, judge, means, shipped_bytes

        check_positive("rounds", self.rounds)
        check_positive("mean-minutes", self.mean_minutes)
        competing = files(self.runs)
        if self.mean_minutes:
            competing += [file for run in self.runs if run.is_dir() for file in means(run, self.mean_minutes)]
        candidates = []
        for file in competing:
            with console.status(f"probing {file}"):
                found = judge(file, self.rounds)
            candidates.append(found)
            worst = min(found.rejected, key=lambda name: found.rejected[name])
            console.print(
                f"{file}: {found.recovered:.3f} recovered, {found.calm:.2f} calm, "
                f"worst direction {worst} {found.rejected[worst]:.0f} Ns; "
                + ", ".join(f"{name} {share:.2f}" for name, share in found.passed.items()),
                soft_wrap=True,
            )
        best = max(candidates, key=lambda candidate: candidate.score)
        console.print(f"best: {best.file}", soft_wrap=True)
        if self.out:
            self.out.write_bytes(shipped_bytes(best))


@dataclass(frozen=True)
class Ablate:
    """What each part of the preset `fast` gives DDPG: learn without one of them at a time, and compare.

    A run that is done is skipped, so that the same command goes on after an interruption. Each takes about two minutes
    on two free cores.
    """

    without: tuple[str, ...] = ()
    """What to leave out; everything, one at a time, without it. A wrong name is answered with the valid ones."""
    steps: int = 250_000
    """Policy steps of each run, the first of the preset's schedule."""
    seed: int = 0
    """Seed of everything random."""
    out: Path = Path("runs/ablations")
    """Folder of the run folders."""
    export: Path | None = None
    """Folder for the learning curves, NAME.csv."""

    def main(self) -> None:
        with needs_torch():
            from surefoot.learning.ablations import LEFT_OUT, ablate, ablation_table

        check_positive("steps", self.steps)
        check_not_negative("seed", self.seed)
        for name in self.without:
            if name not in LEFT_OUT:
                raise UserError(f"unknown part '{name}'; valid: {', '.join(LEFT_OUT)}")
        curves = {}
        for name in self.without or LEFT_OUT:
            console.print(f"without {name}: {self.steps:,} policy steps in {self.out / name}")
            with training_bar() as show:
                curves[name] = ablate(name, self.out, self.steps, self.seed, show)
            if self.export:
                self.export.mkdir(parents=True, exist_ok=True)
                shutil.copy(self.out / name / "curve.csv", self.export / f"{name}.csv")
        console.print(ablation_table(curves).rich())
