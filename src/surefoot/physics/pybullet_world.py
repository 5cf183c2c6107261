"""A robot in PyBullet: its URDF, its joints and its contacts, in one client of Bullet for each robot.

Bullet steps at 2 kHz, four substeps a tick; the joint law is explicit and computed anew at each of them. All quantities
are in the world frame and in SI units. A link's frame in Bullet is that of its principal axes of inertia at its CoM.
"""

from __future__ import annotations

import functools
import math
import tempfile
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pybullet

from surefoot.physics.motors import Motors
from surefoot.physics.pybullet_contacts import Contacts, collision_pairs, link_friction
from surefoot.physics.record_reader import RecordReader
from surefoot.physics.rotations import sole_corners, stance_quaternion, z_axis
from surefoot.physics.step_record import StepRecord, record_layout
from surefoot.rates import CONTROL_HZ
from surefoot.robots import Robot
from surefoot.robots.domain import DomainParameters
from surefoot.robots.model import FLOOR
from surefoot.robots.urdf import Urdf, link_inertia, urdf_of

SUBSTEPS = 4
"""Steps of Bullet in a tick of a world whose `physics_hz` is 500, and in proportion in others."""
SOLVER_ITERATIONS = 50
_RELAX_S, _RELAX_TIMES = 0.08, 4
"""As in MuJoCo: a robot that is put on the floor holds its pose for this time [s], so many times."""
_FIND_CORNERS = 80
"""Substeps in which Bullet finds all corners of soles that are on the floor."""
_TOUCH = 1e-6
"""A robot is put down so deep [m]."""
_FAR = (0.0, 0.0, 100.0)
"""Where the robot is loaded [m]: out of touch, so that no contact is part of what a reset goes back to."""
_FLAGS = (
    pybullet.URDF_USE_INERTIA_FROM_FILE
    | pybullet.URDF_USE_SELF_COLLISION
    | pybullet.URDF_MAINTAIN_LINK_ORDER
    | pybullet.URDF_USE_IMPLICIT_CYLINDER
)


