"""Robot check: a test of a robot's standing, the speed of its physics, and the faults of its description."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from surefoot.agents.nominal import NominalAgent
from surefoot.evaluation.outcome import Outcome
from surefoot.evaluation.recorded import RecordedTrial, record_trials
from surefoot.evaluation.trials import Trial
from surefoot.physics.speed import ticks_per_second
from surefoot.rates import CONTROL_DT, CONTROL_HZ
from surefoot.robots import Robot
from surefoot.robots.inspection import PoseFacts, delivered_and_trimmed, inspect_pose
from surefoot.robots.load import describe

NUM_TRIALS = 4
"""Trials of 10 s without a disturbance, each from other start angles."""
USUAL_WORDS = ("torso", "left_thigh", "left_shank")
"""Words for pushable bodies that the suite `paper` uses beside the root."""

_SMALL_MARGIN = 0.25
"""The CoM should be farther inside the support than this share of its half size."""
_TILTED = np.radians(2.0)
_UNEVEN = 0.005
_NEAR_LIMIT = 0.05
"""A pose should leave a joint this much of its range on either side [rad]."""
_LITTLE_STIFFNESS = 1.5
"""Both ankles together should hold this many times the stiffness with which the weight topples the robot."""
_MUCH_TORQUE = 0.7
"""Share of a torque limit that standing should not need."""
_STIFF_DAMPING = 2.0
"""A controller with damping D at rate 1/dt is unstable on the inertia I above D dt / I = 2."""
_FEET_FRICTION = (0.3, 1.5)
_MASSES, _LEGS = (0.5, 500.0), (0.05, 2.5)


class Finding(NamedTuple):
    """Something about a robot that its owner should look at.

    Attributes:
        is_wrong: it cannot be used so; otherwise it is suspicious.
        key: of the description.
        text: what it is.
    """

    is_wrong: bool
    key: str
    text: str


@dataclass(frozen=True, eq=False)
class RobotCheck:
    """The results of a robot check in a pose.

    Attributes:
        pose: its name.
        facts: without any physics.
        outcomes: of trials without a disturbance.
        torque: mean magnitude in the last second of the first trial, (num_joints,) [Nm].
        sag: mean distance of the joints from the pose in that second, (num_joints,) [rad].
        speeds: ticks per second of one core, of the model as delivered, trimmed, and as described.
        findings: what is wrong or suspicious.
    """

    robot: Robot
    pose: str
    facts: PoseFacts
    outcomes: tuple[Outcome, ...]
    torque: np.ndarray
    sag: np.ndarray
    speeds: tuple[float, float, float]
    findings: tuple[Finding, ...]

    @property
    def stands(self) -> bool:
        """Did it stand in every trial?"""
        return all(outcome.recovered for outcome in self.outcomes)


def check_robot(robot: Robot, pose: str = "") -> RobotCheck:
    """Let a robot stand for 10 s and look at all that can be told of it.

    Args:
        robot: the machine.
        pose: name of the pose; the default one without it.

    Raises:
        UserError: it has no such pose.
    """
    pose = pose or robot.default_pose
    angles = robot.pose(pose)
    facts = inspect_pose(robot, angles)
    trials = [Trial(seed=seed) for seed in range(NUM_TRIALS)]
    recorded = list(record_trials(NominalAgent(robot, pose), trials).values())
    last = recorded[0].ticks.ticks(slice(-CONTROL_HZ, None))
    torque = np.abs(last.joint_torque[0]).mean(axis=0)
    sag = (last.joint_position[0] - angles).mean(axis=0)
    outcomes = tuple(each.outcome for each in recorded)
    findings = tuple(_findings(robot, angles, facts, recorded, torque))
    return RobotCheck(robot, pose, facts, outcomes, torque, sag, _speeds(robot, angles, facts), findings)


def _speeds(robot: Robot, pose: np.ndarray, facts: PoseFacts) -> tuple[float, float, float]:
    qpos = np.concatenate([[0.0, 0.0, facts.root_height, 1.0, 0.0, 0.0, 0.0], pose])
    delivered, trimmed = delivered_and_trimmed(describe(robot.name))
    models = (delivered, trimmed, robot.model())
    return tuple(ticks_per_second(model, qpos) for model in models)  # type: ignore[return-value]


def _findings(
    robot: Robot, pose: np.ndarray, facts: PoseFacts, recorded: Sequence[RecordedTrial], torque: np.ndarray
) -> Iterator[Finding]:
    yield from _of_the_stand(robot, facts, recorded)
    yield from _of_the_pose(robot, pose, facts)
    yield from _of_the_motors(robot, facts, torque, any(each.outcome.recovered for each in recorded))
    yield from _of_the_size(robot, facts)
    if not robot.is_symmetric:
        yield Finding(False, "symmetric", "the robot goes without a mirror: learning takes about twice as long")
    missing = [word for word in USUAL_WORDS if word not in robot.pushable]
    if missing:
        words = ", ".join(missing)
        yield Finding(False, "pushable", f"no word {words}, which the suite paper and the preset complete push")


def _of_the_stand(robot: Robot, facts: PoseFacts, recorded: Sequence[RecordedTrial]) -> Iterator[Finding]:
    failed = [each for each in recorded if not each.outcome.recovered]
    if failed:
        first = failed[0].outcome
        way = f" {_leaning(failed[0])}" if first.reason == "fell" else ""
        what = f"{first.reason}{way} after {first.seconds:.1f} s in {len(failed)} of {len(recorded)} trials"
        yield Finding(True, "poses", f"the joint impedance does not hold the pose for 10 s: {what}")
    left, right = facts.ankles
    if left is None or right is None:
        yield Finding(False, "motors", "a leg has no controlled joint that pitches")
        return
    held = robot.stiffness[left] + robot.stiffness[right]
    topples = robot.weight * facts.com[2]
    if held < topples:
        names = f"{robot.joint_names[left]} and {robot.joint_names[right]}"
        yield Finding(
            True,
            "motors",
            f"gains cannot hold the pose: {names} give {held:.0f} Nm/rad together, and the weight topples the robot "
            f"with m g z = {topples:.0f} Nm/rad",
        )
    elif held < _LITTLE_STIFFNESS * topples:
        yield Finding(
            False,
            "motors",
            f"the ankles hold {held:.0f} Nm/rad, little more than m g z = {topples:.0f}: where the joints sag, the "
            f"robot leans {held / (held - topples):.1f} times as far",
        )


def _leaning(trial: RecordedTrial) -> str:
    """Which way the CoM is from the middle of the feet when a trial ends."""
    last = trial.ticks.ticks(slice(-1, None))
    feet = 0.5 * (last["left_sole_position"] + last["right_sole_position"])
    x, y, _ = (last["com_position"] - feet)[0, 0]
    if abs(x) > abs(y):
        return "forward" if x > 0.0 else "backward"
    return "to the left" if y > 0.0 else "to the right"


def _of_the_pose(robot: Robot, pose: np.ndarray, facts: PoseFacts) -> Iterator[Finding]:
    margin = 1.0 - np.abs(facts.com[:2]) / facts.support_half
    for axis, share in zip("xy", margin, strict=True):
        if share < _SMALL_MARGIN:
            where = "outside" if share < 0.0 else "near the border of"
            offset = 100.0 * facts.com["xy".index(axis)]
            yield Finding(False, "poses", f"the CoM stands {where} the support along {axis}, {offset:+.1f} cm off")
    if facts.sole_tilt.max() > _TILTED:
        tilt = np.degrees(facts.sole_tilt.max())
        yield Finding(False, "poses", f"a sole is {tilt:.1f} degrees from flat while the root is upright")
    if abs(facts.sole_step) > _UNEVEN:
        yield Finding(False, "poses", f"one sole is {100 * abs(facts.sole_step):.1f} cm above the other")
    for name, angle, low, high in zip(robot.joint_names, pose, robot.joint_lower, robot.joint_upper, strict=True):
        if not low <= angle <= high:
            yield Finding(True, "poses", f"{name} at {angle:g} rad is outside its range of {low:.3f} to {high:.3f}")
        elif min(angle - low, high - angle) < _NEAR_LIMIT:
            yield Finding(False, "poses", f"{name} at {angle:g} rad is near a limit of {low:.3f} to {high:.3f}")
    for one, other in facts.touching:
        yield Finding(False, "poses", f"the shapes of {one} and {other} are in each other")


def _of_the_motors(robot: Robot, facts: PoseFacts, torque: np.ndarray, stands: bool) -> Iterator[Finding]:
    rate = robot.damping * CONTROL_DT / facts.inertia
    leap = robot.torque_limit * CONTROL_DT / facts.inertia
    for j in _one_of_each(robot):
        name = robot.joint_names[j]
        if rate[j] > _STIFF_DAMPING:
            yield Finding(
                False,
                "motors",
                f"{name}: damping x dt / inertia is {rate[j]:.1f}; above 2 a motor controller at {CONTROL_HZ} Hz would "
                f"shake, which the implicit integrator hides",
            )
        if leap[j] > robot.velocity_limit[j]:
            yield Finding(
                False,
                "motors",
                f"{name}: full torque for one tick gives {leap[j]:.0f} rad/s, more than its speed limit; is its "
                f"armature missing?",
            )
        if stands and torque[j] > _MUCH_TORQUE * robot.torque_limit[j]:
            share = torque[j] / robot.torque_limit[j]
            yield Finding(False, "motors", f"{name}: standing takes {100 * share:.0f} % of its torque limit")
        if robot.stiffness[j] == 0.0:
            yield Finding(False, "motors", f"{name}: without stiffness it holds no pose")


def _one_of_each(robot: Robot) -> list[int]:
    """The first joint of each group: its mirror image has the same figures."""
    return [robot.joint_groups.index(group) for group in dict.fromkeys(robot.joint_groups)]


def _of_the_size(robot: Robot, facts: PoseFacts) -> Iterator[Finding]:
    if not _MASSES[0] <= robot.mass <= _MASSES[1]:
        yield Finding(False, "model", f"a mass of {robot.mass:.3g} kg; are the units kilograms?")
    if not _LEGS[0] <= robot.leg_length <= _LEGS[1]:
        yield Finding(False, "model", f"legs of {robot.leg_length:.3g} m; are the units metres?")
    if min(robot.sole_half_size) < 0.02 * robot.leg_length:
        length, width = 200.0 * robot.sole_half_size
        yield Finding(False, "feet", f"a sole of {length:.1f} cm x {width:.1f} cm is nearly a line")
    low, high = _FEET_FRICTION
    if not low <= robot.friction <= high:
        yield Finding(False, "floor", f"the feet slide with a friction of {robot.friction:g}")
    half = facts.com[1]
    if robot.is_symmetric and abs(half) > 0.01 * robot.leg_length:
        yield Finding(False, "model", f"the CoM is {1000 * half:+.0f} mm off the middle; is a mass on one side only?")
