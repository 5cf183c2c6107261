"""Robot scale: a training run for another robot, with the pushes, heights, times and penalties that fit its size.

A preset holds the numbers of one robot. The numbers of another robot follow from its mass and leg length by dynamic
similarity: under the same gravity, times and speeds scale with the square root of the length. Impulses scale with the
mass alone, as in the protocol.
"""

from __future__ import annotations

import dataclasses

from surefoot.learning.config import TrainConfig
from surefoot.learning.preset_file import preset
from surefoot.robots import load_robot
from surefoot.task.environment import EnvConfig, Schedule
from surefoot.task.random_pushes import DisturbanceConfig

_DIGITS = 6
_DEFAULT = "fast", "ddpg"
"""Preset and algorithm of the task that the gymnasium environment has without another one."""


def default_config(robot: str | None = None) -> EnvConfig:
    """Return the task of the preset `fast`, which a policy learns in minutes.

    Args:
        robot: whose task it is: a shipped robot's name or the path of a description. Pushes, heights and times are
            scaled by its mass and the length of its legs. Without it, the preset's own robot.

    Raises:
        UserError: the robot is unknown.
    """
    config = preset(*_DEFAULT)
    return for_robot(config, robot or config.env.robot).env


def for_robot(config: TrainConfig, name: str) -> TrainConfig:
    """Return the configuration for a robot, scaled from the robot that it is for.

    The robot's default pose takes the place of a pose that it does not have. A robot that waives its mirror learns
    without one.

    Raises:
        UserError: there is no such robot, or its description is wrong.
    """
    env = config.env
    robot, told = load_robot(name), load_robot(env.robot)
    mass, length = robot.mass_scale / told.mass_scale, robot.length_scale / told.length_scale
    time = speed = robot.time_scale / told.time_scale
    power = mass * speed
    changed = dataclasses.replace(
        env,
        robot=name,
        pose=env.pose if env.pose in robot.poses else robot.default_pose,
        episode_s=round(time * env.episode_s, _DIGITS),
        drop_height=_scaled(env.drop_height, length),
        power_weight=_weighed(env.power_weight, power),
        power_log_scale=_maybe(env.power_log_scale, power),
        foot_travel_weight=_weighed(env.foot_travel_weight, speed),
        foot_travel_log_scale=_maybe(env.foot_travel_log_scale, speed),
        sway_weight=_weighed(env.sway_weight, speed),
        step_penalty_fade=env.step_penalty_fade and _scaled(env.step_penalty_fade, mass),
        step_penalty_waiver_s=round(time * env.step_penalty_waiver_s, _DIGITS),
        foot_shift_limit=_maybe(env.foot_shift_limit, length),
        foot_shift_impulse=_each(env.foot_shift_impulse, mass),
        disturbance=_disturbance(env, mass, time),
    )
    return dataclasses.replace(config, env=changed, mirror=config.mirror and robot.is_symmetric)


def _disturbance(env: EnvConfig, mass: float, time: float) -> DisturbanceConfig:
    """Return the pushes: impulses by the mass, waits by the time; a push lasts as long as for any robot."""
    config = env.disturbance
    return dataclasses.replace(
        config,
        impulse=_scaled(config.impulse, mass),
        max_impulse=round(mass * config.max_impulse, _DIGITS),
        small=_scaled(config.small, mass),
        lift=_scaled(config.lift, mass),
        first=_scaled(config.first, time),
        interval=_scaled(config.interval, time),
    )


def _scaled(pair: tuple[float, float], scale: float) -> tuple[float, float]:
    return round(scale * pair[0], _DIGITS), round(scale * pair[1], _DIGITS)


def _maybe(value: float | None, scale: float) -> float | None:
    return None if value is None else round(scale * value, _DIGITS)


def _each(values: float | tuple[float, ...] | None, scale: float) -> float | tuple[float, ...] | None:
    return (
        tuple(round(scale * value, _DIGITS) for value in values) if isinstance(values, tuple) else _maybe(values, scale)
    )


def _weighed(schedule: Schedule, scale: float) -> Schedule:
    """A penalty weight per watt or m/s, so that the same motion on the robot's scale costs the same."""
    return tuple((share, round(weight / scale, 9)) for share, weight in schedule)
