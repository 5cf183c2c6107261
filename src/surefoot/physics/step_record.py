"""StepRecord: the named quantities of the robots' motion at 500 Hz.

Quantities are in the world frame and in SI units unless their name says otherwise.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from functools import cached_property
from typing import overload

import numpy as np

from surefoot.physics import balance
from surefoot.physics.rotations import horizontal, sole_corners
from surefoot.robots import Robot

_FOUND, _FORCE, _POINT = 0, slice(1, 4), slice(7, 10)
"""Columns of a foot's contact: number of contacts, force, torque, pressure centre; world frame."""
_BODY_QUANTITIES = {
    "root_orientation": 4,
    "root_forward": 3,
    "root_up": 3,
    "torso_up": 3,
    "root_position": 3,
    "root_velocity": 3,
    "root_angular_velocity": 3,
    "com_velocity": 3,
    "com_position": 3,
    "torso_position": 3,
    "left_sole_position": 3,
    "right_sole_position": 3,
    "angular_momentum": 3,
    "left_foot_orientation": 4,
    "right_foot_orientation": 4,
    "left_foot_contact": 10,
    "right_foot_contact": 10,
    "ground_contact": 1,
}
"""The quantities after the joints in the record, with their number of columns. Neighbours are read as one block."""

# Neighbours in the record, after the root position: three velocities, then positions.
HEADING_BLOCK = (
    "root_velocity",
    "root_angular_velocity",
    "com_velocity",
    "com_position",
    "torso_position",
    "left_foot_position",
    "right_foot_position",
)
_NUM_VELOCITIES = 3
# From (root position, the block's vectors) to the vectors, positions counted from the root.
_FROM_ROOT = np.kron(
    np.vstack([-(np.arange(len(HEADING_BLOCK)) >= _NUM_VELOCITIES).astype(float), np.eye(len(HEADING_BLOCK))]),
    np.eye(3),
)


@functools.cache
def record_layout(robot: Robot) -> dict[str, slice]:
    """Quantity -> its columns in the record of a tick; the same for every engine."""
    joints = dict.fromkeys(("joint_position", "joint_velocity", "joint_torque"), robot.num_joints)
    sizes = joints | _BODY_QUANTITIES
    ends = np.cumsum(list(sizes.values())).tolist()
    return {name: slice(end - size, end) for (name, size), end in zip(sizes.items(), ends, strict=True)}


