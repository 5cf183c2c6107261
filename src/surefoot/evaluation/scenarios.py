"""Scenarios: the paper's tests and ours, as data. Users add their own from a TOML file (docs/scenarios.md)."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from surefoot.errors import UserError
from surefoot.evaluation.outcome import Outcome
from surefoot.evaluation.protocol import PROTOCOL, Protocol
from surefoot.evaluation.trials import Trial
from surefoot.physics.pushes import Drop, Push
from surefoot.rates import CONTROL_HZ
from surefoot.robots.domain import DomainParameters
from surefoot.task.imperfections import Imperfections

DIRECTIONS = {"forward": 0.0, "left": 0.5 * np.pi, "backward": np.pi, "right": 1.5 * np.pi}
"""Angles in the horizontal plane [rad], counter-clockwise from +x."""

ROOT = "root"
"""The word for the floating body of any robot, in code and in results; people read the robot's own word for it."""

OLD_KEYS = {
    "calm_from": "quiet_from",
    "first_impulse": "preceding_impulse",
    "first_up": "preceding_upward",
    "gap": "push_interval",
}
"""Keys of scenario files until version 0.1, and what they are called now."""

_LIMITED = "_within_limits"

UNITS = {"impulse": "Ns", "height": "m", "tilt": "deg"}
"""The quantities that can be searched, and their units."""


@dataclass(frozen=True)
class Scenario:
    """One test: a disturbance, its conditions and the searched quantity. Its attributes are a scenario file's keys.

    Attributes:
        name: name of the scenario, which is the key of its figures.
        search: quantity whose largest recovered value is searched: "impulse" [Ns], "height" [m] or "tilt" [deg];
            "" runs a fixed disturbance instead.
        directions: directions of push and tilt: names (forward, left, backward, right), degrees counter-clockwise from
            +x, or a number of evenly spaced directions.
        body, lever, duration: the same of the push, see `Push`.
        impulse: impulse of the push if it is not searched [Ns].
        drop: height from which the robot is dropped, if it is not searched [m].
        preceding_impulse: impulse of a push before the main one [Ns]; 0 for none.
        preceding_upward: the preceding push lifts the robot instead of pushing it in the same direction.
        push_interval: range of the time from the preceding push's start to the main one's [s]; drawn by the seed.
        without_step: count a trial as recovered only if no foot left its place.
        within_limits: count a trial as recovered only if no joint exceeded its speed limit, see `Protocol`.
        half: search J50, the impulse that half of the trials survive, instead of the largest one that holds.
        trials: number of trials per direction, if nothing is searched.
        horizon, quiet_from: see `Trial` [s].
        observation_noise, action_noise, sensor_bias, latency: see `Imperfections`.
        friction, mass_scale, motor_strength, slope_deg, uphill_deg, physics_hz: see `DomainParameters` [deg].
    """

    name: str
    search: str = "impulse"
    directions: tuple[str | float, ...] | int = 4
    body: str = ROOT
    lever: float | None = None
    duration: float = PROTOCOL.push_duration
    impulse: float = 0.0
    drop: float = 0.0
    preceding_impulse: float = 0.0
    preceding_upward: bool = False
    push_interval: tuple[float, float] = (0.0, 0.0)
    without_step: bool = False
    within_limits: bool = False
    half: bool = False
    trials: int = 8
    horizon: float = PROTOCOL.horizon
    quiet_from: float = PROTOCOL.quiet_from
    observation_noise: float = 0.0
    action_noise: float = 0.0
    sensor_bias: float = 0.0
    latency: float = 0.0
    friction: float | None = None
    mass_scale: float = 1.0
    motor_strength: float = 1.0
    slope_deg: float = 0.0
    uphill_deg: float = 0.0
    physics_hz: int = CONTROL_HZ

    @property
    def domain(self) -> DomainParameters:
        """The properties of the ground and the robots."""
        slope, uphill = math.radians(self.slope_deg), math.radians(self.uphill_deg)
        return DomainParameters(self.friction, self.mass_scale, self.motor_strength, slope, uphill, self.physics_hz)

    @property
    def imperfections(self) -> Imperfections:
        """Those of sensors and actuators."""
        return Imperfections(self.observation_noise, self.action_noise, self.sensor_bias, self.latency)

    @property
    def unit(self) -> str:
        """Unit of the size."""
        return UNITS.get(self.search, "Ns")

    def lines(self, protocol: Protocol = PROTOCOL) -> list[Line]:
        """One line per direction.

        Args:
            protocol: `protocol_for` the robot that is tested; the paper's robot without it.
        """
        if isinstance(self.directions, int):
            degrees: Sequence[str | float] = (np.arange(self.directions) * 360.0 / self.directions).tolist()
        else:
            degrees = self.directions
        angles = [DIRECTIONS[d] if isinstance(d, str) else math.radians(d) for d in degrees]
        return [Line(self, _direction_name(angle), angle, protocol) for angle in angles]


