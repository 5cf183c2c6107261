"""How long a simulated second of one standing robot takes on one core, in every engine that is installed."""

import os
import sys

import numpy as np

from surefoot.physics.engines import ENGINES, make_engine
from surefoot.rates import POLICY_HZ
from surefoot.robots import load_robot

SECONDS = 10


def children_and_own() -> float:
    """Time on the cores of this process and its children that have ended [s]."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def standing(name: str, seconds: int) -> float:
    """Core time [s] of a robot that stands for so many seconds, start and end of the engine included."""
    began = children_and_own()
    robot = load_robot(sys.argv[1] if len(sys.argv) > 1 else "valkyrie")
    engine = make_engine(name, robot, 1, num_threads=1)
    engine.reset(np.array([0]), robot.pose()[None])
    engine.joint_targets[:] = robot.pose()
    for _ in range(seconds * POLICY_HZ):
        engine.step()
    del engine  # its processes end, and their time is counted
    return children_and_own() - began


if __name__ == "__main__":
    for engine in ENGINES:
        standing(engine, 0)  # reads the robot
        alone = standing(engine, 0)
        print(f"{engine}: {(standing(engine, SECONDS) - alone) / SECONDS:.3f} core seconds per robot second")