class StepRecord:
    """Named quantities of some ticks of some robots: arrays (num_robots, num_ticks, ...), computed when asked for.

    Args:
        record: (num_robots, num_ticks, num_columns) float64, laid out as `record_layout` says.
    """

    def __init__(self, robot: Robot, record: np.ndarray):
        self.robot = robot
        self.record = record
        self._layout = record_layout(robot)

    @classmethod
    def join(cls, records: Sequence[StepRecord]) -> StepRecord:
        """Copy records of the same robots, one after the other in time, into one."""
        first = records[0]
        return cls(first.robot, np.concatenate([part.record for part in records], axis=1))

    @overload
    def __getitem__(self, key: str) -> np.ndarray: ...

    @overload
    def __getitem__(self, key: np.ndarray | slice) -> StepRecord: ...

    def __getitem__(self, key: str | np.ndarray | slice) -> np.ndarray | StepRecord:
        """The values (num_robots, num_ticks, size) of a sensor by its name, or the record of some of the robots."""
        if isinstance(key, str):
            return self.record[..., self._layout[key]]
        return StepRecord(self.robot, self.record[key])

    def ticks(self, ticks: slice) -> StepRecord:
        """The record of some of the ticks."""
        return StepRecord(self.robot, self.record[:, ticks])

    def copy(self) -> StepRecord:
        """The same record in memory of its own."""
        return StepRecord(self.robot, self.record.copy())

    def _feet(self, quantity: str) -> np.ndarray:
        """Both feet's values of a quantity, (num_robots, num_ticks, 2, size): left, right."""
        left, right = self._layout[f"left_{quantity}"], self._layout[f"right_{quantity}"]
        both = self.record[..., left.start : right.stop]
        return both.reshape(*both.shape[:-1], 2, left.stop - left.start)

    # Joints: (num_robots, num_ticks, num_joints).

    @property
    def joint_state(self) -> np.ndarray:
        """Positions [rad], then velocities [rad/s]: (num_robots, num_ticks, 2 * num_joints)."""
        return self.record[..., : self._layout["joint_velocity"].stop]

    @property
    def joint_position(self) -> np.ndarray:
        """[rad]."""
        return self["joint_position"]

    @property
    def joint_velocity(self) -> np.ndarray:
        """[rad/s]."""
        return self["joint_velocity"]

    @property
    def joint_torque(self) -> np.ndarray:
        """Of the motors [Nm]."""
        return self["joint_torque"]

    @cached_property
    def joint_power(self) -> np.ndarray:
        """|torque * velocity| [W]."""
        power = self.joint_torque * self.joint_velocity
        return np.abs(power, out=power)

    @property
    def power(self) -> np.ndarray:
        """Sum of the joints' powers [W] (the paper's power term): (num_robots, num_ticks)."""
        return self.joint_power.sum(axis=-1)

    # The body as a whole: (num_robots, num_ticks, 3).

    @property
    def com_position(self) -> np.ndarray:
        """[m]."""
        return self["com_position"]

    @property
    def com_velocity(self) -> np.ndarray:
        """[m/s]."""
        return self["com_velocity"]

    @property
    def angular_momentum(self) -> np.ndarray:
        """About the CoM [kg m^2/s]."""
        return self["angular_momentum"]

    @cached_property
    def com_height(self) -> np.ndarray:
        """Height of the CoM above the lower sole [m]: (num_robots, num_ticks)."""
        heights = self.sole_position[..., 2]
        return self.com_position[..., 2] - np.minimum(heights[..., 0], heights[..., 1])

    @cached_property
    def capture_point(self) -> np.ndarray:
        """Equation (5) of the paper [m]: (num_robots, num_ticks, 2)."""
        com = self.com_position
        return balance.capture_point(com[..., :2], self.com_velocity[..., :2], self.com_height, self.robot.gravity)

    # Attitude.

    @cached_property
    def heading(self) -> np.ndarray:
        """The root yaw as a complex number cos + i sin: (num_robots, num_ticks).

        That of the root's x axis, seen from above.
        """
        forward = horizontal(self["root_forward"])
        return forward / np.maximum(np.abs(forward), 1e-12)

    @cached_property
    def in_heading(self) -> np.ndarray:
        """The vectors of `HEADING_BLOCK` in the heading frame, x forward, y left, z up: (num_robots, num_ticks, 21).

        Positions are counted from the root.
        """
        # Products subtract several times faster than broadcasting over triples. One per robot: a large one would
        # wake BLAS threads, whose waiting takes the cores from the physics.
        first, last = self._layout["root_position"], self._layout["right_sole_position"]
        vectors = self.record[..., first.start : last.stop]
        turned = np.matmul(vectors, _FROM_ROOT)
        horizontal(turned.reshape(*turned.shape[:-1], len(HEADING_BLOCK), 3))[...] *= self.heading.conj()[..., None]
        return turned

    @cached_property
    def _attitude(self) -> np.ndarray:
        root, torso = self._layout["root_up"], self._layout["torso_up"]
        both = self.record[..., root.start : torso.stop]
        x, y, z = np.moveaxis(both.reshape(*both.shape[:-1], 2, 3), -1, 0)
        angles = np.empty((2, *x.shape))
        np.arctan2(y, z, out=angles[0, ...])
        np.arcsin(np.clip(x, -1.0, 1.0), out=angles[1, ...])
        np.negative(angles[1], out=angles[1, ...])
        return angles

    @property
    def root_attitude(self) -> np.ndarray:
        """Roll and pitch of the root [rad]: (2, num_robots, num_ticks)."""
        return self._attitude[..., 0]

    @property
    def torso_attitude(self) -> np.ndarray:
        """Roll and pitch of the torso [rad]: (2, num_robots, num_ticks)."""
        return self._attitude[..., 1]

    @property
    def root_uprightness(self) -> np.ndarray:
        """Cosine of the angle between the root and the vertical: (num_robots, num_ticks)."""
        return self["root_up"][..., 2]

    @property
    def torso_uprightness(self) -> np.ndarray:
        """Cosine of the angle between the torso and the vertical: (num_robots, num_ticks)."""
        return self["torso_up"][..., 2]

    # Feet: left, right.

    @cached_property
    def sole_position(self) -> np.ndarray:
        """Centres of the soles: (num_robots, num_ticks, 2, 3)."""
        return self._feet("sole_position")

    @cached_property
    def foot_orientation(self) -> np.ndarray:
        """Unit quaternions (w, x, y, z): (num_robots, num_ticks, 2, 4)."""
        return self._feet("foot_orientation")

    @cached_property
    def foot_force(self) -> np.ndarray:
        """Normal force of the ground on each foot [N]: (num_robots, num_ticks, 2)."""
        return self._feet("foot_contact")[..., _FORCE][..., 2]

    @cached_property
    def foot_contact(self) -> np.ndarray:
        """Does the foot touch the ground? bool (num_robots, num_ticks, 2)."""
        return self._feet("foot_contact")[..., _FOUND] > 0

    @property
    def foot_pressure_point(self) -> np.ndarray:
        """Pressure centre of each foot [m], meaningless where it has no force: (num_robots, num_ticks, 2, 2)."""
        return self._feet("foot_contact")[..., _POINT][..., :2]

    @cached_property
    def in_the_air(self) -> np.ndarray:
        """Does no foot touch the ground? bool (num_robots, num_ticks)."""
        return ~(self.foot_contact[..., 0] | self.foot_contact[..., 1])

    @cached_property
    def center_of_pressure(self) -> np.ndarray:
        """Force-weighted mean of both feet's pressure centres [m], NaN in the air: (num_robots, num_ticks, 2)."""
        force = self.foot_force[..., None]
        with np.errstate(invalid="ignore", divide="ignore"):
            return (force * self.foot_pressure_point).sum(axis=-2) / force.sum(axis=-2)

    @cached_property
    def support_center(self) -> np.ndarray:
        """Centre of the support polygon [m]: (num_robots, num_ticks, 2).

        The mean of the touching soles' centres, which is the polygon's centre for soles that stand alike; of both
        soles while none touches.
        """
        left, right = self.foot_contact[..., 0], self.foot_contact[..., 1]
        share = 0.5 + 0.5 * (right.astype(np.int8) - left)
        soles = horizontal(self.sole_position)
        center = soles[..., 0] + share * (soles[..., 1] - soles[..., 0])
        return center[..., None].view(float)

    def support_polygon(self, robot: int, tick: int) -> np.ndarray:
        """Convex hull of the touching soles, counter-clockwise (num_corners, 2) [m]; empty in the air."""
        touching = self.foot_contact[robot, tick]
        corners = sole_corners(
            self.sole_position[robot, tick], self.foot_orientation[robot, tick], self.robot.sole_half_size
        )
        return balance.convex_hull(corners[touching][..., :2].reshape(-1, 2))

    def flat_support_polygon(self, robot: int = 0, tick: int = 0) -> np.ndarray:
        """Convex hull of both soles, touching or not: (num_corners, 2) [m]."""
        soles, orientation = self.sole_position[robot, tick], self.foot_orientation[robot, tick]
        return balance.convex_hull(sole_corners(soles, orientation, self.robot.sole_half_size)[..., :2].reshape(-1, 2))

    @cached_property
    def non_foot_contact(self) -> np.ndarray:
        """Does anything but a foot touch the ground? bool (num_robots, num_ticks)."""
        found = self._feet("foot_contact")[..., _FOUND]
        return self["ground_contact"][..., 0] > found[..., 0] + found[..., 1]

    def __len__(self) -> int:
        return self.record.shape[1]
