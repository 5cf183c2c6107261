"""What several test files need: the robot, a robot at rest, altered ticks, and outcomes that nobody had to run."""

from __future__ import annotations

import os
from collections.abc import Callable

# As surefoot.learning does: before any test file loads torch, whose waiting threads would starve the other workers.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

import numpy as np
import pytest

from surefoot.judge import Outcome
from surefoot.robot import Robot, load_robot
from surefoot.simulation import TICKS_PER_STEP, Simulation, Ticks


def an_outcome(**changes: object) -> Outcome:
    """An outcome of a trial that recovered at its horizon, but for what is changed; six joint groups."""
    values = {
        "recovered": True, "reason": "recovered", "seconds": 10.0, "foot_shift": 0.0, "com_speed": 0.01,
        "pelvis_tilt": 0.1, "ankle": False, "hip": False, "foot_tilt": False, "steps": 0, "calm_drift": 0.001,
        "calm_power": 2.0, "calm_steps": 0.0, "torque_ratio": 0.5, "speed_ratio": 0.25, "torque_peaks": (10.0,) * 6,
        "speed_peaks": (1.0,) * 6, "saturated_s": (0.0,) * 6,
    }  # fmt: skip
    return Outcome(**(values | changes))


@pytest.fixture(scope="session")
def robot() -> Robot:
    return load_robot("valkyrie")


@pytest.fixture(scope="session")
def standing(robot: Robot) -> Ticks:
    """The last policy step of a robot that has stood in its straight pose for 2 s; (1, 20) ticks, not to be changed."""
    simulation = Simulation(robot, 1, num_threads=1)
    pose = robot.pose("straight")[None]
    simulation.reset(np.array([0]), pose)
    targets = np.tile(pose[:, None], (1, TICKS_PER_STEP, 1))
    for _ in range(50):
        ticks = simulation.step(targets)
    return Ticks(robot, simulation.layout, ticks.record.copy())


@pytest.fixture(scope="session")
def altered(robot: Robot) -> Callable[..., Ticks]:
    """Ticks in which the named sensors read other values: `altered(ticks, com_velocity=(0, 0, 1))`."""
    layout = Simulation(robot, 1, num_threads=1).layout

    def alter(ticks: Ticks, **values: object) -> Ticks:
        record = ticks.record.copy()
        for sensor, value in values.items():
            record[..., layout[sensor]] = value
        return Ticks(robot, layout, record)

    return alter


@pytest.fixture
def in_scratch_folder(tmp_path, monkeypatch) -> None:
    """MuJoCo writes MUJOCO_LOG.TXT into the working folder when a robot diverges."""
    monkeypatch.chdir(tmp_path)
