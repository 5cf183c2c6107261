"""PyBullet worker: a process with some robots of a `PybulletEngine`: python -m surefoot.physics.pybullet_worker.

It reads pickled messages from standard input and writes one answer for each to standard output: first the robot's name,
its domain and the robots' numbers, then methods of `BulletWorld` with an argument list for each robot.
"""

from __future__ import annotations

import os
import pickle
import sys
from typing import IO, Any

from surefoot.robots import load_robot


def main() -> None:
    """Answer until standard input ends."""
    answers = _own_output()
    from surefoot.physics.pybullet_world import BulletWorld  # Bullet talks on standard output from here on

    worlds: dict[int, BulletWorld] = {}
    while True:
        try:
            message = pickle.load(sys.stdin.buffer)  # from the engine's process, and from nowhere else
        except EOFError:
            return
        try:
            if worlds:
                answer: Any = _called(worlds, *message)
            else:
                name, domain, numbers = message
                robot = load_robot(name)
                worlds = {number: BulletWorld(robot, domain) for number in numbers}
                answer = dict.fromkeys(numbers)
        except Exception as error:
            answer = error  # for the engine's process to raise
        pickle.dump(answer, answers)
        answers.flush()


def _called(worlds: dict[int, Any], method: str, calls: list[Any]) -> dict[int, Any]:
    """Call a method of some of the worlds; returns what each answered."""
    return {robot: getattr(worlds[robot], method)(*arguments) for robot, *arguments in calls}


def _own_output() -> IO[bytes]:
    """Standard output for the answers alone; what C libraries write to it and to standard error goes nowhere."""
    own = os.fdopen(os.dup(1), "wb")
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    return own


if __name__ == "__main__":
    main()
