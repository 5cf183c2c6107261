"""Random pushes of robots that are not simulated, and what one of their slots holds."""

from __future__ import annotations

import numpy as np

from surefoot.physics.pushes import Pushes
from surefoot.robots import Robot
from surefoot.task.random_pushes import PUSH as PUSH_SLOT
from surefoot.task.random_pushes import DisturbanceConfig, RandomPushes


class Slot:
    """What one slot of some pushes holds, as views: (num_robots, ...)."""

    def __init__(self, pushes: Pushes, slot: int):
        self.start, self.end = pushes.start[:, slot], pushes.end[:, slot]
        self.body, self.force = pushes.body[:, slot], pushes.force[:, slot]


def random_pushes(robot: Robot, num_robots: int, seed: int = 0, **config: object) -> tuple[RandomPushes, Slot]:
    pushes = Pushes(robot, num_robots, num_slots=2)
    random = RandomPushes(DisturbanceConfig(**config), pushes, np.random.default_rng(seed))
    random.reset(np.arange(num_robots))
    return random, Slot(pushes, PUSH_SLOT)
