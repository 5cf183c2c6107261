"""Strategies: the strategies by which a robot kept its balance after a disturbance, recognised from its ticks.

After Horak and Nashner 1986 (ankle, hip), Pratt et al. 2006 (step), Stephens 2007 (what each can reject) and
Yang et al. 2018 (foot tilt; Table II marks all four). The papers name the strategies but give no numbers, so each
label has one here:

- **ankle**: ankle torque moved the CoP by more than `ANKLE_SHIFT`. Counted is the load-weighted mean place of the
  pressure within the soles that stand still; load that goes from one foot to the other moves the CoP as well, but it
  is the hips that move it (Winter 1995), so it does not count.
- **hip**: the trunk turned by more than `HIP_ANGLE`, in roll or pitch, both in the world and against the line from
  between the soles to the CoM, and the angular momentum about the CoM and that axis changed by more than
  `HIP_MOMENTUM`. A body that only sways or topples as one piece turns with that line, which is no hip strategy.
- **foot tilt**: a sole that carries load stood at more than `TILT_ANGLE` from flat, so on an edge or a corner.
- **step**: a foot left the floor and landed more than `Protocol.step_length` from where it left it. A foot that
  strays as far without one has `slid`, be it on the floor or in small hops.

The first three are of motions that last, so they are judged by a running mean (`SMOOTHING_S`) at 25 Hz. A policy that
rocks, tilts its feet or turns its trunk when nobody pushes does not do so because of a push: a motion counts only if
it also exceeds `HABIT` times the largest of its kind in the last `REFERENCE_S` before the disturbance. Steps have no
such measure; the ones of an undisturbed trial show what they are worth. Nothing counts once the trunk is further than
`LOST_DEG` from upright: from there on it only falls.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surefoot.evaluation.protocol import PROTOCOL, Protocol, protocol_for
from surefoot.physics.rotations import horizontal, uprightness
from surefoot.physics.step_record import StepRecord
from surefoot.rates import CONTROL_DT, POLICY_DT, POLICY_HZ
from surefoot.robots import Robot

ANKLE_SHIFT = PROTOCOL.ankle_shift
"""[m]: 27 Nm of ankle torque under Valkyrie's weight. Its stiff nominal pose sways by 0.015 m undisturbed."""
HIP_ANGLE = np.radians(PROTOCOL.hip_angle_deg)
"""[rad]. The stiff nominal pose yields by up to 2.1 degrees before it falls."""
HIP_MOMENTUM = PROTOCOL.hip_momentum
"""[kg m^2/s]: a little more than a push of 24 Ns at the root gives the stiff nominal pose."""
TILT_ANGLE = np.radians(PROTOCOL.foot_tilt_deg)
"""[rad]: lifts the far edge of the sole by 7 mm lengthwise, 4 mm sideways. Soles at rest are flat to 0.1 degrees."""
SMOOTHING_S = PROTOCOL.smoothing_time
"""Time constant of the running mean [s]: reactions of the ankle and the hip last several tenths of a second."""
REFERENCE_S = PROTOCOL.reference_time
HABIT = PROTOCOL.habit_factor
LOST_DEG = PROTOCOL.lost_tilt_deg

DEBOUNCE_S = PROTOCOL.debounce_time
"""A foot has left the floor once it has been light for this time, and landed once it has been loaded for it [s]."""

_STRIDE = PROTOCOL.strategy_stride
"""Means are taken over every fourth tick, at 125 Hz: nothing that lasts 0.1 s is missed, at a third of the cost."""
_DEBOUNCE_TICKS = round(DEBOUNCE_S / CONTROL_DT)
_SHARE = 1.0 - np.exp(-POLICY_DT / SMOOTHING_S)
_COS_LOST = np.cos(np.radians(LOST_DEG))
# Columns of the running means, and of what is judged, which has a CoP in the place of moment and force.
_MOMENT, _FORCE, _REST = slice(0, 2), slice(2, 3), slice(3, 11)
_ANKLE, _TILT, _TRUNK, _AGAINST_LEGS, _MOMENTUM = (slice(i, i + 2) for i in range(0, 10, 2))


@dataclass(frozen=True)
class Step:
    """A foot put down elsewhere.

    Attributes:
        foot: "left" or "right".
        time: of landing, since the disturbance began [s].
        place: of the sole's centre after landing, domain x and y [m].
        length: from where it left the floor [m].
    """

    foot: str
    time: float
    place: tuple[float, float]
    length: float


