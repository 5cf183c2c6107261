"""Scenarios: the paper's tests and ours, as data. Users add their own from a TOML file (docs/scenarios.md)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from surefoot.evaluation.outcome import Outcome
from surefoot.evaluation.trial_monitor import CALM_FROM_S, HORIZON_S
from surefoot.evaluation.trials import Trial
from surefoot.physics.pushes import PUSH_DURATION, Drop, Push
from surefoot.rates import CONTROL_HZ
from surefoot.robots.domain import DomainParameters
from surefoot.task.imperfections import Imperfections

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
        friction, mass_scale, motor_strength, slope_deg, uphill_deg, physics_hz: see `DomainParameters` [deg].
    """

    name: str
    search: str = "impulse"
    directions: tuple[str | float, ...] | int = 4
    body: str = "root"
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
    def domain(self) -> DomainParameters:
        slope, uphill = math.radians(self.slope_deg), math.radians(self.uphill_deg)
        return DomainParameters(self.friction, self.mass_scale, self.motor_strength, slope, uphill, self.physics_hz)

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
            domain=s.domain,
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
    Scenario("root_push"),
    Scenario("root_push_no_step", without_step=True),
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


ROOT_16 = Scenario("root_push", directions=16)


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


def from_json(values: dict[str, Any]) -> Scenario:
    """The scenario that `dataclasses.asdict` gave, after JSON made lists of its tuples."""
    restored: dict[str, Any] = {key: tuple(v) if isinstance(v, list) else v for key, v in values.items()}
    return Scenario(**restored)
