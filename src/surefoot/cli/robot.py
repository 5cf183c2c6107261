"""surefoot robot check: say what was understood of a robot, and what of it is wrong or suspicious."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro
from rich.console import Console

from surefoot.cli.terminal import say, working

_WIDTH = 150
"""Of the tables [characters], at least: the joints have many columns."""


@dataclass(frozen=True)
class CheckRobot:
    """Check a robot: print what was understood of its description, and name what is wrong or suspicious.

    It lets the robot stand for 10 s. The exit code is 1 if something is wrong.
    """

    task: Annotated[Literal["check"], tyro.conf.Positional]
    """What to do."""
    robot: Annotated[str, tyro.conf.Positional]
    """A shipped robot's name, or a description (.toml, surefoot docs your-robot)."""
    pose: str = ""
    """Name of the pose; the robot's default one without it."""
    picture: Path | None = None
    """Draw the robot as it stands, from the side and from the front, to this .png or .jpg file."""

    def main(self) -> None:
        """Check, print and draw."""
        from surefoot.evaluation.robot_check import check_robot
        from surefoot.rendering.image_files import check_picture
        from surefoot.report.robot_tables import robot_tables
        from surefoot.robots import load_robot

        if self.picture:
            check_picture(self.picture)
        robot = load_robot(self.robot)
        with working(f"standing {robot.title} up"):
            check = check_robot(robot, self.pose)
        output = Console(width=max(Console().width, _WIDTH))
        for table in robot_tables(check):
            if table.rows:
                output.print(table.rich())
        if self.picture:
            from surefoot.rendering.standing import draw_standing

            with working(f"drawing {self.picture}"):
                draw_standing(robot, check.pose, self.picture)
            say(f"picture: {self.picture}")
        if not check.findings:
            say("nothing is wrong or suspicious")
        if any(found.is_wrong for found in check.findings):
            sys.exit(1)
