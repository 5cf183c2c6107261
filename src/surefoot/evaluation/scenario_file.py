"""Scenario files: suites by name, and scenarios of a user, in TOML. The package's own suites are such files."""

from __future__ import annotations

import dataclasses
import importlib.resources
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from surefoot.checks import (
    MAX_NAME,
    check_number,
    check_path,
    check_text,
    is_number,
    parse_json_table,
    parse_toml,
    read_text,
    shortened,
)
from surefoot.errors import UserError, notice
from surefoot.evaluation.protocol import PROTOCOL
from surefoot.evaluation.scenario_scale import for_robot
from surefoot.evaluation.scenarios import DIRECTIONS, OLD_KEYS, ROOT, UNITS, Scenario
from surefoot.rates import CONTROL_HZ, POLICY_DT
from surefoot.robots import Robot

SUITE_NAMES = ("push", "paper", "robustness", "ring")
"""Suites that come with the package."""

_FIELDS = tuple(field.name for field in dataclasses.fields(Scenario))
_RANGES: dict[str, tuple[float, float]] = {
    "duration": (1.0 / CONTROL_HZ, 5.0),
    "impulse": (0.0, 2000.0),
    "drop": (0.0, 5.0),
    "preceding_impulse": (0.0, 2000.0),
    "lever": (-1.1, 1.0),
    "trials": (1, 10_000),
    "horizon": (2.0, 600.0),
    "quiet_from": (0.0, 600.0),
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
MAX_TRIALS = 100_000
"""Of a scenario in which nothing is searched, over all its directions."""


def suite(name: str, robot: Robot | None = None) -> tuple[Scenario, ...]:
    """A suite by its name, or the scenarios of a TOML file.

    Args:
        name: of a suite of the package, or of a file.
        robot: that is tested. The sizes of a suite of the package are scaled to it; those of a file are its own. Its
            bodies are those that a file may name; without it, bodies are not checked.

    Raises:
        UserError: there is neither, or the file is wrong; the message names the scenario and its key.
    """
    if name in SUITE_NAMES:
        file = importlib.resources.files("surefoot.evaluation") / "suites" / f"{name}.toml"
        scenarios = _read(file.read_text(), f"suite {name}", None)
        return tuple(for_robot(scenario, robot) for scenario in scenarios) if robot else scenarios
    check_path("suite", name)
    path = Path(name)
    if not path.exists() or path.is_dir():
        raise UserError(f"unknown suite '{name}'; valid: {', '.join(SUITE_NAMES)}, or a scenario file (.toml)")
    return _read(read_text(path, "scenario file"), str(path), robot)


def _read(text: str, file: str, robot: Robot | None) -> tuple[Scenario, ...]:
    """The scenarios of a file's text; `file` names it in messages."""
    entries = parse_toml(text, f"{file} as a scenario file")
    unknown = set(entries) - {"scenario"}
    if unknown or not isinstance(entries.get("scenario"), list) or not entries["scenario"]:
        raise UserError(f"{file} must hold [[scenario]] entries and nothing else{_named(unknown)}")
    scenarios = tuple(
        _scenario(entry, f"{file}, scenario {i + 1}", robot) for i, entry in enumerate(entries["scenario"])
    )
    twice = _repeated(scenario.name for scenario in scenarios)
    if twice:
        raise UserError(f"{file}: two scenarios are named {', '.join(sorted(twice))}")
    return scenarios


def _scenario(entry: Any, where: str, robot: Robot | None) -> Scenario:
    """The scenario of one entry; `where` names it in messages."""
    if not isinstance(entry, dict):
        raise UserError(f"{where}: must be a [[scenario]] entry, not {shortened(entry)}")
    return _checked(_renamed(entry, where), where, robot)


def stored_scenario(text: str) -> Scenario:
    """The scenario that results keep as JSON, checked as one of a file; keys of version 0.1 are understood.

    Raises:
        UserError: the text is anything else.
    """
    values = parse_json_table(text, "a scenario")
    entry = {OLD_KEYS.get(key, key): value for key, value in values.items() if value is not None}
    return _checked(entry, "a scenario", None)


def _checked(entry: dict[str, Any], where: str, robot: Robot | None) -> Scenario:
    """The scenario of an entry with today's keys."""
    unknown = set(entry) - set(_FIELDS)
    if unknown:
        raise UserError(f"{where}: unknown key{_named(unknown)}; valid: {', '.join(_FIELDS)}")
    if not entry.get("name"):
        raise UserError(f"{where}: a name is needed")
    check_text(f"{where}: name", entry["name"], MAX_NAME)
    where = f"{where} ({entry['name']})"
    values: dict[str, Any] = {key: _value(key, value, where) for key, value in entry.items()}
    scenario = Scenario(**values)
    if robot is not None:
        scenario = _with_known_body(scenario, robot, where)
    _check_together(scenario, where)
    return scenario


def _renamed(entry: dict[str, Any], where: str) -> dict[str, Any]:
    """The entry with today's keys in the place of those that had other names until version 0.1."""
    for old in sorted(set(entry) & set(OLD_KEYS)):
        notice(f"{where}: the key {old} is called {OLD_KEYS[old]} now")
    return {OLD_KEYS.get(key, key): value for key, value in entry.items()}


def _with_known_body(scenario: Scenario, robot: Robot, where: str) -> Scenario:
    """The scenario, whose body the robot has; the robot's own word for its root is understood too."""
    if scenario.body == robot.root:
        return dataclasses.replace(scenario, body=ROOT)
    try:
        robot.body_id(scenario.body)
    except UserError as error:
        raise UserError(f"{where}: {error}") from error
    return scenario


def _check_together(scenario: Scenario, where: str) -> None:
    """Check what no value can be told of alone."""
    twice = _repeated(line.name for line in scenario.lines())
    if twice:
        raise UserError(f"{where}: direction '{twice[0]}' is given twice")
    num_trials = scenario.trials * len(scenario.lines())
    if not scenario.search and num_trials > MAX_TRIALS:
        raise UserError(f"{where}: {num_trials:,} trials are too many; valid: up to {MAX_TRIALS:,}")
    if scenario.search not in ("", *UNITS):
        raise UserError(f"{where}: unknown search '{scenario.search}'; valid: {', '.join(UNITS)}, or nothing")
    if scenario.search == "tilt" and not scenario.drop:
        raise UserError(f"{where}: a searched tilt needs a drop height")
    if scenario.physics_hz % CONTROL_HZ:
        raise UserError(f"{where}: physics_hz must be a multiple of {CONTROL_HZ}, not {scenario.physics_hz}")
    if scenario.quiet_from >= scenario.horizon:
        raise UserError(f"{where}: quiet_from must be before the horizon, not {scenario.quiet_from:g} s")
    last = scenario.duration + (scenario.push_interval[1] if scenario.preceding_impulse else 0.0)
    judged_from = scenario.horizon - PROTOCOL.judged_time
    if last > judged_from:
        raise UserError(
            f"{where}: the push may last until {last:g} s, but from {judged_from:g} s on the robot is judged"
        )


def _value(key: str, value: Any, where: str) -> Any:
    """The value of a key as `Scenario` takes it."""
    if key == "directions":
        return _directions(value, where)
    if key == "push_interval":
        return _interval(value, where)
    if key in _RANGES:
        return _number(key, value, where)
    expected = bool if key in ("without_step", "within_limits", "half", "preceding_upward") else str
    if not isinstance(value, expected):
        raise UserError(
            f"{where}: {key} must be {'true or false' if expected is bool else 'a text'}, not {shortened(value)}"
        )
    return value


def _number(key: str, value: Any, where: str) -> float:
    low, high = _RANGES[key]
    whole = key in _WHOLE_NUMBERS
    checked = check_number(f"{where}: {key}", value, low, high, whole=whole)
    return checked if whole else float(checked)


def _interval(value: Any, where: str) -> tuple[float, ...]:
    if not (isinstance(value, list) and len(value) == 2 and all(is_number(v) for v in value)):
        raise UserError(f"{where}: push_interval must be two times [s], not {shortened(value)}")
    if not 0.0 <= value[0] <= value[1] <= 5.0:
        raise UserError(f"{where}: push_interval must be a range within 0 to 5 s, not {value}")
    return tuple(float(v) for v in value)


def _directions(value: Any, where: str) -> Any:
    if isinstance(value, int) and not isinstance(value, bool) and 1 <= value <= 360:
        return value
    if isinstance(value, list) and value and all(_is_direction(v) for v in value):
        return tuple(v if isinstance(v, str) else float(v) for v in value)
    raise UserError(
        f"{where}: directions must be how many (1 to 360) or a list of degrees and of {', '.join(DIRECTIONS)}, "
        f"not {shortened(value)}"
    )


def _is_direction(value: Any) -> bool:
    return value in DIRECTIONS if isinstance(value, str) else (is_number(value) and abs(value) <= 360.0)


def _repeated(names: Iterable[str]) -> list[str]:
    """Names that occur more than once."""
    found = list(names)
    return [name for name in dict.fromkeys(found) if found.count(name) > 1]


def _named(names: set[str]) -> str:
    return f": {', '.join(sorted(names))}" if names else ""
