"""Memory: the observations and actions of the last policy steps, for policies that use more than the present."""

from __future__ import annotations

import numpy as np


class Memory:
    """The observations and actions of each robot of a batch in its last policy steps.

    A policy's input is the present observation, then the past observations, then the past actions; in both the newest
    comes first. At a robot's first policy step its past observations all equal the present one, and its past actions
    are zero.

    Args:
        past_observations: how many are kept.
        past_actions: how many are kept.
        observation_size: components of an observation.
        action_size: components of an action.
    """

    def __init__(self, past_observations: int, past_actions: int, observation_size: int, action_size: int):
        self._observed = np.zeros((0, past_observations, observation_size))
        self._acted = np.zeros((0, past_actions, action_size))
        self._is_new = np.zeros(0, bool)

    def prepare(self, num_robots: int) -> None:
        """Remember robots 0 to `num_robots` - 1, and forget all that is known of robots."""
        self._observed = np.zeros((num_robots, *self._observed.shape[1:]))
        self._acted = np.zeros((num_robots, *self._acted.shape[1:]))
        self._is_new = np.ones(num_robots, bool)

    def reset(self, ids: np.ndarray) -> None:
        """Forget robots `ids` (n,)."""
        self._is_new[ids] = True

    def inputs(self, observations: np.ndarray, ids: np.ndarray) -> np.ndarray:
        """Return a policy's inputs for the present observations (n, observation_size) of robots `ids` (n,)."""
        new = self._is_new[ids]
        self._observed[ids[new]] = observations[new, None]
        self._acted[ids[new]] = 0.0
        self._is_new[ids[new]] = False
        past = self._observed[ids].reshape(len(ids), -1), self._acted[ids].reshape(len(ids), -1)
        return np.concatenate([observations, *past], axis=1)

    def add(self, observations: np.ndarray, actions: np.ndarray, ids: np.ndarray) -> None:
        """Remember a policy step of robots `ids` (n,): its observations and its actions, clipped to [-1, 1]."""
        for kept, newest in ((self._observed, observations), (self._acted, np.clip(actions, -1.0, 1.0))):
            if kept.shape[1]:
                kept[ids, 1:] = kept[ids, :-1]
                kept[ids, 0] = newest
