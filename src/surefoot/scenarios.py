"""Scenarios: the paper's tests and ours, as data. Users add their own from a TOML file (docs/scenarios.md)."""

from __future__ import annotations

import dataclasses
import math
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from surefoot.control import Imperfections
from surefoot.disturbance import PUSH_DURATION, Drop, Push
from surefoot.errors import UserError
from surefoot.judge import CALM_FROM_S, HORIZON_S, JUDGED_S, Outcome
from surefoot.robot import World, load_robot
from surefoot.simulation import CONTROL_HZ, POLICY_DT
from surefoot.trials import Trial

DIRECTIONS = {"forward": 0.0, "left": 0.5 * np.pi, "backward": np.pi, "right": 1.5 * np.pi}
"""Angles in the horizontal plane [rad], counter-clockwise from +x."""

GRIDS = {"impulse": (6.0, 900.0), "height": (0.05, 3.0), "tilt": (1.0, 60.0)}
"""What can be searched -> step of its grid and where the search ends: Ns (the paper's 50 N for 0.12 s), m, degrees."""
UNITS = {"impulse": "Ns", "height": "m", "tilt": "deg"}


@dataclass(frozen=True)
class Scenario:
    """One test: a disturbance, under what conditions, and what is asked for. These are the keys of a scenario file.

    Attributes:
        name: key of its figures.
        search: what is searched for its largest recovered value: "impulse" [Ns], "height" [m] or "tilt" [deg];
            "" runs a fixed disturbance instead.
        directions: of push and tilt: names (forward, left, backward, right), degrees counter-clockwise from +x, or
            how many, evenly spaced.
        body, lever, duration: of the push, see `Push`.
        impulse: of the push if it is not searched [Ns].
        drop: height from which the robot is dropped, if it is not searched [m].
        first_impulse: of a push before the other one [Ns]; 0 for none.
        first_up: the first push lifts the robot instead of pushing it in the same direction.
        gap: range of the time from the first push's start to the other's [s]; drawn by the seed.
        without_step: recovered only counts if no foot left its place.
        trials: per direction, if nothing is searched.
        horizon, calm_from: see `Trial` [s].
        observation_noise, action_noise, sensor_bias, latency: see `Imperfections`.
        friction, mass_scale, motor_strength, slope_deg, uphill_deg, physics_hz: see `World`; angles in degrees.
    """

    name: str
    search: str = "impulse"
    directions: tuple[str | float, ...] | int = 4
    body: str = "pelvis"
    lever: float | None = None
    duration: float = PUSH_DURATION
    impulse: float = 0.0
    drop: float = 0.0
    first_impulse: float = 0.0
    first_up: bool = False
    gap: tuple[float, float] = (0.0, 0.0)
    without_step: bool = False
    trials: int = 8
    horizon: float = HORIZON_S
    calm_from: float = CALM_FROM_S
    observation_noise: float = 0.0
    action_noise: float = 0.0
    sensor_bias: float = 0.0
    latency: float = 0.0
    friction: float = 1.0
    mass_scale: float = 1.0
    motor_strength: float = 1.0
    slope_deg: float = 0.0
    uphill_deg: float = 0.0
    physics_hz: int = CONTROL_HZ

    @property
    def world(self) -> World:
        slope, uphill = math.radians(self.slope_deg), math.radians(self.uphill_deg)
        return World(self.friction, self.mass_scale, self.motor_strength, slope, uphill, self.physics_hz)

    @property
    def imperfections(self) -> Imperfections:
        return Imperfections(self.observation_noise, self.action_noise, self.sensor_bias, self.latency)

    @property
    def unit(self) -> str:
        return UNITS.get(self.search, "Ns")

    def lines(self) -> list[Line]:
        """One per direction."""
        if isinstance(self.directions, int):
            degrees: Sequence[str | float] = (np.arange(self.directions) * 360.0 / self.directions).tolist()
        else:
            degrees = self.directions
        angles = [DIRECTIONS[d] if isinstance(d, str) else math.radians(d) for d in degrees]
        return [Line(self, _direction_name(angle), angle) for angle in angles]