@dataclass(frozen=True)
class Line:
    """One direction of a scenario, along which its size is searched or its trials are run.

    Attributes:
        name: of the direction.
        angle: in the horizontal plane [rad], counter-clockwise from the robot's +x.
        protocol: of the robot that is tested, whose grid the cells are of.
    """

    scenario: Scenario
    name: str
    angle: float
    protocol: Protocol = PROTOCOL

    @property
    def grid(self) -> float:
        """From one cell to the next, in the scenario's unit."""
        return self.protocol.grid(self.scenario.search)[0]

    @property
    def num_cells(self) -> int:
        """Cells up to where the search ends."""
        step, end = self.protocol.grid(self.scenario.search)
        return round(end / step)

    def size(self, cell: int) -> float:
        """Of a cell of the grid, in the scenario's unit."""
        return round(cell * self.grid, 9)

    def trial(self, cell: int, seed: int, full_length: bool) -> Trial:
        """The trial of cell `cell`: `size(cell)` Ns, m or degrees."""
        return self._trial(seed, full_length, **{self.scenario.search: self.size(cell)})

    def fixed_trials(self) -> list[Trial]:
        """The trials of a scenario in which nothing is searched."""
        return [self._trial(seed, full_length=True) for seed in range(self.scenario.trials)]

    def succeeded(self, outcome: Outcome) -> bool:
        """Whether the trial recovered, without a step and within the joints' limits where the scenario asks for it."""
        scenario, protocol = self.scenario, self.protocol
        return (
            outcome.recovered
            and (not scenario.without_step or outcome.is_without_step(protocol.step_length))
            and (not scenario.within_limits or outcome.is_within_limits(protocol.speed_share))
        )

    def _trial(
        self,
        seed: int,
        full_length: bool,
        *,
        impulse: float | None = None,
        height: float | None = None,
        tilt: float = 0.0,
    ) -> Trial:
        s = self.scenario
        along = (round(math.cos(self.angle), 12) + 0.0, round(math.sin(self.angle), 12) + 0.0, 0.0)  # never -0.0
        size = s.impulse if impulse is None else impulse
        dropped = s.drop if height is None else height
        preceding = None
        start = 0.0
        if s.preceding_impulse:
            preceding = Push(direction=(0.0, 0.0, 1.0) if s.preceding_upward else along, impulse=s.preceding_impulse)
            start = float(np.random.default_rng([seed, 1]).uniform(*s.push_interval))
        return Trial(
            push=Push(s.body, along, size, start, s.duration, s.lever),
            seed=seed,
            full_length=full_length,
            preceding=preceding,
            drop=Drop(dropped, *self._lean(tilt)) if dropped or s.search == "height" else None,
            imperfections=s.imperfections,
            domain=s.domain,
            horizon=s.horizon,
            quiet_from=s.quiet_from,
        )

    def _lean(self, tilt: float) -> tuple[float, float]:
        """Roll and pitch [rad] of a robot that leans by `tilt` degrees towards the line's direction."""
        lean = math.radians(tilt)
        return -lean * round(math.sin(self.angle), 12), lean * round(math.cos(self.angle), 12)


def direction_of(push: Push) -> str:
    """The name of a push's direction in the horizontal plane, as `Line.name` says it."""
    return _direction_name(math.atan2(push.direction[1], push.direction[0]))


def _direction_name(angle: float) -> str:
    degrees = round(math.degrees(angle), 6) % 360.0
    names = {round(math.degrees(a), 6): name for name, a in DIRECTIONS.items()}
    return names.get(degrees, f"{degrees:g}")


def limited_name(scenario: str) -> str:
    """The name of the scenario that asks for the same within the joints' limits."""
    return f"{scenario}{_LIMITED}"


def with_limits(scenarios: Sequence[Scenario]) -> list[Scenario]:
    """The scenarios, and after each that is searched the one that asks for the same within the joints' limits.

    Both ask for the same trials wherever they can, so that the second costs little.
    """
    names, found = {scenario.name for scenario in scenarios}, []
    for scenario in scenarios:
        found.append(scenario)
        twin = limited_name(scenario.name)
        if scenario.search and not (scenario.within_limits or scenario.half) and twin not in names:
            found.append(dataclasses.replace(scenario, name=twin, within_limits=True))
    return found


def from_json(values: dict[str, Any]) -> Scenario:
    """The scenario that `dataclasses.asdict` gave, after JSON made lists of its tuples; old keys are understood."""
    restored: dict[str, Any] = {
        OLD_KEYS.get(key, key): tuple(v) if isinstance(v, list) else v for key, v in values.items()
    }
    return Scenario(**restored)


def angle_deg(direction: str) -> float:
    """The angle of a direction that a user names, by a word or in degrees, counter-clockwise from forward [deg].

    Raises:
        UserError: it is neither.
    """
    if direction in DIRECTIONS:
        return math.degrees(DIRECTIONS[direction])
    try:
        angle = float(direction)
    except ValueError:
        raise UserError(f"unknown direction '{direction}'; valid: {', '.join(DIRECTIONS)}, degrees") from None
    if not math.isfinite(angle):
        raise UserError(f"direction must be finite, not {direction}")
    return angle


def canonical_name(scenario: str, root: str) -> str:
    """The name under which results keep a scenario, whose name may begin with the robot's own word for its root."""
    return f"{ROOT}_{scenario.removeprefix(f'{root}_')}" if scenario.startswith(f"{root}_") else scenario


def readable_name(scenario: str, root: str) -> str:
    """The name of a scenario with the robot's own word for its root."""
    return f"{root}_{scenario.removeprefix(f'{ROOT}_')}" if scenario.startswith(f"{ROOT}_") else scenario