class BulletWorld:
    """One robot on a floor.

    Args:
        robot: what stands there.
        domain: floor, masses, motors and physics rate.
    """

    def __init__(self, robot: Robot, domain: DomainParameters):
        self._robot = robot
        self._reader = RecordReader(robot, domain)
        self._model = self._reader.model
        self._num_substeps = round(SUBSTEPS * domain.physics_hz / CONTROL_HZ)
        self._dt = 1.0 / (CONTROL_HZ * self._num_substeps)
        self._floor_normal = z_axis(self._model.geom(FLOOR).quat)
        self._urdf = _urdf_of(self._model)
        self._client = pybullet.connect(pybullet.DIRECT)
        self._motors = Motors(robot, domain.motor_strength)
        self._columns = record_layout(robot)
        self._held, self._arm, self._back = np.zeros(robot.num_joints), np.zeros(3), np.zeros(4)
        self._friction = link_friction(self._model)
        self._build()

    def close(self) -> None:
        """Give back what Bullet holds."""
        pybullet.disconnect(physicsClientId=self._client)

    def set_friction(self, friction: float) -> None:
        """Set the sliding friction coefficient between feet and floor."""
        self._friction = dict.fromkeys(self._friction, friction)
        self._apply_friction()

    def set_gains(self, stiffness: np.ndarray, damping: np.ndarray) -> None:
        """Drive the joints by this impedance (num_joints,) [Nm/rad, Nms/rad]."""
        self._motors.stiffness, self._motors.damping = stiffness, damping

    def reset(
        self, joint_position: np.ndarray, yaw: float, height: float, roll: float, pitch: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Put the robot at rest, as `Engine.reset` says.

        Returns:
            Its first row (num_columns,), and the state that `restart` takes.
        """
        model = self._model
        qpos = np.concatenate([[0.0, 0.0, model.qpos0[2]], stance_quaternion(roll, pitch, yaw), joint_position])
        self._reader.qpos[:], self._reader.qvel[:] = qpos, 0.0
        soles = self._read()
        corners = sole_corners(soles.sole_position, soles.foot_orientation, self._robot.sole_half_size)
        clearance = (corners @ self._floor_normal / self._floor_normal[2]).min()
        qpos[2] += height - _TOUCH - clearance
        self._forget()
        self._place(qpos)
        self._held[:] = joint_position
        if height == 0.0 and roll == 0.0 and pitch == 0.0:
            qpos = self._relaxed(qpos)
        state = np.concatenate([qpos, joint_position])
        return self.restart(state), state

    def restart(self, state: np.ndarray) -> np.ndarray:
        """Put the robot at rest into a state (size,) of `reset`; returns its first row (num_columns,).

        Bullet finds the corners of a sole one by one, a substep each, and knows their forces only after another one.
        These steps are made and taken back; Bullet keeps the contacts in mind.
        """
        qpos, self._held[:] = np.split(state, [self._model.nq])
        self._forget()
        for num_substeps in (_FIND_CORNERS, 1):
            self._place(qpos)
            torque = self._motors(self._held, *self._joints())
            for _ in range(num_substeps):
                self._hold()
        self._contacts.read()
        self._place(qpos)
        row = np.zeros(self._model.nsensordata)
        self._take_state()
        self._write(row, torque)
        return row

    def advance(self, targets: np.ndarray, wrench: np.ndarray | None) -> tuple[np.ndarray, bool]:
        """Advance the robot by some ticks.

        Args:
            targets: of the joints (num_ticks, num_joints) [rad].
            wrench: on the bodies (num_ticks, num_bodies, 6) [N, Nm]; none without it.

        Returns:
            The ticks (num_ticks, num_columns), each at its start, and whether the robot became non-finite, after which
            it is back in its default state.
        """
        rows = np.zeros((len(targets), self._model.nsensordata))
        for tick, target in enumerate(targets):
            self._held[:] = target
            if not self._advance_tick(rows[tick], None if wrench is None else wrench[tick]):
                self._build()
                rows[tick:] = self.restart(np.concatenate([self._model.qpos0, self._model.qpos0[7:]]))
                return rows, True
        return rows, False

    def _advance_tick(self, row: np.ndarray, wrench: np.ndarray | None) -> bool:
        """Write a row and make a tick's substeps; returns whether all numbers are finite."""
        pushed = [] if wrench is None else np.flatnonzero(wrench.any(axis=1)).tolist()
        self._take_state()
        for substep in range(self._num_substeps):
            torque = self._motors(self._held, *self._joints())
            if substep == 0:
                self._write(row, torque)
                if not np.isfinite(row).all():
                    return False
            if not math.isfinite(torque.sum()):
                return False
            if wrench is not None:
                for body in pushed:
                    self._push(body, wrench[body])
            self._step(torque)
        self._contacts.read()
        return True

    def _hold(self) -> None:
        """Make one substep."""
        self._step(self._motors(self._held, *self._joints()))

    def _relaxed(self, qpos: np.ndarray) -> np.ndarray:
        """Where a robot comes to rest that is put on the floor."""
        for _ in range(_RELAX_TIMES):
            for _ in range(round(_RELAX_S / self._dt)):
                self._hold()
            self._take_state()
            qpos = self._reader.qpos.copy()
            self._place(qpos)
        return qpos

    # Bullet.

    def _bullet(self, name: str, *arguments: Any, **options: Any) -> Any:
        """A function of Bullet for this client."""
        return functools.partial(getattr(pybullet, name), *arguments, physicsClientId=self._client, **options)

    def _build(self) -> None:
        """Begin anew: gravity, the floor, the robot at zero."""
        self._bullet("resetSimulation")()
        self._bullet("setPhysicsEngineParameter")(
            fixedTimeStep=self._dt,
            numSolverIterations=SOLVER_ITERATIONS,
            deterministicOverlappingPairs=1,
        )
        self._bullet("setGravity")(*self._model.opt.gravity.tolist())
        self._floor = self._build_floor()
        self._body = self._load(self._urdf)
        self._find_links()
        self._set_dynamics()
        self._functions()
        self._contacts = Contacts(self._model, self._robot, self._links, self._contact_points)
        self._snapshot = self._bullet("saveState")()

    def _build_floor(self) -> int:
        shape = self._bullet("createCollisionShape")(pybullet.GEOM_PLANE, planeNormal=[0.0, 0.0, 1.0])
        w, x, y, z = self._model.geom(FLOOR).quat
        place = self._model.geom(FLOOR).pos.tolist()
        return int(self._bullet("createMultiBody")(0.0, shape, basePosition=place, baseOrientation=[x, y, z, w]))

    def _load(self, urdf: Urdf) -> int:
        with tempfile.TemporaryDirectory() as folder:
            return int(self._bullet("loadURDF")(str(urdf.write(Path(folder))), basePosition=_FAR, flags=_FLAGS))

    def _find_links(self) -> None:
        """Where Bullet has put the joints and the links of the URDF."""
        infos = [self._bullet("getJointInfo")(self._body, j) for j in range(self._num_links())]
        numbers = {info[1].decode(): info[0] for info in infos}
        self._joint_numbers = [numbers[name] for name in self._urdf.joints]
        self._links = {self._robot.root: -1} | {info[12].decode(): info[0] for info in infos}
        place, turn = self._bullet("getDynamicsInfo")(self._body, -1)[3:5]
        x, y, z, w = turn
        self._root_com, self._to_axes, self._from_axes = np.array(place), np.array([w, x, y, z]), np.zeros(4)
        mujoco.mju_negQuat(self._from_axes, self._to_axes)

    def _num_links(self) -> int:
        return int(self._bullet("getNumJoints")(self._body))

    def _set_dynamics(self) -> None:
        """Inertias, no drag, and joints that nothing but friction and the given torque moves."""
        change, model = self._bullet("changeDynamics"), self._model
        for link in range(-1, self._num_links()):
            change(self._body, link, linearDamping=0.0, angularDamping=0.0)
        for body in range(1, model.nbody):
            # Bullet's reader takes no inertia that a rotor dominates, and sets it to zero.
            change(self._body, self._links[model.body(body).name], localInertiaDiagonal=link_inertia(model, body)[0])
        for number, friction in zip(self._joint_numbers, model.dof_frictionloss[6:].tolist(), strict=True):
            self._bullet("setJointMotorControl2")(self._body, number, pybullet.VELOCITY_CONTROL, force=friction)
        self._apply_friction()
        allow = self._bullet("setCollisionFilterPair")
        for one, other, is_allowed in collision_pairs(model):
            floor = self._floor if one == "world" else self._body
            allow(floor, self._body, -1 if one == "world" else self._links[one], self._links[other], is_allowed)

    def _apply_friction(self) -> None:
        """Bullet multiplies the coefficients of two bodies: the floor has one."""
        change = self._bullet("changeDynamics")
        change(self._floor, -1, lateralFriction=1.0)
        for body, friction in self._friction.items():
            change(self._body, self._links[body], lateralFriction=friction)

    def _functions(self) -> None:
        """The functions that are called in every step, with all that stays the same."""
        body, joints = self._body, self._joint_numbers
        self._joint_states = self._bullet("getJointStates", body, joints)
        self._set_torques = self._bullet("setJointMotorControlArray", body, joints, pybullet.TORQUE_CONTROL)
        self._step_simulation = self._bullet("stepSimulation")
        self._base = self._bullet("getBasePositionAndOrientation", body)
        self._base_velocity = self._bullet("getBaseVelocity", body)
        self._link_state = self._bullet("getLinkState", body)
        self._force, self._torque = self._bullet("applyExternalForce", body), self._bullet("applyExternalTorque", body)
        self._contact_points = self._bullet("getContactPoints", body, self._floor)

    def _joints(self) -> tuple[np.ndarray, np.ndarray]:
        """Angles and velocities (num_joints,) [rad, rad/s]."""
        states = self._joint_states()
        return np.array([state[0] for state in states]) + self._urdf.joint_reference, np.array([s[1] for s in states])

    def _step(self, torque: np.ndarray) -> None:
        self._set_torques(forces=torque.tolist())
        self._step_simulation()

    def _push(self, body: int, wrench: np.ndarray) -> None:
        """A force [N] and a torque [Nm] on a body at its CoM, for the next substep."""
        link = self._links[self._robot.body_names[body]]
        place = self._base()[0] if link < 0 else self._link_state(link)[0]
        self._force(link, wrench[:3].tolist(), place, pybullet.WORLD_FRAME)
        self._torque(link, wrench[3:].tolist(), pybullet.WORLD_FRAME)

    def _forget(self) -> None:
        """Make Bullet forget all that it remembers of before."""
        self._bullet("restoreState")(self._snapshot)
        self._bullet("performCollisionDetection")()  # far away, where Bullet lets go of the contacts of before

    def _place(self, qpos: np.ndarray) -> None:
        """Put the robot at rest into a state in MuJoCo's order."""
        mujoco.mju_rotVecQuat(self._arm, self._root_com, qpos[3:7])
        orientation = np.zeros(4)
        mujoco.mju_mulQuat(orientation, qpos[3:7], self._to_axes)
        place, (w, x, y, z) = qpos[:3] + self._arm, orientation
        self._bullet("resetBasePositionAndOrientation")(self._body, place, [x, y, z, w])
        self._bullet("resetBaseVelocity")(self._body, [0.0] * 3, [0.0] * 3)
        angles = qpos[7:] - self._urdf.joint_reference
        for number, angle in zip(self._joint_numbers, angles.tolist(), strict=True):
            self._bullet("resetJointState")(self._body, number, angle, 0.0)

    # The record.

    def _take_state(self) -> None:
        """Hand Bullet's state to the reader: of the root's frame instead of its principal axes."""
        place, (x, y, z, w) = self._base()
        velocity, spin = map(np.array, self._base_velocity())
        qpos, qvel = self._reader.qpos, self._reader.qvel
        mujoco.mju_mulQuat(qpos[3:7], np.array([w, x, y, z]), self._from_axes)
        mujoco.mju_rotVecQuat(self._arm, self._root_com, qpos[3:7])
        mujoco.mju_cross(qvel[:3], self._arm, spin)
        qpos[:3] = place - self._arm
        qvel[:3] += velocity
        mujoco.mju_negQuat(self._back, qpos[3:7])
        mujoco.mju_rotVecQuat(qvel[3:6], spin, self._back)
        qpos[7:], qvel[6:] = self._joints()

    def _write(self, row: np.ndarray, torque: np.ndarray) -> None:
        """Write a row of the record: of the state that was taken, and of the last substep's contacts."""
        self._reader.read(row)
        row[self._columns["joint_torque"]] = torque
        self._contacts.write(row, self._columns)

    def _read(self) -> StepRecord:
        row = np.zeros((1, 1, self._model.nsensordata))
        self._reader.read(row[0, 0])
        return StepRecord(self._robot, row)


_urdf_of = functools.lru_cache(maxsize=4)(urdf_of)
"""Worlds of the same robot share its model, and so its URDF."""
