"""Observing agents: agents that receive the filtered observation at 25 Hz."""

from __future__ import annotations

from collections import Counter

import numpy as np

from surefoot.task.agent import Gains, Inputs
from surefoot.task.contract import Contract


class ObservingAgent:
    """The common part of networks and the nominal pose: they see the observation and remember nothing.

    Attributes:
        contract: what it assumes about the robot.
        failures: how often it has failed a robot, by reason.
    """

    inputs: Inputs = "observation"
    clips_targets: bool = True

    def __init__(self, contract: Contract):
        self.contract = contract
        self.failures: Counter[str] = Counter()

    @property
    def rate_hz(self) -> int:
        """Control steps per second."""
        return self.contract.policy_hz

    @property
    def path(self) -> str:
        """How the joints get from one control step's targets to the next one's."""
        return self.contract.target_path

    @property
    def gains(self) -> Gains:
        """The joint impedance that it counts on."""
        return Gains(np.array(self.contract.stiffness), np.array(self.contract.damping))

    def prepare(self, num_robots: int) -> None:
        """Get ready for so many robots: there is nothing to do."""

    def reset(self, ids: np.ndarray) -> None:
        """Forget robots `ids` (n,): nothing is remembered."""
