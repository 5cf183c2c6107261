"""Commands that show: demo, pictures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console

from surefoot.commands.learning import Train
from surefoot.commands.terminal import console
from surefoot.commands.testing import chosen_scenarios, evaluate_policy
from surefoot.errors import UserError

DEMO_MARK = ".surefoot-demo"
"""An empty file by which a demo knows a folder as its own."""


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
        pushes = chosen_scenarios("pelvis", 4)
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
            plots.learning_curves(read_curves(self.curves, policy), drawn[-1])
            try:
                drawn.append(pictures.draw_strip(policy, policies[policy.name], self.out / "strip.png"))
            except UserError as error:  # a machine without OpenGL still gets the plots
                console.print(f"no film strip: {error}", markup=False, soft_wrap=True)
        for picture in drawn:
            console.print(f"picture: {picture}")


def read_curves(folder: Path, policy: Any) -> dict[str, list[list[dict[str, float]]]]:
    from surefoot.curve import read_curve

    single = folder / "curve.csv"
    if single.exists():
        return {policy.contract.training["algorithm"]: [read_curve(single)]}
    found: dict[str, list[list[dict[str, float]]]] = {}
    for file in sorted(folder.glob("*.csv")):
        found.setdefault(file.stem.split("-")[0], []).append(read_curve(file))
    return found
