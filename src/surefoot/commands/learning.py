"""Commands that learn: train."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from surefoot.commands.terminal import check_not_negative, check_positive, console, needs_torch, training_bar


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
        with needs_torch():
            from surefoot.learning.config import preset
            from surefoot.learning.run_folder import RunFolder
            from surefoot.learning.train import train, with_budget
        check_positive("minutes", self.minutes)
        check_positive("steps", self.steps)
        check_not_negative("seed", self.seed)
        if self.resume is None:
            config = with_budget(preset(self.preset, self.algorithm), self.minutes, self.steps, self.seed)
            folder = self.run or Path("runs") / f"{config.preset}-{config.algorithm}-{config.seed}"
        else:
            config, folder = RunFolder(self.resume).config(), self.resume
            config = with_budget(config, self.minutes, self.steps, config.seed)
        console.print(f"learning with {config.algorithm} for {config.minutes:g} minutes in {folder}")
        console.print("the bar ends with the impulses about rejected now: forward/left/backward/right")
        try:
            with training_bar() as show:
                train(config, folder, self.resume is not None, show)
        except KeyboardInterrupt:
            console.print(f"interrupted; go on with: surefoot train --resume {folder}")
            raise
        console.print(f"the best policy is {folder}/best.onnx; test it with: surefoot evaluate {folder}")
