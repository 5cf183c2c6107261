"""Imperfections of sensors and actuators."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Imperfections:
    """The imperfections of sensors and actuators; the defaults are those of a perfect robot.

    Attributes:
        observation_noise: standard deviation of Gaussian noise on the observation vector, in its own units, new at
            every tick and added before the filter.
        action_noise: the same on the joint targets [rad], new at every policy step.
        sensor_bias: standard deviation of what is wrong with each component of the vector throughout, in the
            component's typical deviation (`observation.scales`).
        latency: from an action to its joint targets [s], at most a policy step.
    """

    observation_noise: float = 0.0
    action_noise: float = 0.0
    sensor_bias: float = 0.0
    latency: float = 0.0


PERFECT = Imperfections()
