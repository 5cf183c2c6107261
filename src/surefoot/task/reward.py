"""Reward: the six groups of Yang et al. 2018, section IV-D, one function per term, all terms in one table.

A term is either rewarding, and then counts as weight * exp(-alpha * value^2), or a penalty, and then costs
weight * value. Rewarding terms are summed, divided by the sum of their weights and multiplied by 10; penalties are
subtracted. The reward of a policy step is 0.1 times the mean over its ticks, so that standing perfectly still earns
1 per step. Weights and alphas are those of the group's public code; the paper gives only the form. The last three
penalties are ours.

Alphas are for the paper's robot. For another one a value in metres, m/s or newtons is first divided by the robot's
scale of lengths, speeds or forces, so that the same dynamic motion earns the same.

A task adds terms of its own by `EnvConfig.extra_terms`.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from surefoot.errors import UserError
from surefoot.physics.rotations import horizontal
from surefoot.physics.step_record import StepRecord
from surefoot.rates import CONTROL_HZ
from surefoot.robots import Robot

SCALE = 10.0
STEP_SCALE = 0.1
MIN_COM_HEIGHT = 0.1
"""The velocity that `com_velocity_xy` asks for is that of a CoM at least this high above the soles [m], for
legs as long as those of the paper's robot."""


@dataclass(frozen=True)
class RewardContext:
    """The quantities that terms may use beside the record of a policy step.

    Attributes:
        nominal_com_height: height of the CoM above the soles in the nominal pose [m].
        nominal_pose: joint angles (num_joints,) [rad].
        penalty_weights: weights of the terms that have none in the table, by the term's name: a number, or one for
            each robot (num_robots,). A term that is not named weighs nothing.
        power_log_scale: scale s [W] of the law by which large powers cost ever less, see `log_scaled`; None for a
            cost that is proportional to the power.
        foot_travel_log_scale: the same for the feet's speed [m/s].
    """

    nominal_com_height: float
    nominal_pose: np.ndarray | float = 0.0
    penalty_weights: Mapping[str, np.ndarray | float] = field(default_factory=dict)
    power_log_scale: float | None = None
    foot_travel_log_scale: float | None = None


class Term(NamedTuple):
    """One term of the reward.

    Attributes:
        function: function of a `StepRecord` and a `RewardContext` that returns the value of every tick
            (num_robots, num_ticks) or of the whole policy step (num_robots,).
        weight: weight of the term; None if `RewardContext.penalty_weights` has it.
        alpha: the term is weight * exp(-alpha * value^2); None for a penalty of weight * value.
        scale: the robot's scale in which the value is measured before `alpha` is applied. The default is 1.
    """

    function: Callable[[StepRecord, RewardContext], np.ndarray]
    weight: float | None
    alpha: float | None = None
    scale: Callable[[Robot], float] | None = None


def com_position_xy(record: StepRecord, context: RewardContext) -> np.ndarray:
    """Horizontal distance from the CoM to the centre of the support polygon [m]."""
    return np.abs(horizontal(record.com_position) - horizontal(record.support_center))


def com_height(record: StepRecord, context: RewardContext) -> np.ndarray:
    """Height of the CoM above the soles over its nominal value [m]."""
    return record.com_height - context.nominal_com_height


def com_velocity_xy(record: StepRecord, context: RewardContext) -> np.ndarray:
    """Distance of the CoM's velocity from the one that puts the capture point on the support's centre [m/s].

    The target is -(CoM - centre) * sqrt(g / z). In the air the term is void: the distance is infinite.
    """
    lowest = MIN_COM_HEIGHT * record.robot.length_scale
    rate = np.sqrt(record.robot.gravity / np.maximum(record.com_height, lowest))
    offset = horizontal(record.com_position) - horizontal(record.support_center)
    return np.where(record.in_the_air, np.inf, np.abs(offset * rate + horizontal(record.com_velocity)))


def com_velocity_z(record: StepRecord, context: RewardContext) -> np.ndarray:
    """Vertical velocity of the CoM [m/s]."""
    return record.com_velocity[..., 2]


