"""surefoot demo: learn, evaluate and draw in a few minutes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from surefoot.cli.evaluate import chosen_scenarios, evaluate_agent
from surefoot.cli.report import Pictures
from surefoot.cli.train import Train

DEMO_MARK = ".surefoot-demo"
"""An empty file by which a demo knows a folder as its own."""


@dataclass(frozen=True)
class Demo:
    """The whole way in a few minutes: learn a policy, evaluate it, print the table, draw the pictures."""

    minutes: float = 3.0
    """Time for learning."""
    algorithm: str = "ddpg"
    """trpo, ppo or ddpg."""
    out: Path = Path("runs/demo")
    """Folder for the run, its results and its pictures."""
    seed: int = 0
    """Seed of every random number that is drawn."""

    def main(self) -> None:
        """Learn, evaluate and draw."""
        from surefoot.agents.load import load_agent

        mark = self.out / DEMO_MARK
        if mark.exists():  # an earlier demo's folder; nothing else is ever removed
            for file in self.out.iterdir():
                file.unlink()
        Train(algorithm=self.algorithm, preset="fast", run=self.out, minutes=self.minutes, seed=self.seed).main()
        mark.touch()
        agent = load_agent(str(self.out))
        pushes = chosen_scenarios("push", 4, agent.robot)
        evaluate_agent(agent, pushes, self.out / "results.sqlite", Console(), self.out / "thresholds.csv")
        Pictures(self.out / "thresholds.csv", self.out, str(self.out), self.out).main()
