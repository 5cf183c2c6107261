"""Environment: act, simulate, reward, observe, for a batch of robots; one robot is the special case."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode

from surefoot.physics.engines import DEFAULT_ENGINE
from surefoot.physics.rotations import by_degree, horizontal
from surefoot.rates import CONTROL_DT, CONTROL_HZ, POLICY_HZ
from surefoot.robots import load_robot
from surefoot.task import observation, reward
from surefoot.task.control_loop import ControlLoop
from surefoot.task.early_ends import EarlyEnds
from surefoot.task.imperfections import Imperfections
from surefoot.task.privileged import PrivilegedObservation
from surefoot.task.random_pushes import PUSH, DisturbanceConfig, RandomPushes

NUM_STARTS = 512
"""A batch of at least an eighth as many robots draws its starts on the floor from so many poses that stand already,
since standing up takes time. Fewer robots stand up anew at each reset."""

_MAX_DEPTH = 20

Schedule = tuple[tuple[float, float], ...]
"""Knots (share of the training done, value), linear between them."""


@dataclass(frozen=True)
class EnvConfig:
    """The task of a robot. The defaults are the paper's.

    Attributes:
        robot: name of the robot.
        pose: name of the nominal pose. The robot starts in it, and an action of zero means it.
        action_scale: joint angle [rad] per unit of action.
        episode_s: time after which an episode is truncated [s].
        joint_noise: largest deviation of the start angles from the nominal pose [rad], uniform.
        drop_height: range of heights above the floor from which an episode starts [m], uniform.
        drop_share: share of the episodes that start from such a height. The others start on the floor.
        drop_lean: largest lean of a dropped robot [rad], uniform, in any direction.
        power_weight: penalty weight per watt, over the share of the training done.
        power_log_scale: power above which each further watt costs ever less [W], see `reward.log_scaled`.
        foot_travel_weight: penalty weight per m/s of the feet's horizontal speeds, over the share of the training done.
        foot_travel_log_scale: speed above which each further m/s costs ever less [m/s].
        sway_weight: penalty weight per m/s of the CoM's horizontal speed, over the share of the training done.
        posture_weight: penalty weight per rad of the joints' mean distance from the nominal pose, over the share of
            the training done. The penalty ends for the rest of an episode as soon as the step penalties fade.
        step_penalty_fade: range of impulses over which the step penalties fade [Ns]. The step penalties are those on
            foot travel and sway. They make the robot answer small pushes without a step, while it may take any number
            of steps after large ones. They are charged in full after a push below this range, fade linearly within it,
            and are waived above it. Without a range they are always charged.
        step_penalty_waiver_s: time after a push for which the step penalties fade, and after a drop for which they are
            waived [s]. A robot with noise never pays for foot travel.
        foot_shift_limit: an episode ends when the centre of a sole is farther than this from its place [m]. Its place
            is where it was when the robot had survived the last push. Without a limit the robot may step.
        foot_shift_impulse: with a limit, a robot may still step after a push at the root with a larger impulse than
            this [Ns], after a push at another body, and after a drop; with noise it always may. Several values are for
            evenly spaced directions in the heading frame, counter-clockwise from +x, linear between them.
        joint_speed_limit: an episode ends when a joint's speed, as a mean over 10 ms, exceeds this share of its limit.
        speed_end_probability: probability of such an end in a policy step, over the share of the training done. The
            default is 1.
        noise_share: share of the episodes with noise. Its size is uniform between zero and the two deviations below.
        observation_noise: largest standard deviation of the noise on the observation, see `Imperfections`.
        action_noise: largest standard deviation of the noise on the joint targets [rad].
        disturbance: the pushes.
        extra_terms: reward terms of your own by name, see `reward.Term`. They are added to the table. The weights of
            rewarding terms are part of the sum by which the reward is divided.
        engine: name of the physics engine.
    """

    robot: str
    pose: str = "straight"
    action_scale: float = 1.0
    episode_s: float = 16.0
    joint_noise: float = 0.02
    drop_height: tuple[float, float] = (0.0, 0.0)
    drop_share: float = 0.0
    drop_lean: float = 0.0
    power_weight: Schedule = ((0.0, 1e-4),)
    power_log_scale: float | None = None
    foot_travel_weight: Schedule = ((0.0, 0.0),)
    foot_travel_log_scale: float | None = None
    sway_weight: Schedule = ((0.0, 0.0),)
    posture_weight: Schedule = ((0.0, 0.0),)
    step_penalty_fade: tuple[float, float] | None = None
    step_penalty_waiver_s: float = 3.0
    foot_shift_limit: float | None = None
    foot_shift_impulse: float | tuple[float, ...] | None = None
    joint_speed_limit: float | None = None
    speed_end_probability: Schedule | None = None
    noise_share: float = 0.0
    observation_noise: float = 0.0
    action_noise: float = 0.0
    disturbance: DisturbanceConfig = field(default_factory=DisturbanceConfig)
    extra_terms: Mapping[str, reward.Term] = field(default_factory=dict)
    engine: str = DEFAULT_ENGINE

    @classmethod
    def from_values(cls, values: Mapping[str, Any]) -> EnvConfig:
        """Return the configuration of a table of values, such as a preset's.

        Raises:
            TypeError: the table has an unknown key, or no robot.
        """
        disturbance = DisturbanceConfig(**as_tuples(values.get("disturbance", {})))
        return cls(**as_tuples({**values, "disturbance": None}) | {"disturbance": disturbance})


def as_tuples(value: Any, depth: int = 0) -> Any:
    """Return nested lists and tables with tuples for the lists, as frozen configurations have them.

    Raises:
        ValueError: they are nested deeper than any configuration is.
    """
    if depth > _MAX_DEPTH:
        raise ValueError(f"its lists and tables are nested deeper than {_MAX_DEPTH} times")
    if isinstance(value, list):
        return tuple(as_tuples(item, depth + 1) for item in value)
    if isinstance(value, dict):
        return {key: as_tuples(item, depth + 1) for key, item in value.items()}
    return value


class PushRecoveryVectorEnv(gym.vector.VectorEnv):
    """N robots that are pushed and must not fall.

    Observation: (N, 47) float32, `observation.component_names`. Action: (N, 11) in [-1, 1], joint targets as the
    nominal pose plus `action_scale` times the action, clipped to the joint ranges. An episode terminates when
    anything but a foot touches the ground (or its numbers become non-finite, or it does what the configuration
    forbids), and is truncated at `episode_s`.
    A robot whose episode ends starts the next one in the same step; its last observation is `final_obs` of the info.

    Args:
        num_envs: number of robots N.
        config: what they are asked to do.
        num_threads: of the physics; 0 for one per core.

    Attributes:
        reward_means: mean of every term of the reward in the last step, see `reward.step_reward`.
        generator: the random generator of everything that is drawn.
        noise_share: noise of each robot's episode as a share of the largest (N,).
    """

    metadata = {
        "autoreset_mode": AutoresetMode.SAME_STEP,
        "render_modes": [],
        "render_fps": POLICY_HZ,
    }

    render_mode: str | None = None

    def __init__(self, num_envs: int, config: EnvConfig, num_threads: int = 0):
        self.config = config
        self.num_envs = num_envs
        self.robot = load_robot(config.robot)
        pose, engine = self.robot.pose(config.pose), config.engine
        self.loop = ControlLoop(self.robot, num_envs, pose, config.action_scale, num_threads, engine=engine)
        num_observations = len(observation.component_names(self.robot))
        self.single_observation_space = gym.spaces.Box(-np.inf, np.inf, (num_observations,), np.float32)
        self.single_action_space = gym.spaces.Box(-1.0, 1.0, (self.robot.num_joints,), np.float32)
        self.observation_space = gym.vector.utils.batch_space(self.single_observation_space, num_envs)
        self.action_space = gym.vector.utils.batch_space(self.single_action_space, num_envs)
        self.max_ticks = round(config.episode_s * CONTROL_HZ)
        self.reward_means: dict[str, float] = {}
        self._terms = reward.with_extra_terms(config.extra_terms)
        self._dropped = np.zeros(num_envs, bool)
        self._pays_posture = np.ones(num_envs, bool)
        self._heading = np.ones(num_envs, complex)
        self.noise_share = np.zeros(num_envs)
        self._waiting = np.zeros(num_envs, bool)
        self._early_ends = EarlyEnds(self.robot, num_envs, config.foot_shift_limit, config.joint_speed_limit)
        self._foot_shift_impulse = by_degree(np.atleast_1d(config.foot_shift_impulse or 0.0))
        self._privileged = PrivilegedObservation(self.robot, self.loop.nominal)
        self.set_progress(0.0)
        self._seed(None)

    def _seed(self, seed: int | None) -> None:
        self.generator, self._np_random_seed = gym.utils.seeding.np_random(seed)
        self._np_random = self.generator
        self._starts = self._stand_up() if 8 * self.num_envs >= NUM_STARTS else None
        self.random_pushes = RandomPushes(self.config.disturbance, self.loop.pushes, self.generator)

    def set_progress(self, progress: float) -> None:
        """Tell the schedules the share of the training done, 0 to 1."""
        self.power_weight = _at(progress, self.config.power_weight)
        self.foot_travel_weight = _at(progress, self.config.foot_travel_weight)
        self.sway_weight = _at(progress, self.config.sway_weight)
        self.posture_weight = _at(progress, self.config.posture_weight)
        self.speed_end_probability = _at(progress, self.config.speed_end_probability or ((0.0, 1.0),))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start every robot anew; with a seed, the same seed gives the same bits."""
        if seed is not None:
            self._seed(seed)
        self._reset(np.arange(self.num_envs))
        return self.loop.observation.astype(np.float32), {}

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Advance every robot by one policy step: act, simulate, reward, observe."""
        survived = self.random_pushes.advance(self.loop.tick)
        record = self.loop.step(actions)
        rewards, self.reward_means = reward.step_reward(record, self._reward_context(), self._terms)
        self._heading = record.heading[:, -1].copy()
        observations = self.loop.observation.astype(np.float32)
        terminated = record.non_foot_contact.any(axis=1) | self.loop.engine.diverged
        terminated |= self._early_ends.stepped(record, survived) & ~self._may_step()
        fast = np.flatnonzero(self._early_ends.too_fast(record))
        terminated[fast] |= self.generator.random(len(fast)) < self.speed_end_probability
        truncated = (self.loop.tick >= self.max_ticks) & ~terminated
        terminated, truncated = terminated & ~self._waiting, truncated & ~self._waiting
        info: dict[str, Any] = {}
        done = terminated | truncated
        if done.any():
            last = self.privileged_observation()
            info = {"final_obs": observations.copy(), "_final_obs": done, "final_privileged": last}
            fallen = np.flatnonzero(terminated)
            self.random_pushes.fell(fallen, self.loop.tick[fallen])
            self._after_end(np.flatnonzero(done), observations)
        return observations, rewards, terminated, truncated, info

    def _after_end(self, ids: np.ndarray, observations: np.ndarray) -> None:
        """Start the next episodes of robots `ids` (n,), whose last ones have just ended."""
        self._reset(ids)
        observations[ids] = self.loop.observe(ids)

    def privileged_observation(self) -> np.ndarray:
        """The critic's knowledge beside the observation: (N, 12) float64, `privileged.SIGNS`.

        It is the next push (`PrivilegedObservation.next_push`), the share of the step penalties that is charged now
        (whether a step ends the episode, where one may), whether leaving the nominal pose still costs, and the robot's
        noise as a share of the largest.
        """
        loop = self.loop
        pushes = self._privileged.next_push(loop.pushes, loop.tick, self._heading)
        may_not_step = self.step_penalty_share() if self.config.foot_shift_limit is None else ~self._may_step()
        return np.column_stack([pushes, may_not_step, self._pays_posture, self.noise_share])

    def felt_push(self) -> tuple[np.ndarray, np.ndarray]:
        """Return what each robot has felt of its last push until now.

        Returns:
            body: index into the robot's `body_names` (N,).
            impulse: in the heading frame as complex numbers x + iy (N,) [Ns]; 0 before the push.
        """
        pushes = self.loop.pushes
        begun = np.clip(self.loop.tick - pushes.start[:, PUSH], 0, pushes.end[:, PUSH] - pushes.start[:, PUSH])
        force = horizontal(pushes.force[:, PUSH]) * self._heading.conj()
        return pushes.body[:, PUSH], force * begun * CONTROL_DT

    @property
    def was_dropped(self) -> np.ndarray:
        """Whether a robot's episode began in the air: (N,)."""
        return self._dropped

    def step_penalty_share(self) -> np.ndarray:
        """Share of the penalties of foot travel and sway that each robot pays after its last push: (N,)."""
        has_penalties = self.foot_travel_weight or self.sway_weight or self.posture_weight
        if not has_penalties or self.config.step_penalty_fade is None:
            return np.ones(self.num_envs)
        impulse, since = self.random_pushes.latest(self.loop.tick)
        waived = np.interp(impulse, self.config.step_penalty_fade, (0.0, 1.0))
        waived[self._dropped & (impulse == 0.0)] = 1.0
        waived[since > self.config.step_penalty_waiver_s * CONTROL_HZ] = 0.0
        return 1.0 - waived

    def _may_step(self) -> np.ndarray:
        """Tell who may step now, if stepping ends an episode at all: (N,)."""
        if self.config.foot_shift_impulse is None:
            return np.zeros(self.num_envs, bool)
        impulse, _ = self.random_pushes.latest(self.loop.tick)
        at_root, angle = self.random_pushes.latest_place()
        degrees = np.degrees(angle - np.angle(self._heading)).astype(np.int64) % 360
        freed = impulse > np.where(at_root, self._foot_shift_impulse[degrees], 0.0)
        return freed | (self._dropped & (impulse == 0.0)) | self.loop.imperfect

    def _reward_context(self) -> reward.RewardContext:
        share = self.step_penalty_share()
        self._pays_posture &= share == 1.0
        weights: dict[str, np.ndarray | float] = {
            "power": self.power_weight,
            "foot_travel": self.foot_travel_weight * share * ~self.loop.imperfect,
            "sway": self.sway_weight * share,
            "posture": self.posture_weight * self._pays_posture,
        }
        return reward.RewardContext(
            self.loop.nominal_com_height,
            self.loop.nominal,
            weights,
            self.config.power_log_scale,
            self.config.foot_travel_log_scale,
        )

    def _reset(self, ids: np.ndarray) -> None:
        rng, config, n = self.generator, self.config, len(ids)
        dropped = rng.random(n) < config.drop_share
        height = dropped * rng.uniform(*config.drop_height, n)
        lean = dropped * rng.uniform(0.0, config.drop_lean, n) * np.exp(1j * rng.uniform(0.0, 2.0 * np.pi, n))
        anew = np.ones(n, bool)
        if self._starts:
            states, joint_targets = self._starts
            drawn = rng.integers(len(states), size=n)
            self.loop.restart(ids, states[drawn], joint_targets[drawn])
            anew = height > 0.0
        if anew.any():
            joints = self._start_joints(int(anew.sum()))
            self.loop.reset(ids[anew], joints, height=height[anew], roll=lean.real[anew], pitch=lean.imag[anew])
        self._dropped[ids] = dropped
        self._pays_posture[ids] = True
        self._heading[ids] = 1.0
        self.noise_share[ids] = 0.0
        self._early_ends.reset(ids)
        if config.noise_share:
            self._add_noise(ids[rng.random(n) < config.noise_share])
        self.random_pushes.reset(ids)

    def _stand_up(self) -> tuple[np.ndarray, np.ndarray]:
        """Draw `NUM_STARTS` starts on the floor and let them stand: states of the engine, joint targets."""
        starts = []
        for _ in range(-(-NUM_STARTS // self.num_envs)):
            self.loop.reset(np.arange(self.num_envs), self._start_joints(self.num_envs))
            starts.append(self.loop.starts())
        states, joint_targets = zip(*starts, strict=True)
        return np.concatenate(states), np.concatenate(joint_targets)

    def _start_joints(self, n: int) -> np.ndarray:
        """Draw start angles (n, num_joints) [rad]."""
        noise = self.generator.uniform(-self.config.joint_noise, self.config.joint_noise, (n, self.robot.num_joints))
        return np.clip(self.loop.nominal + noise, self.robot.joint_lower, self.robot.joint_upper)

    def _add_noise(self, ids: np.ndarray) -> None:
        """Give robots `ids` (n,) noise of a random size."""
        self.noise_share[ids] = size = self.generator.random(len(ids))
        seeds = self.generator.integers(2**31, size=len(ids))
        for robot, share, seed in zip(ids, size, seeds, strict=True):
            noise = Imperfections(share * self.config.observation_noise, share * self.config.action_noise)
            self.loop.set_imperfections(robot, noise, int(seed))


def _at(progress: float, schedule: Schedule) -> float:
    """Value of a schedule at a share of the training done."""
    knots = np.array(schedule)
    return float(np.interp(progress, knots[:, 0], knots[:, 1]))
