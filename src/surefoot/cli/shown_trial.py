"""Shown trial: the trial that a film or a picture shows, built from a command's options."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from surefoot.checks import MAX_SEED, check_number
from surefoot.errors import UserError

if TYPE_CHECKING:
    from surefoot.evaluation.trials import Trial
    from surefoot.robots import Robot


def scenario_trial(robot: Robot, name: str, direction: str, size: float, seed: int) -> Trial:
    """The full-length trial of a robot in a scenario.

    Args:
        robot: the robot of the trial.
        name: of the scenario, or FILE.toml:NAME.
        direction: of one of its lines.
        size: on the grid of what it searches; it means nothing if the scenario searches nothing.
        seed: of the trial.

    Raises:
        UserError: there is no such scenario, direction, size or seed.
    """
    from surefoot.evaluation.protocol import protocol_for
    from surefoot.evaluation.scenario_file import SUITE_NAMES, suite
    from surefoot.evaluation.scenarios import canonical_name

    file, _, key = name.rpartition(":")
    among = [scenario for each in ([file] if file else SUITE_NAMES) for scenario in suite(each, robot)]
    scenarios = {scenario.name: scenario for scenario in among}
    key = key if key in scenarios else canonical_name(key, robot.root)
    if key not in scenarios:
        raise UserError(f"unknown scenario '{key}'; valid: {', '.join(scenarios)}")
    lines = {line.name: line for line in scenarios[key].lines(protocol_for(robot))}
    if direction not in lines:
        raise UserError(f"{key} has no direction '{direction}'; valid: {', '.join(lines)}")
    line = lines[direction]
    if not line.scenario.search:
        if not 0 <= seed < line.scenario.trials:
            raise UserError(f"seed of {key} must be 0 to {line.scenario.trials - 1}, not {seed}")
        return line.fixed_trials()[seed]
    cell = round(size / line.grid) if np.isfinite(size) else 0
    if not 1 <= cell <= line.num_cells or abs(line.size(cell) - size) > 1e-6:
        valid = f"multiples of {line.grid:g} up to {line.size(line.num_cells):g} {line.scenario.unit}"
        raise UserError(f"{key} has no size {size:g}; valid: {valid}")
    check_number("seed", seed, 0, MAX_SEED, whole=True)
    return line.trial(cell, seed, full_length=True)


def push_trial(robot: Robot, body: str, direction: str, impulse: float, duration: float, seed: int) -> Trial:
    """The trial of one push.

    Raises:
        UserError: there is no such body or direction, or a number will not do.
    """
    from surefoot.evaluation.scenarios import angle_deg
    from surefoot.evaluation.trials import Trial
    from surefoot.physics.pushes import horizontal_push

    robot.body_id(body)
    angle = angle_deg(direction)
    for name, value in (("impulse", impulse), ("duration", duration)):
        check_number(name, value, 0.0, above=True)
    check_number("seed", seed, 0, MAX_SEED, whole=True)
    return Trial(horizontal_push(body, angle, impulse, duration), seed)