@dataclass(frozen=True)
class Strategies:
    """The strategies by which a robot kept its balance; `str` gives it in words: "ankle, foot tilt, 2 steps"."""

    ankle: bool = False
    hip: bool = False
    foot_tilt: bool = False
    steps: tuple[Step, ...] = ()
    slid: bool = False

    @property
    def num_steps(self) -> int:
        """Number of steps."""
        return len(self.steps)

    def __str__(self) -> str:
        held = {"ankle": self.ankle, "hip": self.hip, "foot tilt": self.foot_tilt}
        words = [word for word, holds in held.items() if holds]
        if self.steps:
            words.append("1 step" if self.num_steps == 1 else f"{self.num_steps} steps")
        return ", ".join(words) or "none"


class StrategyWatch:
    """Watches `num_robots` robots, policy step by policy step."""

    def __init__(self, robot: Robot, num_robots: int):
        self.robot = robot
        self._protocol = protocol_for(robot)
        self._least = _least_changes(self._protocol)
        self._mean = np.zeros((num_robots, 11))
        self._before = np.zeros((num_robots, round(REFERENCE_S * POLICY_HZ), 10))
        self._newest = np.zeros(num_robots, np.int64)
        self._reference = np.zeros((num_robots, 10))
        self._limit = np.zeros((num_robots, 10))
        self._turned = np.zeros((num_robots, 2), bool)
        self._spun = np.zeros((num_robots, 2), bool)
        self._labels = np.zeros((num_robots, 3), bool)
        self._lost = np.zeros(num_robots, bool)
        self._elapsed = np.zeros(num_robots, np.int64)
        self._feet = _FootWatch(num_robots, self._protocol)

    def reset(self, ids: np.ndarray, ticks: StepRecord) -> None:
        """Robots `ids` (n,) begin anew, at rest in the first of their ticks (n, ...)."""
        self._mean[ids] = _features(ticks, self._protocol)
        self._before[ids] = _judged(self._mean[ids], self._protocol)[:, None]
        for seen in (self._turned, self._spun, self._labels, self._lost, self._elapsed):
            seen[ids] = 0
        self._feet.reset(ids, ticks)

    def update(self, ids: np.ndarray, ticks: StepRecord, active: np.ndarray) -> None:
        """Take in a policy step of robots `ids` (n,).

        Args:
            ids: the robots (n,).
            ticks: (n, num_ticks, ...).
            active: bool (n, num_ticks), the ticks at and after the beginning of the disturbance. What comes before
                refreshes the reference that all is measured against.
        """
        self._mean[ids] += _SHARE * (_features(ticks, self._protocol) - self._mean[ids])
        judged = _judged(self._mean[ids], self._protocol)
        begun = active[:, -1]
        if not begun.all():
            before = ids[~begun]
            self._newest[before] = (self._newest[before] + 1) % self._before.shape[1]
            self._before[before, self._newest[before]] = judged[~begun]
        self._set_limits(ids[begun & (self._elapsed[ids] == 0)])
        self._lost[ids] |= (ticks.torso_uprightness < _COS_LOST).any(axis=1)
        counts = begun & ~self._lost[ids]
        self._judge(ids[counts], judged[counts])
        self._feet.update(ids, ticks, active & ~self._lost[ids, None], self._elapsed[ids])
        self._elapsed[ids] += active.sum(axis=1)

    def strategies(self, slot: int) -> Strategies:
        """The robot's strategies since its disturbance began."""
        ankle, hip, foot_tilt = self._labels[slot].tolist()
        return Strategies(ankle, hip, foot_tilt, tuple(self._feet.steps[slot]), bool(self._feet.slid[slot]))

    def _set_limits(self, ids: np.ndarray) -> None:
        """The references that changes must exceed, from the motion of robots `ids` before their disturbance."""
        if not len(ids):
            return
        before = self._before[ids]
        reference = before.mean(axis=1)
        reference[:, _TILT] = 0.0  # flat is flat, whatever the habit
        self._reference[ids] = reference
        habit = _changes(before - reference[:, None]).max(axis=1)
        self._limit[ids] = np.maximum(self._least, HABIT * habit)

    def _judge(self, ids: np.ndarray, judged: np.ndarray) -> None:
        exceeds = _changes(judged - self._reference[ids]) > self._limit[ids]
        self._turned[ids] |= exceeds[:, _TRUNK] & exceeds[:, _AGAINST_LEGS]
        self._spun[ids] |= exceeds[:, _MOMENTUM]
        self._labels[ids, 0] |= exceeds[:, _ANKLE].any(axis=1)
        self._labels[ids, 1] |= (self._turned[ids] & self._spun[ids]).any(axis=1)
        self._labels[ids, 2] |= exceeds[:, _TILT].any(axis=1)


