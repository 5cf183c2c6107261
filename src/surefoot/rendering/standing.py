"""Standing: a picture of a robot as it stands in a pose, from the side and from the front."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from surefoot.agents.nominal import NominalAgent
from surefoot.evaluation.trials import Trial
from surefoot.physics.pushes import Push
from surefoot.rendering.image_files import save_picture
from surefoot.rendering.recording import record
from surefoot.rendering.renderer import Renderer
from surefoot.robots import Robot

_FROM_THE_FRONT = Push(direction=(0.0, 1.0, 0.0))
"""A lateral push is seen from the front; one of 0 Ns is not drawn."""


def draw_standing(robot: Robot, pose: str, path: Path, size: tuple[int, int] = (480, 640)) -> None:
    """Draw a robot after a second of holding a pose, from the side and from the front.

    Args:
        robot: the machine.
        pose: name of the pose.
        path: of a .png or .jpg file.
        size: width and height of each of the two pictures [pixels].

    Raises:
        UserError: the robot has no such pose, or the file cannot be written.
    """
    moment = record(NominalAgent(robot, pose), Trial(full_length=False)).at(0.0)
    with Renderer(robot, *size) as scene:
        pictures = [scene.draw(moment, push) for push in (None, _FROM_THE_FRONT)]
    save_picture(path, np.concatenate(pictures, axis=1))
