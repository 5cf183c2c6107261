"""stable-baselines3: the adapter of our environment to its VecEnv."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import gymnasium as gym
import numpy as np
from stable_baselines3.common.vec_env import VecEnv

from surefoot.learning.networks import Mirror
from surefoot.task import observation
from surefoot.task.environment import PushRecoveryVectorEnv
from surefoot.task.memory import Memory
from surefoot.task.privileged import SIGNS


class Normalisation:
    """Inputs as a network sees them: (inputs - mean) / std.

    The mean is the observation of the nominal pose, made left-right symmetric, and the std the table's scales:
    constants, so that no replayed or stored transition goes stale. Past actions are taken as they are.

    Args:
        env: whose robots are observed.
        past_observations, past_actions: how many of them are inputs, too.

    Attributes:
        mean, std: of the inputs (num_inputs,).
        mirrors: of the inputs, see `observation.mirror`, and of the action.
    """

    def __init__(self, env: PushRecoveryVectorEnv, past_observations: int = 0, past_actions: int = 0):
        loop = env.loop
        start = loop.reset(np.array([0]), loop.nominal[None])
        standing = observation.observe(start)[0, 0]
        source, sign = observation.mirror(env.robot)
        past = np.zeros(past_actions * env.robot.num_joints)
        self.mean = np.append(np.tile(0.5 * (standing + sign * standing[source]), 1 + past_observations), past)
        self.std = np.append(np.tile(observation.scales(env.robot), 1 + past_observations), np.ones_like(past))
        for_action = env.robot.mirror_source, env.robot.mirror_sign
        self.mirrors = _joined([(source, sign)] * (1 + past_observations) + [for_action] * past_actions), for_action

    def __call__(self, inputs: np.ndarray) -> np.ndarray:
        """Return normalised inputs (n, num_inputs), float32."""
        return ((inputs - self.mean) / self.std).astype(np.float32)


def _joined(mirrors: list[Mirror]) -> Mirror:
    """Return the mirror of several vectors one after the other."""
    sizes = [len(source) for source, _ in mirrors]
    begins = np.cumsum([0, *sizes[:-1]])
    sources = [begin + source for begin, (source, _) in zip(begins, mirrors, strict=True)]
    return np.concatenate(sources), np.concatenate([sign for _, sign in mirrors])


class SB3VecEnv(VecEnv):
    """The batched environment as stable-baselines3 wants it, with normalised observations.

    Args:
        env: whose robots are to be used.
        privileged: append the privileged observation to every observation, for the critic.
        past_observations, past_actions: what the networks are given of the last policy steps.

    Attributes:
        normalise: what the networks are given.
        meanwhile: if set, what the learner does while the robots move.
    """

    def __init__(
        self,
        env: PushRecoveryVectorEnv,
        privileged: bool = False,
        past_observations: int = 0,
        past_actions: int = 0,
    ):
        self.meanwhile: Callable[[], None] | None = None
        self.privileged = privileged
        self._mover = ThreadPoolExecutor(1)
        self.env = env  # SB3's constructor asks it for its render mode
        (num_observed,) = env.single_observation_space.shape or (0,)
        self.normalise = Normalisation(env, past_observations, past_actions)
        size = len(self.normalise.mean) + privileged * len(SIGNS)
        space = gym.spaces.Box(-np.inf, np.inf, (size,), np.float32)
        super().__init__(env.num_envs, space, env.single_action_space)
        self._memory = Memory(past_observations, past_actions, num_observed, env.robot.num_joints)
        self._memory.prepare(env.num_envs)
        self._everyone = np.arange(env.num_envs)
        self._observations = np.zeros((env.num_envs, num_observed))
        self._no_info: dict[str, Any] = {}
        self._return = np.zeros(env.num_envs)
        self._length = np.zeros(env.num_envs, np.int64)

    def reset(self) -> np.ndarray:
        """Start every robot anew and return what the networks see of them, (num_envs, size) float32."""
        observations, _ = self.env.reset(seed=self._seeds[0])
        self._reset_seeds()
        self._return[:] = 0.0
        self._length[:] = 0
        self._memory.reset(self._everyone)
        return self._seen(observations)

    def step_async(self, actions: np.ndarray) -> None:
        """Take the actions (num_envs, num_joints) of the next policy step; the robots move while `meanwhile` runs."""
        self._memory.add(self._observations, actions, self._everyone)
        if self.meanwhile:
            self._moving = self._mover.submit(self.env.step, actions)
        else:
            self._actions = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Return observations, rewards, ends of episodes and infos of the policy step, as SB3 wants them."""
        if self.meanwhile:
            self.meanwhile()
            observations, rewards, terminated, truncated, info = self._moving.result()
        else:
            observations, rewards, terminated, truncated, info = self.env.step(self._actions)
        done = terminated | truncated
        self._return += rewards
        self._length += 1
        infos = [self._no_info] * self.num_envs
        ended = np.flatnonzero(done)
        if len(ended):
            seen = self._memory.inputs(info["final_obs"][ended], ended)
            final = self._normalised(seen, info["final_privileged"][ended])
            for i, last in zip(ended, final, strict=True):
                infos[i] = {
                    "episode": {"r": self._return[i], "l": int(self._length[i])},
                    "terminal_observation": last,
                    "TimeLimit.truncated": bool(truncated[i]),
                }
            self._return[ended] = 0.0
            self._length[ended] = 0
            self._memory.reset(ended)
        return self._seen(observations), rewards.astype(np.float32), done, infos

    def _seen(self, observations: np.ndarray) -> np.ndarray:
        """Return what the networks are given after observations (num_envs, 47) of all robots."""
        self._observations = observations
        return self._normalised(self._memory.inputs(observations, self._everyone), self.env.privileged_observation())

    def _normalised(self, inputs: np.ndarray, privileged: np.ndarray) -> np.ndarray:
        """Return what the networks see of inputs (n, num_inputs) and privileged observations (n, 12) of n robots."""
        seen = self.normalise(inputs)
        return np.concatenate([seen, privileged], axis=1, dtype=np.float32) if self.privileged else seen

    def close(self) -> None:
        """End the thread that moves the robots."""
        self._mover.shutdown()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute of the environment once for each robot."""
        return [getattr(self.env, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set an attribute of the environment."""
        setattr(self.env, attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Call a method of the environment."""
        return [getattr(self.env, method_name)(*args, **kwargs)]

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """Return False for each robot: SB3's wrappers wrap single environments."""
        return [False] * len(list(self._get_indices(indices)))