class _FootWatch:
    """Feet that leave the floor and land; arrays (num_robots, 2, ...): left, right."""

    def __init__(self, num_robots: int, protocol: Protocol):
        self._protocol = protocol
        self.steps: list[list[Step]] = [[] for _ in range(num_robots)]
        self.slid = np.zeros(num_robots, bool)
        self._place = np.zeros((num_robots, 2, 2))
        self._stood_at = np.zeros((num_robots, 2, 2))
        self._left_at = np.zeros((num_robots, 2, 2))
        self._in_air = np.zeros((num_robots, 2), bool)
        self._light_run = np.zeros((num_robots, 2), np.int32)
        self._loaded_run = np.zeros((num_robots, 2), np.int32)

    def reset(self, ids: np.ndarray, ticks: StepRecord) -> None:
        """As `StrategyWatch.reset`."""
        soles = ticks.sole_position[:, 0, :, :2]
        for place in (self._place, self._stood_at, self._left_at):
            place[ids] = soles
        for seen in (self._in_air, self._light_run, self._loaded_run, self.slid):
            seen[ids] = 0
        for slot in ids.tolist():
            self.steps[slot] = []

    def update(self, ids: np.ndarray, ticks: StepRecord, active: np.ndarray, elapsed: np.ndarray) -> None:
        """As `StrategyWatch.update`; `elapsed` (n,): active ticks before these."""
        soles = ticks.sole_position[..., :2]
        self._refresh_place(ids, soles, active)
        force = np.ascontiguousarray(ticks.foot_force.swapaxes(0, 1))  # ticks first: twice as fast below
        light_run = _run_length(force < self._protocol.light_force, self._light_run[ids])
        loaded_run = _run_length(force > self._protocol.loaded_force, self._loaded_run[ids])
        in_air = _latch(light_run == _DEBOUNCE_TICKS, loaded_run == _DEBOUNCE_TICKS, self._in_air[ids])
        was_in_air = np.concatenate([self._in_air[ids][None], in_air[:-1]])
        for tick, row, foot in np.argwhere(in_air != was_in_air).tolist():
            slot = int(ids[row])
            if in_air[tick, row, foot]:
                last = tick - _DEBOUNCE_TICKS  # when it last was on the floor
                self._left_at[slot, foot] = soles[row, last, foot] if last >= 0 else self._stood_at[slot, foot]
            elif active[row, tick]:
                time = (elapsed[row] + active[row, : tick + 1].sum() - _DEBOUNCE_TICKS) * CONTROL_DT
                self._land(slot, foot, soles[row, tick, foot], float(max(time, 0.0)))
        self._find_slid(ids, soles[:, -1], active[:, -1], (loaded_run[-1] > 0) & ~in_air[-1])
        self._remember(ids, soles, light_run[-1])
        self._light_run[ids], self._loaded_run[ids], self._in_air[ids] = light_run[-1], loaded_run[-1], in_air[-1]

    def _refresh_place(self, ids: np.ndarray, soles: np.ndarray, active: np.ndarray) -> None:
        num_before = (~active).sum(axis=1)
        waiting = np.flatnonzero(num_before)
        self._place[ids[waiting]] = soles[waiting, num_before[waiting] - 1]

    def _land(self, slot: int, foot: int, place: np.ndarray, time: float) -> None:
        length = float(np.linalg.norm(place - self._left_at[slot, foot]))
        if length > self._protocol.step_length:
            x, y = place.tolist()
            self.steps[slot].append(Step(("left", "right")[foot], time, (x, y), length))
            self._place[slot, foot] = place

    def _find_slid(self, ids: np.ndarray, soles: np.ndarray, active: np.ndarray, stands: np.ndarray) -> None:
        shift = np.linalg.norm(soles - self._place[ids], axis=-1)
        self.slid[ids] |= active & (stands & (shift > self._protocol.step_length)).any(axis=-1)

    def _remember(self, ids: np.ndarray, soles: np.ndarray, light_run: np.ndarray) -> None:
        last = soles.shape[1] - 1 - light_run
        rows, feet = np.nonzero(last >= 0)
        self._stood_at[ids[rows], feet] = soles[rows, last[rows, feet], feet]