def torso_attitude_pitch(record: StepRecord, context: RewardContext) -> np.ndarray:
    """Pitch of the torso [rad]."""
    return record.torso_attitude[1]


def torso_attitude_roll(record: StepRecord, context: RewardContext) -> np.ndarray:
    """Roll of the torso [rad]."""
    return record.torso_attitude[0]


def root_attitude_pitch(record: StepRecord, context: RewardContext) -> np.ndarray:
    """Pitch of the root [rad]."""
    return record.root_attitude[1]


def root_attitude_roll(record: StepRecord, context: RewardContext) -> np.ndarray:
    """Roll of the root [rad]."""
    return record.root_attitude[0]


def left_foot_force(record: StepRecord, context: RewardContext) -> np.ndarray:
    """Normal force of the left foot over half the weight [N]."""
    return record.foot_force[..., 0] - 0.5 * record.robot.weight


def right_foot_force(record: StepRecord, context: RewardContext) -> np.ndarray:
    """Normal force of the right foot over half the weight [N]."""
    return record.foot_force[..., 1] - 0.5 * record.robot.weight


def no_foot_contact(record: StepRecord, context: RewardContext) -> np.ndarray:
    """1 in ticks in which no foot touches the ground, else 0."""
    return record.in_the_air


def non_foot_contact(record: StepRecord, context: RewardContext) -> np.ndarray:
    """1 in ticks in which anything but a foot touches the ground, else 0."""
    return record.non_foot_contact


def power(record: StepRecord, context: RewardContext) -> np.ndarray:
    """Sum of |torque * velocity| over the joints [W], on the context's logarithmic scale if it has one."""
    return log_scaled(record.power, context.power_log_scale)


def foot_travel(record: StepRecord, context: RewardContext) -> np.ndarray:
    """Mean horizontal speed of both feet together over a policy step [m/s], on the context's logarithmic scale."""
    way = np.abs(np.diff(horizontal(record.sole_position), axis=1)).sum(axis=(1, 2))
    return log_scaled(way * CONTROL_HZ / max(len(record) - 1, 1), context.foot_travel_log_scale)


def sway(record: StepRecord, context: RewardContext) -> np.ndarray:
    """Horizontal speed of the CoM [m/s]."""
    return np.abs(horizontal(record.com_velocity))


def posture(record: StepRecord, context: RewardContext) -> np.ndarray:
    """Mean distance of the joints from the nominal pose over joints and ticks [rad]."""
    return np.abs(record.joint_position - context.nominal_pose).mean(axis=(1, 2))


def log_scaled(value: np.ndarray, scale: float | None) -> np.ndarray:
    """Return scale * ln(1 + value / scale), or the value itself if there is no scale.

    Small values hardly change and large ones cost ever less: shuffling costs much, a recovery of several kW not much
    more.
    """
    return value if scale is None else scale * np.log1p(value / scale)


_length, _speed, _force = (operator.attrgetter(f"{what}_scale") for what in ("length", "speed", "mass"))

TERMS: dict[str, Term] = {
    "com_position_xy": Term(com_position_xy, weight=2.0, alpha=19.51, scale=_length),
    "com_height": Term(com_height, weight=3.0, alpha=113.84, scale=_length),
    "com_velocity_xy": Term(com_velocity_xy, weight=2.0, alpha=0.57, scale=_speed),
    "com_velocity_z": Term(com_velocity_z, weight=1.0, alpha=3.69, scale=_speed),
    "torso_attitude_pitch": Term(torso_attitude_pitch, weight=1.0, alpha=4.68),
    "torso_attitude_roll": Term(torso_attitude_roll, weight=1.0, alpha=4.68),
    "root_attitude_pitch": Term(root_attitude_pitch, weight=1.0, alpha=4.68),
    "root_attitude_roll": Term(root_attitude_roll, weight=1.0, alpha=4.68),
    "left_foot_force": Term(left_foot_force, weight=1.0, alpha=2e-5, scale=_force),
    "right_foot_force": Term(right_foot_force, weight=1.0, alpha=2e-5, scale=_force),
    "no_foot_contact": Term(no_foot_contact, weight=2.0),
    "non_foot_contact": Term(non_foot_contact, weight=10.0),
    "power": Term(power, weight=None),
    "foot_travel": Term(foot_travel, weight=None),
    "sway": Term(sway, weight=None),
    "posture": Term(posture, weight=None),
}
"""All terms of a task without terms of its own."""