@dataclass(frozen=True)
class Line:
    """One direction of a scenario, along which its size is searched or its trials are run.

    Attributes:
        name: of the direction.
        angle: in the horizontal plane [rad], counter-clockwise from the robot's +x.
    """

    scenario: Scenario
    name: str
    angle: float

    @property
    def grid(self) -> float:
        return GRIDS[self.scenario.search][0]

    @property
    def num_cells(self) -> int:
        step, end = GRIDS[self.scenario.search]
        return round(end / step)

    def size(self, cell: int) -> float:
        """Of a cell of the grid, in the scenario's unit."""
        return round(cell * self.grid, 9)

    def trial(self, cell: int, seed: int, whole: bool) -> Trial:
        """The trial of cell `cell`: `size(cell)` Ns, m or degrees."""
        return self._trial(seed, whole, **{self.scenario.search: self.size(cell)})

    def fixed_trials(self) -> list[Trial]:
        """The trials of a scenario in which nothing is searched."""
        return [self._trial(seed, whole=True) for seed in range(self.scenario.trials)]

    def succeeded(self, outcome: Outcome) -> bool:
        return outcome.without_step if self.scenario.without_step else outcome.recovered

    def _trial(self, seed: int, whole: bool, *, impulse: float | None = None, height: float | None = None, tilt=0.0):
        s = self.scenario
        along = (round(math.cos(self.angle), 12) + 0.0, round(math.sin(self.angle), 12) + 0.0, 0.0)  # never -0.0
        size = s.impulse if impulse is None else impulse
        dropped = s.drop if height is None else height
        first = None
        start = 0.0
        if s.first_impulse:
            first = Push(direction=(0.0, 0.0, 1.0) if s.first_up else along, impulse=s.first_impulse)
            start = float(np.random.default_rng([seed, 1]).uniform(*s.gap))
        return Trial(
            push=Push(s.body, along, size, start, s.duration, s.lever),
            seed=seed,
            whole=whole,
            first=first,
            drop=Drop(dropped, *self._lean(tilt)) if dropped or s.search == "height" else None,
            imperfections=s.imperfections,
            world=s.world,
            horizon=s.horizon,
            calm_from=s.calm_from,
        )

    def _lean(self, tilt: float) -> tuple[float, float]:
        """Roll and pitch [rad] of a robot that leans by `tilt` degrees towards the line's direction."""
        lean = math.radians(tilt)
        return -lean * round(math.sin(self.angle), 12), lean * round(math.cos(self.angle), 12)


def _direction_name(angle: float) -> str:
    degrees = round(math.degrees(angle), 6) % 360.0
    names = {round(math.degrees(a), 6): name for name, a in DIRECTIONS.items()}
    return names.get(degrees, f"{degrees:g}")


SINGLE = {
    "sagittal_24": Scenario("sagittal_24", search="", directions=("forward",), impulse=24.0),
    "sagittal_72": Scenario("sagittal_72", search="", directions=("forward",), impulse=72.0),
    "sagittal_240": Scenario("sagittal_240", search="", directions=("forward",), impulse=240.0),
    "lateral_78": Scenario("lateral_78", search="", directions=("left",), impulse=78.0),
}
"""The paper's four pushes of Table II (section V-A)."""

NOISE = {
    "noise_observation": Scenario("noise_observation", observation_noise=0.5),
    "noise_action": Scenario("noise_action", action_noise=0.1),
    "noise_both": Scenario("noise_both", observation_noise=0.5, action_noise=0.1),
}
"""Section V-D of the paper: noise on the observation before its filter, and on the joint targets [rad]."""

# Levers of the paper's Table III: above the CoM at the torso, below it at the leg.
PAPER: tuple[Scenario, ...] = (
    Scenario("pelvis_push"),
    Scenario("pelvis_push_no_step", without_step=True),
    Scenario("torso_push", body="torso", lever=0.32),
    Scenario("thigh_push", body="left_thigh", lever=-0.50),
    Scenario("shank_push", body="left_shank", lever=-0.70),
    Scenario("landing_height", search="height", directions=1),
    Scenario("landing_tilt", search="tilt", drop=0.4),
    Scenario("combined", first_impulse=500.0, first_up=True, gap=(0.24, 0.24)),
    *NOISE.values(),
    *SINGLE.values(),
    Scenario("standing", search="", directions=1, calm_from=0.0),
    Scenario("drop_055", search="", directions=1, drop=0.55),
    Scenario("quiet", search="", directions=1, horizon=60.0, calm_from=0.0),
    Scenario("quiet_after_48", search="", impulse=48.0),
    Scenario("quiet_after_102", search="", impulse=102.0),
    Scenario("quiet_after_150", search="", impulse=150.0),
)
"""Everything that the paper tests, and quiet standing."""

PELVIS_16 = Scenario("pelvis_push", directions=16)

ROBUSTNESS: tuple[Scenario, ...] = (
    *(Scenario(f"duration_{round(1000 * s)}ms", duration=s) for s in (0.02, 0.05, 0.25, 0.5)),
    Scenario("while_stepping", first_impulse=120.0, gap=(0.3, 2.0)),
    Scenario("two_pushes", first_impulse=90.0, gap=(1.0, 1.0)),
    *(Scenario(f"friction_{f:g}", friction=f) for f in (0.3, 0.5, 0.7, 1.2)),
    Scenario("mass_90", mass_scale=0.9),
    Scenario("mass_110", mass_scale=1.1),
    Scenario("motor_80", motor_strength=0.8),
    *(Scenario(f"latency_{round(1000 * s)}ms", latency=s) for s in (0.01, 0.02, 0.04)),
    Scenario("sensor_bias", sensor_bias=0.1),
    *(Scenario(f"slope_{d}_{way}", slope_deg=d, uphill_deg=u) for d in (4, 8) for way, u in (("up", 0), ("side", 90))),
    Scenario("physics_1000hz", physics_hz=1000),
)
"""Beyond the paper: what else a push can be, and how far a robot can be from its model."""

SUITES = {"paper": PAPER, "robustness": ROBUSTNESS}


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


def from_json(values: dict[str, Any]) -> Scenario:
    """The scenario that `dataclasses.asdict` gave, after JSON made lists of its tuples."""
    restored: dict[str, Any] = {key: tuple(v) if isinstance(v, list) else v for key, v in values.items()}
    return Scenario(**restored)


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
