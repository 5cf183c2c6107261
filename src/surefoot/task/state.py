"""State: the quantities of the robots that a controller receives, by name and in SI units."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from surefoot.physics.rotations import roll_pitch
from surefoot.physics.step_record import StepRecord
from surefoot.task import observation

_DOWN = np.array([0.0, 0.0, -1.0])


@dataclass(frozen=True)
class State:
    """The knowledge of the state estimators of n robots, 2 ms old; it does not include the pushes.

    Vectors are in the heading frame: x forward, y left, z up, turned with the root's yaw. Positions are counted from
    the root. Feet: left, right.

    Attributes:
        time: since the trial's start [s] (n,).
        joint_position, joint_velocity: (n, num_joints) [rad, rad/s].
        root_attitude: roll and pitch (n, 2) [rad].
        root_velocity, root_angular_velocity: (n, 3) [m/s, rad/s].
        gyroscope: the angular velocity in the root's own frame (n, 3) [rad/s].
        gravity_direction: which way is down in the root's own frame, unit vectors (n, 3); (0, 0, -1) upright.
        com_position, com_velocity: (n, 3) [m, m/s].
        capture_point: x + v sqrt(z / g), (n, 2) [m].
        com_height: of the CoM above the lower sole (n,) [m].
        sole_position: centres of the soles (n, 2, 3) [m].
        foot_attitude: roll and pitch of the feet against the vertical (n, 2, 2) [rad].
        foot_force: normal force on each foot (n, 2) [N].
        pressure_point: pressure centre of each foot, from the root (n, 2, 2) [m]; meaningless without force.
    """

    time: np.ndarray
    joint_position: np.ndarray
    joint_velocity: np.ndarray
    root_attitude: np.ndarray
    root_velocity: np.ndarray
    root_angular_velocity: np.ndarray
    gyroscope: np.ndarray
    gravity_direction: np.ndarray
    com_position: np.ndarray
    com_velocity: np.ndarray
    capture_point: np.ndarray
    com_height: np.ndarray
    sole_position: np.ndarray
    foot_attitude: np.ndarray
    foot_force: np.ndarray
    pressure_point: np.ndarray

    def __len__(self) -> int:
        """The number of robots."""
        return len(self.time)

    def __getitem__(self, rows: np.ndarray | slice) -> State:
        """The state of some of the robots, by their places in the arrays or by a mask."""
        return State(**{f.name: getattr(self, f.name)[rows] for f in dataclasses.fields(self)})

    def in_root_frame(self, vector: np.ndarray) -> np.ndarray:
        """Vectors (n, 3) of the heading frame in the root's own frame."""
        return _turned_into_root(self.root_attitude, vector)


def state_of(ticks: StepRecord, vector: np.ndarray, time: np.ndarray) -> State:
    """The state of n robots at one tick.

    Args:
        ticks: the tick (n, 1, ...), of which the state takes what the observation does not hold.
        vector: the observation at that tick (n, num_observations), with the sensors' errors.
        time: since each trial's start (n,) [s].
    """
    robot = ticks.robot
    columns = np.cumsum([len(part.components or robot.joint_names) for part in observation.TABLE.values()])
    parts = np.split(vector * observation.units(robot), columns[:-1], axis=1)
    named = dict(zip(observation.TABLE, parts, strict=True))
    soles = np.stack([named["left_foot_position"], named["right_foot_position"]], axis=1)
    height = named["com_position"][:, 2] - soles[..., 2].min(axis=1)
    swing = np.sqrt(np.maximum(height, 0.0) / robot.gravity)[:, None]
    heading, place = ticks.heading[:, 0].conj(), ticks["root_position"][:, 0, :2]
    pressed = (ticks.foot_pressure_point[:, 0] - place[:, None]) @ np.array([1.0, 1.0j])
    attitude = named["root_attitude"]
    return State(
        time=time,
        joint_position=named["joint_position"],
        joint_velocity=named["joint_velocity"],
        root_attitude=named["root_attitude"],
        root_velocity=named["root_velocity"],
        root_angular_velocity=named["root_angular_velocity"],
        gyroscope=_turned_into_root(attitude, named["root_angular_velocity"]),
        gravity_direction=_turned_into_root(attitude, np.tile(_DOWN, (len(time), 1))),
        com_position=named["com_position"],
        com_velocity=named["com_velocity"],
        capture_point=named["com_position"][:, :2] + named["com_velocity"][:, :2] * swing,
        com_height=height,
        sole_position=soles,
        foot_attitude=np.moveaxis(roll_pitch(ticks.foot_orientation[:, 0]), 0, -1),
        foot_force=named["foot_force"],
        pressure_point=np.stack([(pressed * heading[:, None]).real, (pressed * heading[:, None]).imag], axis=-1),
    )


def _turned_into_root(attitude: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Vectors (n, 3) of the heading frame in the root's own frame.

    The root is turned by Ry(pitch) Rx(roll) against the heading frame.

    Args:
        attitude: roll and pitch (n, 2) [rad].
        vector: (n, 3).
    """
    (sr, sp), (cr, cp) = np.sin(attitude).T, np.cos(attitude).T
    x, y, z = vector.T
    x, z = cp * x - sp * z, sp * x + cp * z
    return np.stack([x, cr * y + sr * z, cr * z - sr * y], axis=1)
