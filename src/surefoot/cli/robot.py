"""surefoot robot check: print a robot's description as read, and name faults and suspicious values."""

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
    """Check a robot: print its description as read, and name faults and suspicious values.

    The command also lets the robot stand for 10 s. The exit code is 1 if there is a fault.
    """

    task: Annotated[Literal["check"], tyro.conf.Positional]
    """The task: check."""
    robot: Annotated[str, tyro.conf.Positional]
    """A shipped robot's name, or a description (.toml, surefoot docs your-robot)."""
    pose: str = ""
    """Name of the pose. The default is the robot's default pose."""
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