def with_extra_terms(extra: Mapping[str, Term]) -> dict[str, Term]:
    """Return the table with further terms behind its own.

    Raises:
        UserError: an extra term has the name of a term of the table, or no weight.
    """
    for name, term in extra.items():
        if name in TERMS:
            raise UserError(f"the reward has a term '{name}' already; give the extra term another name")
        if term.weight is None:
            raise UserError(f"the extra reward term '{name}' has no weight")
    return TERMS | dict(extra)


def step_reward(
    record: StepRecord, context: RewardContext, terms: Mapping[str, Term] = TERMS
) -> tuple[np.ndarray, dict[str, float]]:
    """Reward of one policy step.

    Returns:
        reward: (num_robots,).
        means: every term's mean over robots and ticks by its name: without its weight for rewarding terms, which are
            then between 0 and 1, and weighted for penalties, which are then at most 0 for values of at least 0.

    Raises:
        UserError: a term's function gave an array of the wrong shape.
    """
    rewarding = {name: term for name, term in terms.items() if term.alpha is not None}
    penalties = {name: term for name, term in terms.items() if term.alpha is None}
    weight = np.array([term.weight for term in rewarding.values()], float)
    rewards = _exponentials(record, context, rewarding)
    costs = np.stack([_cost(name, term, record, context) for name, term in penalties.items()])
    reward = STEP_SCALE * (SCALE / weight.sum() * (weight @ rewards) + costs.sum(axis=0))
    means = np.concatenate([rewards, costs]).mean(axis=1)
    of_term = dict(zip((*rewarding, *penalties), means.tolist(), strict=True))
    return reward, {name: of_term[name] for name in terms}


def _exponentials(record: StepRecord, context: RewardContext, terms: Mapping[str, Term]) -> np.ndarray:
    """exp(-alpha * value^2) of every term, in the mean over the ticks: (num_terms, num_robots).

    All of them are one stack of arrays: its squares and its exponentials are taken in one go.
    """
    values = np.empty((len(terms), len(record.record), len(record)))
    for row, (name, term) in zip(values, terms.items(), strict=True):
        value = _checked(name, term.function(record, context), record)
        row[:] = value if value.ndim == 2 else value[:, None]
    np.square(values, out=values)
    values *= -_alphas(record.robot, terms)[:, None, None]
    return np.exp(values, out=values) @ np.full(len(record), 1.0 / len(record))


def _alphas(robot: Robot, terms: Mapping[str, Term]) -> np.ndarray:
    """Alpha of every term for this robot, (num_terms,): that of the table over the square of the value's scale."""
    return np.array([(term.alpha or 0.0) / (term.scale(robot) ** 2 if term.scale else 1.0) for term in terms.values()])


def _cost(name: str, term: Term, record: StepRecord, context: RewardContext) -> np.ndarray:
    """The contribution of a penalty to the reward, as the mean over the ticks: (num_robots,)."""
    weight = context.penalty_weights.get(name, 0.0) if term.weight is None else term.weight
    if not np.any(weight):
        return np.zeros(len(record.record))
    value = _checked(name, term.function(record, context), record)
    return -weight * (value.mean(axis=-1) if value.ndim == 2 else value)


def _checked(name: str, value: np.ndarray, record: StepRecord) -> np.ndarray:
    every = (len(record.record), len(record))
    if value.shape not in (every, every[:1]):
        raise UserError(f"the reward term '{name}' has shape {value.shape}; valid: {every}, {every[:1]}")
    return value
