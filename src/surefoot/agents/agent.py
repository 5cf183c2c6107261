"""Agents: whoever moves the robots in a trial."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from surefoot.agents.contract import Contract


class Named(Protocol):
    """Whoever enters the trials, a policy or a controller: by what results name it."""

    @property
    def name(self) -> str: ...

    @property
    def contract(self) -> Contract: ...

    @property
    def digest(self) -> str:
        """By which results name it: equal only for those that act alike."""
        ...


class Policy(Named, Protocol):
    """Anything that maps what a robot can measure to joint targets."""

    def reset(self, ids: np.ndarray) -> None:
        """Robots `ids` (n,) begin a trial: forget them."""

    def __call__(self, observations: np.ndarray, ids: np.ndarray) -> np.ndarray:
        """Actions (n, num_joints) for the filtered observations (n, 47) of robots `ids` (n,)."""
        ...
