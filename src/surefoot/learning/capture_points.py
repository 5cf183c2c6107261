"""Capture points: the distances of the capture point that a policy still holds without a step.

A push is over before the robot can estimate it, but the robot observes its capture point. If the capture point defines
the border between two teachers, the same observation always has the same label.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from surefoot.agents.network import NetworkAgent
from surefoot.physics.balance import capture_point
from surefoot.physics.rotations import horizontal
from surefoot.rates import TICKS_PER_STEP
from surefoot.robots import Robot, load_robot
from surefoot.task import observation
from surefoot.task.environment import EnvConfig, PushRecoveryVectorEnv
from surefoot.task.random_pushes import DisturbanceConfig

NUM_DIRECTIONS = 16
NUM_ROBOTS = 512
SECONDS = 5.0
"""Length of the episodes in which a policy is watched, for a robot with legs as long as those of the paper's."""
IMPULSES = (20.0, 110.0)
"""Pushes of these episodes [Ns], for a robot of the mass of the paper's."""
FOOT_SHIFT = 0.025
"""A foot that is farther than this from its place has stepped [m], for a robot with legs as long as the paper's."""


def from_feet(robot: Robot, observations: np.ndarray) -> np.ndarray:
    """The capture point from the middle between the feet.

    Args:
        robot: robot of the observations.
        observations: without noise (N, num_observations).

    Returns:
        In the heading frame (N, 2) [m].
    """
    names = observation.component_names(robot)

    def vector(name: str) -> np.ndarray:
        first = names.index(f"{name}.x")
        return observations[:, first : first + 3]

    middle = 0.5 * (vector("left_foot_position") + vector("right_foot_position"))
    com = vector("com_position") - middle
    found = capture_point(com[:, :2], vector("com_velocity")[:, :2], com[:, 2], robot.gravity)
    return np.ascontiguousarray(found)


def held_capture_points(
    policy: NetworkAgent, config: EnvConfig, num_threads: int = 0, num_robots: int = NUM_ROBOTS
) -> list[float]:
    """Return how far the capture point goes while a policy holds a robot that is pushed at the root.

    Args:
        policy: that does not step.
        config: configuration of robot, pose and start; its pushes, noise and drops are not used.
        num_threads: of the physics; 0 for one per core.
        num_robots: that are each pushed once.

    Returns:
        The largest distance from its place at the start [m] among the robots that neither fall nor step, in
        `NUM_DIRECTIONS` evenly spaced directions, counter-clockwise from +x, each for half a step to both sides.
    """
    robot = load_robot(config.robot)
    env = PushRecoveryVectorEnv(num_robots, _watched(config, robot), num_threads)
    policy.prepare(num_robots)
    env.reset(seed=0)
    everyone, holds = np.arange(num_robots), np.ones(num_robots, bool)
    clear = env.loop.observe(slice(None), with_errors=False)
    home = np.median(from_feet(robot, clear), axis=0)
    shifts = []
    for _ in range(env.max_ticks // TICKS_PER_STEP - 1):
        target = policy(clear, everyone).joint_target
        actions = np.clip((target - env.loop.nominal) / env.loop.action_scale, -1.0, 1.0)
        _, _, terminated, _, _ = env.step(actions)
        holds &= ~terminated
        clear = env.loop.observe(slice(None), with_errors=False)
        shifts.append(horizontal(from_feet(robot, clear) - home))
    return _farthest(np.array(shifts)[:, holds].ravel(), robot.is_symmetric)


def _watched(config: EnvConfig, robot: Robot) -> EnvConfig:
    low, high = IMPULSES
    pushes = DisturbanceConfig(
        impulse=(low * robot.mass_scale, high * robot.mass_scale),
        first=(0.2 * robot.time_scale, 2.0 * robot.time_scale),
        interval=(10.0 * SECONDS, 10.0 * SECONDS),
    )
    return dataclasses.replace(
        config,
        episode_s=round(SECONDS * robot.time_scale, 3),
        drop_share=0.0,
        noise_share=0.0,
        foot_shift_limit=FOOT_SHIFT * robot.length_scale,
        foot_shift_impulse=None,
        joint_speed_limit=None,
        disturbance=pushes,
    )


def _farthest(shifts: np.ndarray, is_symmetric: bool) -> list[float]:
    """The largest of horizontal shifts (n,) by direction; those of a symmetric robot count on both sides."""
    if is_symmetric:
        shifts = np.concatenate([shifts, shifts.conj()])
    sector = np.rint(np.angle(shifts) / (2.0 * np.pi / NUM_DIRECTIONS)).astype(np.int64) % NUM_DIRECTIONS
    farthest = np.zeros(NUM_DIRECTIONS)
    np.maximum.at(farthest, sector, np.abs(shifts))
    return [round(distance, 4) for distance in farthest.tolist()]