def _features(ticks: StepRecord, protocol: Protocol) -> np.ndarray:
    """Means over the ticks (n, 11) of what the strategies are told from.

    Pressure moment x, y [Nm] and force [N] of the feet that stand still, tilts of the loaded soles, roll and pitch of
    the trunk, the same against the legs [rad], and the angular momentum [kg m^2/s]; in the heading frame from the trunk
    on.
    """
    some = slice(None, None, _STRIDE)
    soles = ticks.sole_position
    force = ticks.foot_force[:, some]
    load = np.where(force > protocol.loaded_force, force, 0.0)
    moved = np.linalg.norm(soles[:, -1, :, :2] - soles[:, 0, :, :2], axis=-1)
    standing = load * (moved < protocol.still_distance)[:, None]
    moment = standing[..., None] * (ticks.foot_pressure_point[:, some] - soles[:, some, :, :2])
    tilt = np.arccos(np.clip(uprightness(ticks.foot_orientation[:, some]), -1.0, 1.0))
    trunk = ticks.torso_attitude[:, :, some]
    legs = ticks.com_position[:, some] - 0.5 * (soles[:, some, 0] + soles[:, some, 1])
    forward, left = _in_heading(ticks.heading[..., some], legs)
    against_legs = trunk - np.stack([-np.arctan2(left, legs[..., 2]), np.arctan2(forward, legs[..., 2])])
    momentum = _in_heading(ticks.heading[..., some], ticks.angular_momentum[:, some])
    columns = [
        moment.sum(axis=2).mean(axis=1),
        standing.sum(axis=2).mean(axis=1)[:, None],
        np.where(load > 0.0, tilt, 0.0).mean(axis=1),
        *(quantity.mean(axis=2).T for quantity in (trunk, against_legs, momentum)),
    ]
    return np.concatenate(columns, axis=1)


def _judged(mean: np.ndarray, protocol: Protocol) -> np.ndarray:
    """Running means (n, 11) with the moment over the force, the CoP within the soles [m], in their place: (n, 10)."""
    force = np.maximum(mean[:, _FORCE], protocol.loaded_force)
    return np.concatenate([mean[:, _MOMENT] / force, mean[:, _REST]], axis=1)


def _changes(difference: np.ndarray) -> np.ndarray:
    """Sizes of differences (..., 10) of what is judged: the CoP's in both its columns as its distance."""
    size = np.abs(difference)
    size[..., _ANKLE] = np.hypot(size[..., 0], size[..., 1])[..., None]
    return size


def _in_heading(heading: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Components of world vectors (n, num_ticks, 3) forward and to the left: (2, n, num_ticks)."""
    turned = horizontal(vector) * heading.conj()
    return np.stack([turned.real, turned.imag])


def _run_length(holds: np.ndarray, before: np.ndarray) -> np.ndarray:
    """For how many ticks something has held: (num_ticks, n, 2), continued from `before` (n, 2)."""
    number = np.arange(1, len(holds) + 1, dtype=np.int32)[:, None, None]
    last_not = np.maximum.accumulate(np.where(holds, -before, number), axis=0)
    return number - last_not


def _latch(on: np.ndarray, off: np.ndarray, before: np.ndarray) -> np.ndarray:
    """True from an `on` to the next `off`, never both at once: (num_ticks, n, 2), continued from `before` (n, 2)."""
    number = np.arange(1, len(on) + 1, dtype=np.int32)[:, None, None]
    # The latest event decides; odd numbers are an `on`.
    latest = np.maximum.accumulate(np.where(on, 2 * number + 1, np.where(off, 2 * number, before)), axis=0)
    return latest % 2 == 1


def _least_changes(protocol: Protocol) -> np.ndarray:
    """Least changes that count, by column (10,)."""
    return np.repeat([protocol.ankle_shift, TILT_ANGLE, HIP_ANGLE, HIP_ANGLE, protocol.hip_momentum], 2)
