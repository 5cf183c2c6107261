"""Framing: the size of a robot, by which cameras, marks and distances are scaled."""

from __future__ import annotations

import mujoco
import numpy as np

from surefoot.robots import Robot

REFERENCE_HEIGHT = 1.776
"""The lengths in pictures and on the live page are chosen for a robot of this height [m]."""
_HIDDEN_GROUP = 3
"""MuJoCo's convention: geoms of this group and the following ones are not looked at."""
_VISUAL_GROUP = 2
"""MuJoCo's convention: geoms of this group are only looked at."""


def scale_of(robot: Robot) -> float:
    """The robot's height over `REFERENCE_HEIGHT`."""
    return robot.standing_height / REFERENCE_HEIGHT


def visible_geoms(model: mujoco.MjModel) -> np.ndarray:
    """Ids of the geoms that show the robot, (num_geoms,).

    They are those of group 2, the visual group. A model without any shows what is not hidden, which is what is in
    groups 0 and 1; one that hides everything shows all of it.
    """
    of_robot = model.geom_bodyid > 0
    is_visual, is_shown = model.geom_group == _VISUAL_GROUP, model.geom_group < _HIDDEN_GROUP
    for chosen in (of_robot & is_visual, of_robot & is_shown):
        if chosen.any():
            return np.flatnonzero(chosen)
    return np.flatnonzero(of_robot)
