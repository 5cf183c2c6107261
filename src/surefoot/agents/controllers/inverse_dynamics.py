"""Inverse dynamics: joint torques that put the pressure centre where a balance law wants it.

Weighted tasks on the accelerations are solved as one least-squares problem, then the ground's forces follow from the
root's six equations of motion, and the torques from the joints' (L. Sentis and O. Khatib 2005; in this form, with
the pressure centre as a task, close to A. Herzog et al. 2016 without their inequalities).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surefoot.agents.controllers.body import Body, cross
from surefoot.agents.controllers.controller import State
from surefoot.robots import Robot

# Weights of the tasks' squared errors: feet that bear stay, then the pressure centre, then posture.
_STANCE, _PRESSURE, _HEIGHT, _ATTITUDE, _TORSO, _SWING, _POSTURE = 1e3, 1e3, 10.0, 30.0, 3.0, 30.0, 1e-3
_HEIGHT_GAINS = 60.0, 12.0
ATTITUDE_GAINS = 80.0, 16.0
_TORSO_GAINS = 100.0, 20.0
_POSTURE_GAINS = 50.0, 14.0
_FOOT_DAMPING = 20.0


@dataclass
class Motion:
    """What n robots shall do, in the heading frame with the root as its origin.

    Attributes:
        pressure: pressure centre (n, 2) [m].
        height: of the CoM above the soles that bear (n,) [m].
        bears: do the left and the right foot bear? bool (n, 2).
        attitude: roll and pitch of the root (n, 2) [rad].
        torso: angle of the joint that pitches the torso (n,) [rad]; robots without one ignore it.
        turn: angular acceleration of the root about x and y beyond that (n, 2) [rad/s^2].
        torso_turn: the same of the torso joint (n,) [rad/s^2].
        swing: acceleration and angular acceleration of feet that do not bear (n, 2, 6) [m/s^2, rad/s^2].
    """

    pressure: np.ndarray
    height: np.ndarray
    bears: np.ndarray
    attitude: np.ndarray
    torso: np.ndarray
    turn: np.ndarray
    torso_turn: np.ndarray
    swing: np.ndarray

    @classmethod
    def standing(cls, pressure: np.ndarray, height: float) -> Motion:
        """Both feet bear, root and torso upright."""
        n = len(pressure)
        zero, pairs = np.zeros(n), np.zeros((n, 2))
        return cls(
            pressure, np.full(n, height), np.ones((n, 2), bool), pairs, zero, pairs.copy(), zero, np.zeros((n, 2, 6))
        )


class InverseDynamics:
    """Turns motions into joint torques."""

    def __init__(self, robot: Robot, num_robots: int):
        self.robot = robot
        self.body = Body(robot, num_robots)
        self._pose = robot.pose()

    def __call__(self, state: State, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
        """Joint targets and feed-forward torques (n, num_joints) [rad, Nm].

        Together they are pure torque: the targets are the measured angles, and what the damping would take is added.
        """
        acceleration = self._accelerations(state, motion)
        torque = self._torques(acceleration, motion)
        return state.joint_position, torque + self.robot.damping * state.joint_velocity

    def _accelerations(self, state: State, motion: Motion) -> np.ndarray:
        """Generalised accelerations (n, nv) that serve all tasks best."""
        body, robot = self.body, self.robot
        n, nv = body.velocity.shape
        tasks, goals, weights = [], [], []

        def add(task: np.ndarray, goal: np.ndarray, weight: np.ndarray | float) -> None:
            tasks.append(task)
            goals.append(goal)
            weights.append(np.broadcast_to(weight, goal.shape))

        add(*self._pressure_task(motion.pressure), _PRESSURE)
        speed = np.matmul(body.sole_jacobian, body.velocity[:, None, :, None])[..., 0]
        for foot in (0, 1):
            bears = motion.bears[:, foot]
            goal = np.where(bears[:, None], -_FOOT_DAMPING * speed[:, foot], motion.swing[:, foot])
            # With five joints a leg cannot turn its foot about the vertical too.
            weight = np.where(bears[:, None], _STANCE, _SWING * np.array([1.0, 1.0, 1.0, 0.1, 0.1, 0.0]))
            add(body.sole_jacobian[:, foot], goal, weight)
        climb = np.matmul(body.com_jacobian[:, 2:], body.velocity[..., None])[..., 0]
        height = body.com[:, 2:] - bearing(body.soles, motion.bears)[:, 2:]
        kp, kd = _HEIGHT_GAINS
        add(body.com_jacobian[:, 2:], kp * (motion.height[:, None] - height) - kd * climb, _HEIGHT)
        turning = np.zeros((n, 3, nv))
        turning[..., 3:6] = body.rotation
        kp, kd = ATTITUDE_GAINS
        turn = np.zeros((n, 3))
        turn[:, :2] = kp * (motion.attitude - state.root_attitude) + motion.turn
        add(turning, turn - kd * state.root_angular_velocity, _ATTITUDE)
        if body.torso_joint is not None:
            add(*self._torso_task(state, motion, body.torso_joint), _TORSO)
        kp, kd = _POSTURE_GAINS
        posture = np.broadcast_to(np.eye(nv)[6:], (n, robot.num_joints, nv))
        add(posture, kp * (self._pose - state.joint_position) - kd * state.joint_velocity, _POSTURE)

        task, goal = np.concatenate(tasks, axis=1), np.concatenate(goals, axis=1)
        weighted = task * np.concatenate(weights, axis=1)[..., None]
        normal = np.matmul(np.swapaxes(weighted, 1, 2), task) + 1e-6 * np.eye(nv)
        return np.linalg.solve(normal, np.matmul(np.swapaxes(weighted, 1, 2), goal[..., None]))[..., 0]

    def _torso_task(self, state: State, motion: Motion, joint: int) -> tuple[np.ndarray, np.ndarray]:
        """The torso leans by its own joint: one row."""
        torso = np.zeros((len(state), 1, self.body.num_dofs))
        torso[..., 6 + joint] = 1.0
        kp, kd = _TORSO_GAINS
        goal = kp * (motion.torso - state.joint_position[:, joint]) - kd * state.joint_velocity[:, joint]
        return torso, (goal + motion.torso_turn)[:, None]

    def _pressure_task(self, pressure: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The ground's forces have no horizontal moment about the pressure centre: two rows, as accelerations."""
        body = self.body
        scale = 1.0 / self.robot.mass  # for a CoM at 1 m
        point = np.concatenate([pressure, self._ground()[:, None]], axis=1)
        moment = np.matmul(body.rotation, body.mass_matrix[:, 3:6])
        moment -= np.swapaxes(cross(point[:, None], np.swapaxes(body.mass_matrix[:, :3], 1, 2)), 1, 2)
        rest = np.matmul(body.rotation, body.bias[:, 3:6, None])[..., 0] - cross(point, body.bias[:, :3])
        return scale * moment[:, :2], -scale * rest[:, :2]

    def _ground(self) -> np.ndarray:
        return self.body.soles[..., 2].min(axis=1)

    def _torques(self, acceleration: np.ndarray, motion: Motion) -> np.ndarray:
        """Joint torques (n, num_joints) [Nm], with the ground's force shared between the feet that bear."""
        body = self.body
        needed = np.matmul(body.mass_matrix, acceleration[..., None])[..., 0] + body.bias
        force = needed[:, :3].copy()
        force[:, 2] = np.maximum(force[:, 2], 0.0)
        moment = np.matmul(body.rotation, needed[:, 3:6, None])[..., 0]
        share, points = share_pressure(motion.pressure, body.soles[..., :2], motion.bears, self.robot.sole_half_size)
        torque = needed[:, 6:]
        center = np.concatenate([motion.pressure, self._ground()[:, None]], axis=1)
        twist = (moment - cross(center, force))[:, 2]
        for foot in (0, 1):
            part = share[:, foot, None] * force
            arm = np.concatenate([points[:, foot] - body.soles[:, foot, :2], np.zeros((len(force), 1))], axis=1)
            about_sole = cross(arm, part)
            about_sole[:, 2] += share[:, foot] * twist
            wrench = np.concatenate([part, about_sole], axis=1)
            torque = torque - np.matmul(wrench[:, None], body.sole_jacobian[:, foot, :, 6:])[:, 0]
        return torque


