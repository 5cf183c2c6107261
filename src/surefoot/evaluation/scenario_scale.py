"""Scenario scale: the package's own scenarios, scaled from the paper's robot to a robot of another size."""

from __future__ import annotations

import dataclasses

from surefoot.evaluation.protocol import PROTOCOL, protocol_for
from surefoot.evaluation.scenarios import Scenario
from surefoot.robots import Robot

_DIGITS = 9


def for_robot(scenario: Scenario, robot: Robot) -> Scenario:
    """The scenario with impulses on the same cells of the robot's grid, and lengths scaled by its legs."""
    impulse = protocol_for(robot).impulse_step / PROTOCOL.impulse_step
    length = robot.length_scale
    return dataclasses.replace(
        scenario,
        impulse=round(impulse * scenario.impulse, _DIGITS),
        preceding_impulse=round(impulse * scenario.preceding_impulse, _DIGITS),
        lever=None if scenario.lever is None else round(length * scenario.lever, _DIGITS),
        drop=round(length * scenario.drop, _DIGITS),
    )
