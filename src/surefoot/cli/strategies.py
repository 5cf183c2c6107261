"""surefoot strategies: find how a policy keeps its balance against pushes from all directions."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from surefoot.cli.terminal import chosen_robot, say, working
from surefoot.errors import UserError


@dataclass(frozen=True)
class Strategies:
    """Push a robot from all directions and find how it keeps its balance: by ankle, hip, foot tilt or steps, or not.

    The impulses are six steps of the robot's grid apart (36 Ns for Valkyrie). `surefoot pictures` draws the table, with
    the policies, robots and engines side by side.
    """

    policy: Annotated[str, tyro.conf.Positional] = "best"
    """A shipped policy's name, a policy file (.onnx), a run folder, "nominal", or a controller (controllers/NAME or
    FILE.py:CLASS)."""
    robot: str = ""
    """The robot of a controller or of "nominal": a shipped robot's name, or a description (.toml). The
    default is the shipped policies' robot."""
    engine: str = "mujoco"
    """The physics engine: mujoco, or pybullet (needs the extra pybullet)."""
    directions: int = 16
    """Number of directions, evenly spaced from forward on; a multiple of 4."""
    largest: float = 0.0
    """The largest impulse [Ns]. The default is 84 steps of the robot's grid (504 Ns for Valkyrie)."""
    trials: int = 4
    """Number of trials for each direction and impulse; if fewer than nine in ten recover, it counts as a fall."""
    out: Path = Path("strategies.csv")
    """File of the table; its rows of other policies and engines are kept."""

    def main(self) -> None:
        """Run the trials and write the table."""
        from surefoot.agents.load import load_agent
        from surefoot.evaluation.protocol import protocol_for
        from surefoot.evaluation.strategy_map import GIVES_WAY, STRATEGIES, map_strategies, write_strategies
        from surefoot.physics.engines import engine_kind

        if self.directions < 4 or self.directions % 4:
            raise UserError(f"directions must be a multiple of 4, not {self.directions}")
        engine_kind(self.engine).title()  # is it there?
        agent = load_agent(self.policy, chosen_robot(self.robot))
        largest = self.largest or _CELLS * protocol_for(agent.robot).impulse_step
        with working(f"pushing {agent.name}"):
            cells = map_strategies(agent, self.directions, largest, self.trials, self.engine)
        write_strategies(self.out, cells)
        for strategy in (*STRATEGIES, GIVES_WAY):
            impulses = [cell.impulse for cell in cells if cell.strategy == strategy]
            if impulses:
                Console().print(f"{strategy:10} {len(impulses):4} cells, {min(impulses):g} to {max(impulses):g} Ns")
        say(f"table: {self.out}")


_CELLS = 84
"""The largest impulse without a given one, in steps of the robot's grid."""
