"""surefoot demo: learn, evaluate and draw in a few minutes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from surefoot.cli.evaluate import chosen_scenarios, evaluate_agent
from surefoot.cli.report import Pictures
from surefoot.cli.terminal import console, say
from surefoot.cli.train import Train
from surefoot.errors import UserError


@dataclass(frozen=True)
class Demo:
    """Learn a policy in a few minutes, evaluate it, print the table and draw the pictures."""

    minutes: float = 3.0
    """Minutes for learning."""
    algorithm: str = "ddpg"
    """trpo, ppo or ddpg."""
    out: Path = Path("runs/demo")
    """Folder for the run, its results and its pictures. An existing folder is left alone; the demo then uses the
    first of FOLDER-2, FOLDER-3, ... that does not exist."""
    seed: int = 0
    """Seed of all random numbers."""

    def main(self) -> None:
        """Learn, evaluate and draw."""
        from surefoot.agents.load import load_agent

        out = new_folder(self.out)
        console.print(f"demo in {out}", markup=False, highlight=False, soft_wrap=True)
        try:
            Train(algorithm=self.algorithm, preset="fast", run=out, minutes=self.minutes, seed=self.seed).main()
        except UserError:
            if not any(out.iterdir()):
                out.rmdir()
            raise
        agent = load_agent(str(out))
        pushes = chosen_scenarios("push", 4, agent.robot)
        evaluate_agent(agent, pushes, out / "results.sqlite", Console(), out / "thresholds.csv", self.minutes)
        Pictures(out / "thresholds.csv", out, str(out), out, out / "strategies.csv").main()
        say(f"push it by hand: surefoot play {out}")


def new_folder(path: Path) -> Path:
    """Make a folder that nobody has used: `path`, or the first of `path`-2, `path`-3, ... that does not exist.

    Raises:
        UserError: it cannot be made.
    """
    path = path.resolve()
    folder, number = path, 1
    while True:
        try:
            folder.mkdir(parents=True)  # refuses a folder that another demo makes at the same moment
        except FileExistsError:
            number += 1
            folder = path.parent / f"{path.name}-{number}"
        except (OSError, ValueError) as error:
            raise UserError(f"cannot make the folder {folder}: {getattr(error, 'strerror', None) or error}") from error
        else:
            return folder
