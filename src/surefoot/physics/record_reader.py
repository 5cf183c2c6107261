"""Record reader: the quantities of a record that follow from a robot's state alone, by MuJoCo's kinematics.

An engine that only knows where bodies are and how they move hands its state over; torques and contacts are its own to
add. That way every engine's "CoM velocity" is the same function of the same state.
"""

from __future__ import annotations

import functools

import mujoco
import numpy as np

from surefoot.physics.mujoco_sensors import model_with_sensors
from surefoot.robots import Robot
from surefoot.robots.domain import DomainParameters


class RecordReader:
    """Reads rows of a record off the state of one robot.

    Attributes:
        model: the robot's, without contacts; readers of the same robot share it.
        qpos, qvel: its state, in MuJoCo's order; the caller writes them.
    """

    def __init__(self, robot: Robot, domain: DomainParameters):
        self.model = _model(robot, domain)
        self._data = mujoco.MjData(self.model)
        self.qpos, self.qvel = self._data.qpos, self._data.qvel

    def read(self, row: np.ndarray) -> None:
        """Write a row (num_columns,) of the record, with the torques and contacts of a robot that has none."""
        mujoco.mj_step1(self.model, self._data)
        row[:] = self._data.sensordata


@functools.lru_cache(maxsize=4)
def _model(robot: Robot, domain: DomainParameters) -> mujoco.MjModel:
    model = model_with_sensors(robot, domain)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    return model
