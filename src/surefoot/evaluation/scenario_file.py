"""Scenario files: suites by name, and scenarios of a user in TOML."""

from __future__ import annotations

import dataclasses
import math
import tomllib
from pathlib import Path
from typing import Any

from surefoot.errors import UserError
from surefoot.evaluation.scenarios import DIRECTIONS, GRIDS, SUITES, Scenario
from surefoot.evaluation.trial_monitor import JUDGED_S
from surefoot.rates import CONTROL_HZ, POLICY_DT
from surefoot.robots import load_robot


def suite(name: str) -> tuple[Scenario, ...]:
    """A suite by its name, or the scenarios of a TOML file.

    Raises:
        UserError: there is neither, or the file is wrong; the message names the scenario and its key.
    """
    if name in SUITES:
        return SUITES[name]
    file = Path(name)
    if not file.is_file():
        raise UserError(f"unknown suite '{name}'; valid: {', '.join(SUITES)}, or a scenario file (.toml)")
    try:
        entries = tomllib.loads(file.read_text())
    except (OSError, ValueError) as error:  # not UTF-8, not TOML, or a number of thousands of digits
        raise UserError(f"cannot read {file} as a scenario file: {error}") from error
    unknown = set(entries) - {"scenario"}
    if unknown or not isinstance(entries.get("scenario"), list) or not entries["scenario"]:
        raise UserError(f"{file} must hold [[scenario]] entries and nothing else{_named(unknown)}")
    scenarios = tuple(_read(entry, f"{file}, scenario {i + 1}") for i, entry in enumerate(entries["scenario"]))
    names = [scenario.name for scenario in scenarios]
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        raise UserError(f"{file}: two scenarios are named {', '.join(sorted(twice))}")
    return scenarios


_FIELDS = {field.name: field for field in dataclasses.fields(Scenario)}


_RANGES: dict[str, tuple[float, float]] = {
    "duration": (1.0 / CONTROL_HZ, 5.0),
    "impulse": (0.0, 2000.0),
    "drop": (0.0, 5.0),
    "first_impulse": (0.0, 2000.0),
    "lever": (-1.1, 1.0),
    "trials": (1, 10_000),
    "horizon": (2.0, 600.0),
    "calm_from": (0.0, 600.0),
    "observation_noise": (0.0, 100.0),
    "action_noise": (0.0, 10.0),
    "sensor_bias": (0.0, 100.0),
    "latency": (0.0, POLICY_DT),
    "friction": (0.01, 10.0),
    "mass_scale": (0.1, 10.0),
    "motor_strength": (0.01, 10.0),
    "slope_deg": (0.0, 45.0),
    "uphill_deg": (-360.0, 360.0),
    "physics_hz": (CONTROL_HZ, 8 * CONTROL_HZ),
}
"""Valid values of the numbers, both ends included."""


_WHOLE_NUMBERS = ("trials", "physics_hz")


def _read(entry: Any, where: str) -> Scenario:
    if not isinstance(entry, dict):
        raise UserError(f"{where}: must be a [[scenario]] entry, not {entry}")
    unknown = set(entry) - set(_FIELDS)
    if unknown:
        raise UserError(f"{where}: unknown key{_named(unknown)}; valid: {', '.join(_FIELDS)}")
    if not isinstance(entry.get("name"), str) or not entry["name"]:
        raise UserError(f"{where}: a name is needed")
    where = f"{where} ({entry['name']})"
    values: dict[str, Any] = {key: _value(key, value, where) for key, value in entry.items()}
    scenario = Scenario(**values)
    try:
        load_robot().body_id(scenario.body)
    except UserError as error:
        raise UserError(f"{where}: {error}") from error
    names = [line.name for line in scenario.lines()]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise UserError(f"{where}: direction '{twice}' is given twice")
    if scenario.search not in ("", *GRIDS):
        raise UserError(f"{where}: unknown search '{scenario.search}'; valid: {', '.join(GRIDS)}, or nothing")
    if scenario.search == "tilt" and not scenario.drop:
        raise UserError(f"{where}: a searched tilt needs a drop height")
    if scenario.physics_hz % CONTROL_HZ:
        raise UserError(f"{where}: physics_hz must be a multiple of {CONTROL_HZ}, not {scenario.physics_hz}")
    if scenario.calm_from >= scenario.horizon:
        raise UserError(f"{where}: calm_from must be before the horizon, not {scenario.calm_from:g} s")
    last = scenario.duration + (scenario.gap[1] if scenario.first_impulse else 0.0)
    if last > scenario.horizon - JUDGED_S:
        raise UserError(
            f"{where}: the push may last until {last:g} s, but from {scenario.horizon - JUDGED_S:g} s on "
            "the robot is judged"
        )
    return scenario


def _value(key: str, value: Any, where: str) -> Any:
    if key == "directions":
        return _directions(value, where)
    if key == "gap":
        if not (isinstance(value, list) and len(value) == 2 and all(_is_number(v) for v in value)):
            raise UserError(f"{where}: gap must be two times [s], not {value}")
        if not 0.0 <= value[0] <= value[1] <= 5.0:
            raise UserError(f"{where}: gap must be a range within 0 to 5 s, not {value}")
        return tuple(float(v) for v in value)
    if key in _RANGES:
        low, high = _RANGES[key]
        if not _is_number(value) or not low <= value <= high:
            raise UserError(f"{where}: {key} must be a number from {low:g} to {high:g}, not {value}")
        if key in _WHOLE_NUMBERS and value != int(value):
            raise UserError(f"{where}: {key} must be a whole number, not {value}")
        return int(value) if key in _WHOLE_NUMBERS else float(value)
    expected = bool if key in ("without_step", "first_up") else str
    if not isinstance(value, expected):
        raise UserError(f"{where}: {key} must be {'true or false' if expected is bool else 'a text'}, not {value}")
    return value


def _directions(value: Any, where: str) -> Any:
    if isinstance(value, int) and not isinstance(value, bool) and 1 <= value <= 360:
        return value
    if isinstance(value, list) and value and all(_is_direction(v) for v in value):
        return tuple(v if isinstance(v, str) else float(v) for v in value)
    raise UserError(
        f"{where}: directions must be how many (1 to 360) or a list of degrees and of {', '.join(DIRECTIONS)}, "
        f"not {value}"
    )


def _is_direction(value: Any) -> bool:
    return value in DIRECTIONS if isinstance(value, str) else (_is_number(value) and abs(value) <= 360.0)


def _is_number(value: Any) -> bool:
    # An integer is finite, however large; `math.isfinite` would have to make a float of it.
    whole = isinstance(value, int) and not isinstance(value, bool)
    return whole or (isinstance(value, float) and math.isfinite(value))


def _named(names: set[str]) -> str:
    return f": {', '.join(sorted(names))}" if names else ""
