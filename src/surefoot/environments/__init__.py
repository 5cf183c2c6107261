"""Environments: the task as gymnasium environments, one robot (`gym.make`) or a batch (`gym.make_vec`), with pictures.

``import surefoot`` makes them known to gymnasium, where it is installed.
"""

from __future__ import annotations

import gymnasium as gym

ENV_ID = "surefoot/PushRecovery-v0"


def register() -> None:
    """Make the environments known to gymnasium, without loading them."""
    if ENV_ID not in gym.registry:
        gym.register(
            ENV_ID,
            entry_point="surefoot.environments.single:PushRecoveryEnv",
            vector_entry_point="surefoot.environments.batch:PushRecoveryBatch",
        )
