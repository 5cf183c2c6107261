"""Teachers: the teacher of each robot in a distillation, and the action that this teacher would take.

The choice of the teacher depends on the impulse that a robot has felt so far, and not on the size that the push will
have. The same sensations then have the same label at every moment, and a push that crosses a border changes teachers as
it grows. Hidden quantities must not decide, or the student would average two teachers' answers to one observation.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from surefoot.agents.load import load_policy
from surefoot.agents.network import NetworkAgent
from surefoot.agents.policy_file import SUFFIX
from surefoot.errors import UserError
from surefoot.evaluation.protocol import protocol_for
from surefoot.evaluation.scenarios import Scenario
from surefoot.learning import capture_points
from surefoot.learning.run_folder import RunFolder
from surefoot.learning.standing import standing_thresholds
from surefoot.physics.rotations import by_degree, horizontal
from surefoot.rates import CONTROL_HZ
from surefoot.task import observation
from surefoot.task.environment import EnvConfig, PushRecoveryVectorEnv

HOME_S, HOME_SPEED = 1.0, 0.08
"""A robot is at home again when this time has passed since its push began [s], its CoM is slower than this [m/s],"""
HOME_SHIFT, HOME_BEND = 0.03, 0.2
"""its feet have kept their relative position to within this [m], and its joints are within this of the nominal pose,
root mean square [rad]."""
STEPPED_SHIFT = 0.06
"""A robot has stepped when the relative position of its feet has changed by more than this [m]."""
SLOW_S, SLOW_SPEED, SLOW_STEPS = 1.0, 0.3, 8
"""A robot has at most the second teacher from this time after the beginning of its push on [s], if its CoM has been
slower than this [m/s] for so many policy steps: its stance must not depend on the way to it."""
FAR = 0.02
"""A capture point counts as beyond a border if, at its present velocity, it will be this far beyond it at the next
policy step [m], for a robot with legs as long as the paper's. One more step with the wrong teacher costs recoveries."""
NOISY = 0.5
"""A robot is noisy with more than this share of the largest noise. A student with a memory can tell a robot without
noise from a noisy one. A border in proportion to the noise let robots without noise change teachers too soon."""
LANDED_S = 1.5
"""A dropped robot has the second teacher or a later one until this time [s]."""

_MEASURED = ("beyond_standing", "beyond_held")
NUM_MEASURED = 16
"""Number of directions in which the impulses that a teacher holds without a step are measured."""


@dataclass(frozen=True)
class Teacher:
    """A policy, and the borders beyond which it labels.

    Attributes:
        policy: for the student's robot and nominal pose; its action scale may differ.
        beyond: word of a body -> impulses [Ns] in evenly spaced directions, counter-clockwise from +x, linear between
            them. A robot that has felt more than this has this teacher. The first teacher has no such border. Impulses
            felt at other bodies do not count.
        capture_point: border of the distance of the capture point from its place at the start [m], in evenly spaced
            directions, counter-clockwise from +x, linear between them. A robot whose capture point is beyond it has
            this teacher, whatever impulse it has felt. If it is empty, only the impulse counts.
        under_noise: share of `capture_point` that holds for a robot with more than `NOISY` of the training's largest
            noise. A robot that sees its capture point imprecisely then changes teachers earlier.
        falling, rising: a robot whose CoM falls or rises faster than this has this teacher [m/s].
        leaning: a dropped robot whose pelvis rolls or pitches by more than this has this teacher [rad].
        weight: weight of its labels while a robot recovers from a push.
    """

    policy: NetworkAgent
    beyond: Mapping[str, Sequence[float]] = field(default_factory=dict)
    capture_point: Sequence[float] = ()
    under_noise: float = 1.0
    falling: float = math.inf
    rising: float = math.inf
    leaning: float = math.inf
    weight: float = 1.0

    def borders(self) -> dict[str, Any]:
        """Return where the teacher begins to label, as a checkpoint keeps it."""
        return {"beyond": dict(self.beyond), "capture_point": list(self.capture_point)}


