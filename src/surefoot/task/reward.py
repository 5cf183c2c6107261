"""Reward: the six groups of Yang et al. 2018, section IV-D, one function per term, one table of weights.

A term is w * exp(-alpha * error^2). Terms are summed, divided by the sum of the weights and multiplied by 10;
penalties are added; the reward of a policy step is 0.1 times the mean over its ticks, so that standing perfectly
still earns 1 per step. Weights and alphas are those of the group's public code; the paper gives only the form.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from surefoot.physics.rotations import horizontal
from surefoot.physics.step_record import StepRecord
from surefoot.rates import CONTROL_HZ

NO_FOOT_CONTACT = -2.0
NON_FOOT_CONTACT = -10.0
SCALE = 10.0
STEP_SCALE = 0.1


class Term(NamedTuple):
    """One term of the reward: `error` maps ticks to (num_robots, num_ticks)."""

    error: Callable[[StepRecord, float], np.ndarray]
    weight: float
    alpha: float


def com_position_xy(ticks: StepRecord, nominal_com_height: float) -> np.ndarray:
    """Horizontal distance from the CoM to the centre of the support polygon [m]."""
    return np.abs(horizontal(ticks.com_position) - horizontal(ticks.support_center))


def com_height(ticks: StepRecord, nominal_com_height: float) -> np.ndarray:
    """Height of the CoM above the soles over its nominal value [m]."""
    return ticks.com_height - nominal_com_height


def com_velocity_xy(ticks: StepRecord, nominal_com_height: float) -> np.ndarray:
    """Distance of the CoM's velocity from the one that puts the capture point on the support's centre [m/s].

    The target is -(CoM - centre) * sqrt(g / z). In the air the term is void: an infinite error.
    """
    rate = np.sqrt(ticks.robot.gravity / np.maximum(ticks.com_height, 0.1))
    offset = horizontal(ticks.com_position) - horizontal(ticks.support_center)
    return np.where(ticks.in_the_air, np.inf, np.abs(offset * rate + horizontal(ticks.com_velocity)))


def com_velocity_z(ticks: StepRecord, nominal_com_height: float) -> np.ndarray:
    """Vertical velocity of the CoM [m/s]."""
    return ticks.com_velocity[..., 2]


def torso_pitch(ticks: StepRecord, nominal_com_height: float) -> np.ndarray:
    """[rad]"""
    return ticks.torso_attitude[1]


def torso_roll(ticks: StepRecord, nominal_com_height: float) -> np.ndarray:
    """[rad]"""
    return ticks.torso_attitude[0]


def root_pitch(ticks: StepRecord, nominal_com_height: float) -> np.ndarray:
    """[rad]"""
    return ticks.root_attitude[1]


def root_roll(ticks: StepRecord, nominal_com_height: float) -> np.ndarray:
    """[rad]"""
    return ticks.root_attitude[0]


def left_foot_force(ticks: StepRecord, nominal_com_height: float) -> np.ndarray:
    """Normal force over half the weight [N]."""
    return ticks.foot_force[..., 0] - 0.5 * ticks.robot.weight


def right_foot_force(ticks: StepRecord, nominal_com_height: float) -> np.ndarray:
    """Normal force over half the weight [N]."""
    return ticks.foot_force[..., 1] - 0.5 * ticks.robot.weight


TERMS: dict[str, Term] = {
    "com_position_xy": Term(com_position_xy, weight=2.0, alpha=19.51),
    "com_height": Term(com_height, weight=3.0, alpha=113.84),
    "com_velocity_xy": Term(com_velocity_xy, weight=2.0, alpha=0.57),
    "com_velocity_z": Term(com_velocity_z, weight=1.0, alpha=3.69),
    "torso_pitch": Term(torso_pitch, weight=1.0, alpha=4.68),
    "torso_roll": Term(torso_roll, weight=1.0, alpha=4.68),
    "root_pitch": Term(root_pitch, weight=1.0, alpha=4.68),
    "root_roll": Term(root_roll, weight=1.0, alpha=4.68),
    "left_foot_force": Term(left_foot_force, weight=1.0, alpha=2e-5),
    "right_foot_force": Term(right_foot_force, weight=1.0, alpha=2e-5),
}
_WEIGHT = np.array([term.weight for term in TERMS.values()])
_ALPHA = np.array([term.alpha for term in TERMS.values()])
NAMES = (*TERMS, "no_foot_contact", "non_foot_contact", "power", "foot_travel", "sway", "posture")


class PenaltyWeights(NamedTuple):
    """What motion costs, on the scale on which perfect standing is 10; those of the last three that are arrays
    (num_robots,) are of each robot.

    Attributes:
        power: per watt of sum |torque * velocity|.
        power_knee: if given, a power P counts as knee * ln(1 + P / knee) [W], so that shuffling costs much and a
            recovery of several kW not much more.
        travel_knee: the same for the feet's speed [m/s].
        travel: per m/s of both feet's horizontal speeds together, so that the robot steps only where it must.
        sway: per m/s of the CoM's horizontal speed, so that the robot stays where it stands.
        posture: per rad of the joints' mean distance from the nominal pose, so that it stands as it began.
    """

    power: float = 0.0
    power_knee: float | None = None
    travel_knee: float | None = None
    travel: np.ndarray | float = 0.0
    sway: np.ndarray | float = 0.0
    posture: np.ndarray | float = 0.0


FREE = PenaltyWeights()


def step_reward(
    ticks: StepRecord, nominal_com_height: float, prices: PenaltyWeights = FREE, nominal_pose: np.ndarray | float = 0.0
) -> tuple[np.ndarray, dict[str, float]]:
    """Reward of one policy step.

    Args:
        nominal_com_height: height of the CoM above the soles in the nominal pose [m].
        nominal_pose: (num_joints,) [rad].

    Returns:
        reward: (num_robots,).
        means: every term's mean over robots and ticks, before its weight for the terms, after it for the penalties.
    """
    errors = np.stack([term.error(ticks, nominal_com_height) for term in TERMS.values()])
    np.square(errors, out=errors)
    errors *= -_ALPHA[:, None, None]
    terms = np.exp(errors, out=errors) @ np.full(len(ticks), 1.0 / len(ticks))
    nothing = np.zeros(terms.shape[1])
    speed = _foot_speed(ticks) if np.any(prices.travel) else nothing
    bend = _distance(ticks, nominal_pose) if np.any(prices.posture) else nothing
    penalties = np.stack(
        [
            NO_FOOT_CONTACT * ticks.in_the_air.mean(axis=-1),
            NON_FOOT_CONTACT * ticks.non_foot_contact.mean(axis=-1),
            -prices.power * _bent(ticks.power, prices.power_knee).mean(axis=-1),
            -prices.travel * _bent(speed, prices.travel_knee),
            -prices.sway * np.abs(horizontal(ticks.com_velocity)).mean(axis=-1),
            -prices.posture * bend,
        ]
    )
    reward = STEP_SCALE * (SCALE / _WEIGHT.sum() * (_WEIGHT @ terms) + penalties.sum(axis=0))
    means = np.concatenate([terms, penalties]).mean(axis=1)
    return reward, dict(zip(NAMES, means.tolist(), strict=True))


def _bent(value: np.ndarray, knee: float | None) -> np.ndarray:
    return value if knee is None else knee * np.log1p(value / knee)


def _foot_speed(ticks: StepRecord) -> np.ndarray:
    """Mean horizontal speed of both feet together over the ticks [m/s]: (num_robots,)."""
    way = np.abs(np.diff(horizontal(ticks.sole_position), axis=1)).sum(axis=(1, 2))
    return way * CONTROL_HZ / max(len(ticks) - 1, 1)


def _distance(ticks: StepRecord, pose: np.ndarray | float) -> np.ndarray:
    """Mean distance of the joints from a pose over joints and ticks [rad]: (num_robots,)."""
    return np.abs(ticks.joint_position - pose).mean(axis=(1, 2))
