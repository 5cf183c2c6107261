"""stable-baselines3: our environment as its VecEnv."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import gymnasium as gym
import numpy as np
from stable_baselines3.common.vec_env import VecEnv

from surefoot.task import observation
from surefoot.task.environment import PushRecoveryVectorEnv
from surefoot.task.privileged import SIGNS


class Normalisation:
    """Observations as a network sees them: (observation - mean) / std.

    The mean is the observation of the nominal pose, made left-right symmetric, and the std the table's scales:
    constants, so that no replayed or stored transition goes stale.

    Args:
        env: whose robots are observed.
    """

    def __init__(self, env: PushRecoveryVectorEnv):
        loop = env.loop
        start = loop.reset(np.array([0]), loop.nominal[None])
        standing = observation.observe(start)[0, 0]
        source, sign = observation.mirror(env.robot)
        self.mean = 0.5 * (standing + sign * standing[source])
        self.std = observation.scales(env.robot)

    def __call__(self, observations: np.ndarray) -> np.ndarray:
        """Return normalised observations (n, 47), float32."""
        return ((observations - self.mean) / self.std).astype(np.float32)


class SB3VecEnv(VecEnv):
    """The batched environment as stable-baselines3 wants it, with normalised observations.

    Args:
        env: whose robots are to be used.
        privileged: append the privileged observation to every observation, for the critic.

    Attributes:
        meanwhile: if set, what the learner does while the robots move.
    """

    def __init__(self, env: PushRecoveryVectorEnv, privileged: bool = False):
        self.meanwhile: Callable[[], None] | None = None
        self.privileged = privileged
        self._mover = ThreadPoolExecutor(1)
        self.env = env  # SB3's constructor asks it for its render mode
        (num_observed,) = env.single_observation_space.shape or (0,)
        space = gym.spaces.Box(-np.inf, np.inf, (num_observed + privileged * len(SIGNS),), np.float32)
        super().__init__(env.num_envs, space, env.single_action_space)
        self.normalise = Normalisation(env)
        self._no_info: dict[str, Any] = {}
        self._return = np.zeros(env.num_envs)
        self._length = np.zeros(env.num_envs, np.int64)

    def reset(self) -> np.ndarray:
        """Start every robot anew and return what the networks see of them, (num_envs, size) float32."""
        observations, _ = self.env.reset(seed=self._seeds[0])
        self._reset_seeds()
        self._return[:] = 0.0
        self._length[:] = 0
        return self._seen(observations, self.env.privileged_observation())

    def step_async(self, actions: np.ndarray) -> None:
        """Take the actions (num_envs, num_joints) of the next policy step; the robots move while `meanwhile` runs."""
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
            final = self._seen(info["final_obs"][ended], info["final_privileged"][ended])
            for i, last in zip(ended, final, strict=True):
                infos[i] = {
                    "episode": {"r": self._return[i], "l": int(self._length[i])},
                    "terminal_observation": last,
                    "TimeLimit.truncated": bool(truncated[i]),
                }
            self._return[ended] = 0.0
            self._length[ended] = 0
        return self._seen(observations, self.env.privileged_observation()), rewards.astype(np.float32), done, infos

    def _seen(self, observations: np.ndarray, privileged: np.ndarray) -> np.ndarray:
        """Return what the networks see of observations (n, 47) and privileged observations (n, 12) of n robots."""
        seen = self.normalise(observations)
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