class Teachers:
    """All teachers, and the teacher that each of N robots has.

    Args:
        teachers: in the order of the impulses that they are for.
        env: the robots.

    Raises:
        UserError: a teacher is for another robot.

    Attributes:
        level: index of each robot's teacher (N,).
    """

    def __init__(self, teachers: Sequence[Teacher], env: PushRecoveryVectorEnv):
        for teacher in teachers:
            if teacher.policy.robot.fingerprint != env.robot.fingerprint:
                name = teacher.policy.name
                raise UserError(f"the teacher {name} is for {teacher.policy.robot.name}, not for {env.robot.name}")
        self.teachers = list(teachers)
        self.env = env
        self.level = np.zeros(env.num_envs, np.int64)
        self._limits = np.full((len(teachers) - 1, len(env.robot.body_names), 360), np.inf)
        for row, teacher in enumerate(teachers[1:]):
            for body, impulses in teacher.beyond.items():
                self._limits[row, env.robot.body_id(body)] = by_degree(impulses)
        self._reach = np.array([by_degree(t.capture_point or [np.inf]) for t in teachers[1:]]).reshape(-1, 360)
        self._vertical = np.array([(-t.falling, t.rising) for t in teachers[1:]]).reshape(-1, 2, 1)
        self._under_noise = np.array([t.under_noise for t in teachers[1:]]).reshape(-1, 1)
        self._leaning = np.array([t.leaning for t in teachers[1:]]).reshape(-1, 1)
        self._indices = np.arange(1, len(teachers)).reshape(-1, 1)
        parts = observation.parts(env.robot)
        vectors = "com_velocity", "left_foot_position", "right_foot_position"
        self._columns = {name: parts.index((name, "x")) for name in vectors}
        self._attitude = [parts.index(("root_attitude", angle)) for angle in ("roll", "pitch")]
        self._home = np.zeros(3)
        self._home_capture_point = np.zeros(2)
        self._last_capture_point = np.zeros(env.num_envs, complex)
        self._slow_steps = np.zeros(env.num_envs, np.int64)

    def begin(self, observations: np.ndarray) -> None:
        """Note that all robots begin an episode with these observations (N, num_observations)."""
        self.level[:] = self._slow_steps[:] = 0
        self._home = self._feet(observations).mean(axis=0)
        capture_point = capture_points.from_feet(self.env.robot, observations)
        self._home_capture_point = np.median(capture_point, axis=0)
        self._last_capture_point = horizontal(capture_point - self._home_capture_point)

    def update(self, observations: np.ndarray, ended: np.ndarray) -> None:
        """Choose the teacher of each robot after a policy step.

        Args:
            observations: without noise (N, num_observations).
            ended: whether the episode of a robot has ended (N,); such a robot has begun another one.
        """
        level, env = self.level, self.env
        level[ended] = 0
        velocity = self._vector(observations, "com_velocity")
        speed = np.linalg.norm(velocity, axis=1)
        shift = np.abs(self._feet(observations) - self._home).max(axis=1)
        bend = np.sqrt(np.square(observations[:, : env.robot.num_joints] - env.loop.nominal).mean(axis=1))
        _, since = env.random_pushes.latest(env.loop.tick)
        self._slow_steps = np.where(ended | (speed > SLOW_SPEED), 0, self._slow_steps + 1)
        slow = (since > SLOW_S * CONTROL_HZ) & (self._slow_steps >= SLOW_STEPS)
        level[slow] = np.minimum(level[slow], 1)
        is_home = (since > HOME_S * CONTROL_HZ) & (speed < HOME_SPEED) & (shift < HOME_SHIFT) & (bend < HOME_BEND)
        level[is_home] = 0
        level[shift > STEPPED_SHIFT] = np.maximum(level[shift > STEPPED_SHIFT], 1)
        body, impulse = env.felt_push()
        degrees = np.degrees(np.angle(impulse)).astype(np.int64) % 360
        beyond = np.abs(impulse) > self._limits[:, body, degrees]
        beyond |= (velocity[:, 2] < self._vertical[:, 0]) | (velocity[:, 2] > self._vertical[:, 1])
        beyond |= self._out_of_reach(observations, ended)
        lands = env.was_dropped & (env.loop.tick < LANDED_S * CONTROL_HZ)
        beyond |= lands & (np.abs(observations[:, self._attitude]).max(axis=1) > self._leaning)
        np.maximum(level, (beyond * self._indices).max(axis=0, initial=0), out=level)
        level[lands] = np.maximum(level[lands], min(1, len(self.teachers) - 1))

    def labels(self, observations: np.ndarray, actions: np.ndarray, either: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the action that each robot's teacher would take.

        Args:
            observations: without noise (N, num_observations).
            actions: the student's actions (N, num_joints).
            either: where both the second and the third teacher would serve, the third one labels if its squared
                difference from the student's action is less than this share of the second one's. A student that has to
                choose between two ways to recover must not take the mean of both.

        Returns:
            labels: in the student's units (N, num_joints).
            levels: indices of the teachers that gave them (N,).
        """
        levels = self.level.copy()
        if len(self.teachers) > 2 and either:
            rows = np.flatnonzero(levels == 1)
            second, third = (np.square(self._ask(i, observations, rows) - actions[rows]).sum(axis=1) for i in (1, 2))
            levels[rows[third < either * second]] = 2
        labels = sum(self.answers(i, observations, levels == i) for i in range(len(self.teachers)))
        return np.asarray(labels), levels

    def answers(self, teacher: int, observations: np.ndarray, who: np.ndarray) -> np.ndarray:
        """Return the actions that one teacher would take.

        Args:
            teacher: its index.
            observations: without noise (N, num_observations).
            who: whether a robot is asked about (N,).

        Returns:
            In the student's units (N, num_joints); 0 for robots that are not asked about.
        """
        actions = np.zeros((len(who), self.env.robot.num_joints))
        rows = np.flatnonzero(who)
        actions[rows] = self._ask(teacher, observations, rows)
        return actions

    def _ask(self, teacher: int, observations: np.ndarray, rows: np.ndarray) -> np.ndarray:
        if not len(rows):
            return np.zeros((0, self.env.robot.num_joints))
        target = self.teachers[teacher].policy(observations[rows], rows).joint_target
        return np.clip((target - self.env.loop.nominal) / self.env.loop.action_scale, -1.0, 1.0)

    def _out_of_reach(self, observations: np.ndarray, ended: np.ndarray) -> np.ndarray:
        """Tell which borders each robot's capture point is beyond, or would be far beyond soon (teachers - 1, N)."""
        here = horizontal(capture_points.from_feet(self.env.robot, observations) - self._home_capture_point)
        soon = np.where(ended, here, 2.0 * here - self._last_capture_point)
        self._last_capture_point = here
        far = FAR * self.env.robot.length_scale
        share = np.where(self.env.noise_share > NOISY, self._under_noise, 1.0)
        beyond = [
            np.abs(point) > share * self._reach[:, np.degrees(np.angle(point)).astype(np.int64) % 360] + margin
            for point, margin in ((here, 0.0), (soon, far))
        ]
        return np.logical_or(*beyond)

    def _feet(self, observations: np.ndarray) -> np.ndarray:
        """The left foot from the right one in the heading frame (N, 3) [m]."""
        left, right = (self._vector(observations, f"{side}_foot_position") for side in ("left", "right"))
        return left - right

    def _vector(self, observations: np.ndarray, name: str) -> np.ndarray:
        return observations[:, self._columns[name] : self._columns[name] + 3]


def read_teachers(
    tables: Sequence[Mapping[str, Any]],
    env: EnvConfig,
    folder: RunFolder,
    resume: bool = False,
    num_threads: int = 0,
) -> list[Teacher]:
    """Return the teachers of a preset.

    Args:
        tables: one for each teacher, with the keys
            `policy`: a stage of the same run, a shipped policy, or a policy file;
            `beyond`, `capture_point`, `under_noise`, `falling`, `rising`, `leaning` and `weight`: see `Teacher`;
            `beyond_standing`: words of bodies. Beyond the largest push there from which the first teacher recovers
            without a step, a robot listens to this teacher. That is measured, which takes minutes.
            `beyond_held`: true if a robot listens to this teacher whose capture point is farther than where the first
            teacher still holds it without a step. That is measured, too, which takes a minute.
        env: of the student.
        folder: of the run; the folders beside it may be stages.
        resume: take what was measured from the folder's checkpoint.
        num_threads: of the physics; 0 for one per core.

    Raises:
        UserError: there is no such policy, it has a memory, or a table has an unknown key.
    """
    policies = [_read_policy(str(table.get("policy", "")), folder.path.parent) for table in tables]
    unknown: list[dict[str, Any]] = [{} for _ in tables]
    known = folder.load_checkpoint()[1]["teachers"] if resume else unknown
    teachers = []
    for table, policy, measured in zip(tables, policies, known, strict=True):
        borders = measured or _borders(table, policies[0], env, num_threads)
        values = {key: value for key, value in table.items() if key not in ("policy", *_MEASURED)} | borders
        try:
            teachers.append(Teacher(policy, **values))
        except TypeError as error:
            names = ["policy", *_MEASURED, *(each.name for each in fields(Teacher)[1:])]
            valid = ", ".join(names)
            raise UserError(f"unknown key of the teacher {table.get('policy')}; valid: {valid}") from error
    return teachers


def _borders(table: Mapping[str, Any], first: NetworkAgent, env: EnvConfig, num_threads: int) -> dict[str, Any]:
    """Borders of a teacher, from its table or measured on the first teacher."""
    beyond = dict(table.get("beyond", {}))
    for body in table.get("beyond_standing", ()):
        beyond[body] = _beyond_standing(first, body, num_threads)
    borders: dict[str, Any] = {"beyond": beyond}
    if table.get("beyond_held"):
        borders["capture_point"] = capture_points.held_capture_points(first, env, num_threads)
    return borders


def _read_policy(name: str, folder: Path) -> NetworkAgent:
    stage = folder / name / f"best{SUFFIX}"
    policy = load_policy(stage if name and stage.is_file() else name)
    if policy.has_memory:
        raise UserError(f"the teacher {name} has a memory; only policies without one can be teachers")
    return policy


def _beyond_standing(policy: NetworkAgent, body: str, num_threads: int) -> list[float]:
    """Impulses in 16 directions, a third of a cell above those that a policy holds without a step [Ns]."""
    scenario = Scenario("standing", directions=NUM_MEASURED, body=body)
    margin = scenario.lines(protocol_for(policy.robot))[0].grid / 3.0
    return [impulse + margin for impulse in standing_thresholds(policy, scenario, num_threads=num_threads)]
