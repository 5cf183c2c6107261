"""Speed: the measurement of the speed of a model's bare physics on one core."""

from __future__ import annotations

import time

import mujoco
import numpy as np
from mujoco.batch import Batch

_NUM_ROBOTS = 16
_NUM_TICKS = 20
_STIRRED = 0.05
"""Targets differ from the pose by this standard deviation [rad], so that the solver has something to do."""


def ticks_per_second(model: mujoco.MjModel, qpos: np.ndarray, seconds: float = 0.5) -> float:
    """Measure how many ticks of one robot a core computes in a second of its own time, whoever else computes.

    Args:
        model: of a robot with its motors on a floor.
        qpos: state in which it stands, (nq,).
        seconds: for which it is measured.
    """
    batch = Batch(model, _NUM_ROBOTS, nthread=1)
    state = batch.bind("qpos")
    rng = np.random.default_rng(0)
    num_ticks, began = 0, time.process_time()
    while time.process_time() - began < seconds:
        if num_ticks % (25 * _NUM_ROBOTS * _NUM_TICKS) == 0:  # before anyone falls
            state[:] = qpos
            batch.bind("qvel")[:] = 0.0
        targets = qpos[7:] + _STIRRED * rng.standard_normal((_NUM_ROBOTS, 1, model.nu))
        control = np.repeat(targets, _NUM_TICKS, axis=1)
        batch.rollout(_NUM_TICKS, control, int(mujoco.mjtState.mjSTATE_CTRL))
        num_ticks += _NUM_ROBOTS * _NUM_TICKS
    return num_ticks / (time.process_time() - began)
