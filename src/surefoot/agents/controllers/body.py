"""Body: the rigid-body model behind the controllers. MuJoCo computes it for all robots at once, from what is measured.

Generalised velocities are MuJoCo's: root velocity, root angular velocity in the root's own frame, joints.
Everything else is in the heading frame with the root as its origin, as in `State`.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco.batch import Batch

from surefoot.agents.controllers.controller import State
from surefoot.errors import UserError
from surefoot.robots import Robot

_SOLES = ("left_sole", "right_sole")
_ALONG_Y = 0.9
"""A joint pitches if its axis has more than this along y: the axis is a unit vector."""


class Body:
    """Kinematics and dynamics of up to `num_robots` robots: M dv/dt + bias = S torque + sum of J^T wrench.

    Attributes:
        mass_matrix: (n, nv, nv).
        bias: Coriolis, centrifugal and gravity forces (n, nv).
        rotation: from the root's frame (n, 3, 3).
        com: (n, 3) [m].
        com_jacobian: (n, 3, nv).
        soles: centres of the soles (n, 2, 3) [m].
        sole_jacobian: of their velocity and angular velocity (n, 2, 6, nv).
        velocity: (n, nv).
        torso_joint: which of the robot's joints pitches the torso forward against the root; None without one.
    """

    def __init__(self, robot: Robot, num_robots: int):
        self.robot = robot
        model = robot.model()
        # Nothing but mass matrix, bias and kinematics is asked for.
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT) | int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
        self.num_dofs = model.nv
        self._batch = Batch(model, num_robots)
        self._qpos, self._qvel = self._batch.bind("qpos"), self._batch.bind("qvel")
        fields = ("M", "qfrc_bias", "cdof", "site_xpos", "subtree_com", "xmat")
        self._fields = {name: self._batch.bind(name) for name in fields}
        self._root = model.body(robot.root).id
        self._sites = [model.site(name).id for name in _SOLES]
        self._chains = np.array([_moves(model, model.body(foot).id) for foot in robot.feet], float)
        row = np.repeat(np.arange(model.nv), model.M_rownnz)
        self._entry = np.zeros((model.nv, model.nv), np.int64)
        self._entry[row, model.M_colind] = self._entry[model.M_colind, row] = np.arange(model.nC)
        filled = np.zeros((model.nv, model.nv))
        filled[row, model.M_colind] = filled[model.M_colind, row] = 1.0
        self._filled = filled
        above = _moves(model, model.body(robot.torso).id)
        pitches = [j for j in range(robot.num_joints) if above[6 + j] and model.jnt_axis[1 + j, 1] > _ALONG_Y]
        self.torso_joint = pitches[0] if pitches else None

    def update(self, state: State) -> None:
        """Take over what is measured of n robots."""
        n = len(state)
        roll, pitch = 0.5 * state.root_attitude.T
        sr, cr, sp, cp = np.sin(roll), np.cos(roll), np.sin(pitch), np.cos(pitch)
        self._qpos[:n, :3] = 0.0
        self._qpos[:n, 3:7] = np.stack([cr * cp, sr * cp, cr * sp, -sr * sp], axis=1)
        self._qpos[:n, 7:] = state.joint_position
        self.rotation = _rotation(*state.root_attitude.T)
        self.velocity = np.empty((n, self.num_dofs))
        self.velocity[:, :3] = state.root_velocity
        self.velocity[:, 3:6] = np.matmul(state.root_angular_velocity[:, None], self.rotation)[:, 0]
        self.velocity[:, 6:] = state.joint_velocity
        self._qvel[:n] = self.velocity
        self._batch.forward(np.arange(n), stage=int(mujoco.mjtStage.mjSTAGE_VEL))
        self._read(n)

    def _read(self, n: int) -> None:
        found = {name: field[:n] for name, field in self._fields.items()}
        self.mass_matrix = np.ascontiguousarray(found["M"][:, self._entry] * self._filled)
        self.bias = found["qfrc_bias"].copy()
        self.com = found["subtree_com"].reshape(n, -1, 3)[:, self._root].copy()
        self.soles = found["site_xpos"].reshape(n, -1, 3)[:, self._sites]
        # Total momentum is mass times CoM velocity, and the first three rows of M give it.
        self.com_jacobian = self.mass_matrix[:, :3] / self.robot.mass
        axes = found["cdof"].reshape(n, -1, 6)
        turn, along = axes[..., :3], axes[..., 3:]  # of every dof, the latter at the CoM
        self.sole_jacobian = np.empty((n, 2, 6, self.num_dofs))
        for foot, chain in enumerate(self._chains):
            at_sole = along + cross(turn, (self.soles[:, foot] - self.com)[:, None])
            self.sole_jacobian[:, foot, :3] = np.swapaxes(at_sole, 1, 2) * chain
            self.sole_jacobian[:, foot, 3:] = np.swapaxes(turn, 1, 2) * chain


@dataclass(frozen=True)
class Legs:
    """Lengths of a robot's legs with its joints at zero, rounded to 0.1 mm.

    Attributes:
        hips: where the hips pitch, from the root (2, 3) [m]: left, right.
        ankles: where the ankles pitch, from the soles' centres (2, 3) [m].
        reach: the largest distance from hip to ankle at which the knee can still push [m], rounded to a centimetre.
    """

    hips: np.ndarray
    ankles: np.ndarray
    reach: float

    @classmethod
    def of(cls, robot: Robot) -> Legs:
        """Measure a robot whose legs pitch at hip, knee and ankle.

        Raises:
            UserError: a leg has fewer than three joints that pitch.
        """
        model = robot.model()
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        hips, ankles, lengths = [], [], []
        for foot, sole in zip(robot.feet, _SOLES, strict=True):
            moves = _moves(model, model.body(foot).id)
            pitch = [j for j in range(1, model.njnt) if moves[5 + j] and abs(model.jnt_axis[j, 1]) > _ALONG_Y]
            if len(pitch) < 3:
                raise UserError(f"{robot.name} has no leg with hip, knee and ankle that pitch, which stepping needs")
            hip, ankle = data.xanchor[pitch[0]] - data.body(robot.root).xpos, data.xanchor[pitch[-1]]
            lengths.append(np.linalg.norm(data.xanchor[pitch[0]] - ankle))
            # The hip's axis goes along y. The point on it that counts lies in the plane of the leg.
            hips.append([hip[0], ankle[1] - data.body(robot.root).xpos[1], hip[2]])
            ankles.append(ankle - data.site(sole).xpos)
        reach = round(_BENT_KNEE * float(min(lengths)), 2)
        return cls(np.round(hips, 4) + 0.0, np.round(ankles, 4) + 0.0, reach)


_BENT_KNEE = 0.98
"""Share of a straight leg's length that a leg reaches with a knee that can still push."""


def _moves(model: mujoco.MjModel, body: int) -> np.ndarray:
    """The degrees of freedom that move a body, bool (nv,)."""
    above = set()
    while body:
        above.add(body)
        body = int(model.body_parentid[body])
    return np.isin(model.dof_bodyid, list(above))


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The product a x b of vectors (..., 3); NumPy's own is several times slower on small batches."""
    a, b = np.broadcast_arrays(a, b)
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def _rotation(roll: np.ndarray, pitch: np.ndarray) -> np.ndarray:
    """Rotation matrices (n, 3, 3) of a pitch after a roll, without yaw: Ry(pitch) Rx(roll)."""
    sr, cr, sp, cp = np.sin(roll), np.cos(roll), np.sin(pitch), np.cos(pitch)
    zero = np.zeros_like(sr)
    rows = [[cp, sp * sr, sp * cr], [zero, cr, -sr], [-sp, cp * sr, cp * cr]]
    # In one piece: products of other layouts round otherwise, and then a robot's bits would depend on its neighbours.
    return np.ascontiguousarray(np.moveaxis(np.array(rows), 2, 0))