def bearing(soles: np.ndarray, bears: np.ndarray) -> np.ndarray:
    """Mean of the soles that bear (n, 3); of both if none does."""
    weight = np.where(bears.any(axis=1, keepdims=True), bears, True).astype(float)
    return (soles * (weight / weight.sum(axis=1, keepdims=True))[..., None]).sum(axis=1)


def share_pressure(
    pressure: np.ndarray, soles: np.ndarray, bears: np.ndarray, half_size: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """How two feet make one pressure centre: nearest point between the soles' centres, the rest inside the soles.

    Args:
        pressure: wanted (n, 2) [m].
        soles: centres (n, 2, 2) [m].
        bears: bool (n, 2).
        half_size: of a sole (2,) [m].

    Returns:
        Shares of the force (n, 2), and each foot's pressure centre (n, 2, 2), inside its sole.
    """
    apart = soles[:, 0] - soles[:, 1]
    along = ((pressure - soles[:, 1]) * apart).sum(axis=1) / np.maximum((apart * apart).sum(axis=1), 1e-9)
    left = np.where(bears[:, 0] & bears[:, 1], np.clip(along, 0.0, 1.0), bears[:, 0].astype(float))
    share = np.stack([left, (1.0 - left) * (bears[:, 1] | bears[:, 0])], axis=1)
    rest = pressure - (share[..., None] * soles).sum(axis=1)
    return share, soles + np.clip(rest, -half_size, half_size)[:, None]


def clip_to_support(pressure: np.ndarray, soles: np.ndarray, bears: np.ndarray, half_size: np.ndarray) -> np.ndarray:
    """Pressure centres (n, 2) moved into what the feet that bear can make; arguments as for `share_pressure`."""
    share, points = share_pressure(pressure, soles, bears, half_size)
    return (share[..., None] * points).sum(axis=1)
