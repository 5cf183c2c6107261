"""Domain parameters: the properties of the ground and the robot that may differ from the model."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class DomainParameters:
    """The properties of the ground and the robot that may differ from the model; the defaults are the model's.

    Attributes:
        friction: coefficient of sliding friction between feet and floor; the model's own without it.
        mass_scale: of every body's mass and inertia.
        motor_strength: of every joint's largest torque.
        slope: angle of the floor [rad]; it rises towards `uphill`.
        uphill: direction in the horizontal plane [rad], counter-clockwise from +x.
        physics_hz: rate of the physics; the joint control stays at 500 Hz.
    """

    friction: float | None = None
    mass_scale: float = 1.0
    motor_strength: float = 1.0
    slope: float = 0.0
    uphill: float = 0.0
    physics_hz: int = 500


NOMINAL_DOMAIN = DomainParameters()
