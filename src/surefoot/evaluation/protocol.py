"""Protocol: every number that defines a measurement, in one place and under one version."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import json
from dataclasses import dataclass

from surefoot.physics.pushes import PUSH_DURATION
from surefoot.physics.signals import CUTOFF_HZ
from surefoot.rates import CONTROL_HZ, POLICY_HZ
from surefoot.robots import Robot


@dataclass(frozen=True)
class Protocol:
    """The definition of a trial, of success, of the strategies and of the search; SI units, angles in degrees.

    A change of a number raises `version`: results are kept with it, and those of another version are measured
    anew. `tests/test_protocol.py` holds the fingerprint of the numbers of every version.

    Attributes:
        policy_hz, control_hz: rates of the policy and of the joint control.
        filter_cutoff_hz: of the low-pass on the observation.
        push_duration: of a push, unless its scenario says otherwise [s].
        settle_time: which the agent has to find its stance before the disturbance [s].
        start_angle_noise: largest deviation of a joint's start angle from the nominal pose [rad].
        horizon: from the beginning of the disturbance to the verdict [s].
        judged_time: last part of the horizon, in which the robot must stand [s].
        max_com_speed: largest mean speed of the CoM in that part [m/s].
        max_tilt_deg: largest angle of root and torso from upright in that part.
        quiet_time: a trial that may end early has recovered once it has stood upright and slow for this long [s].
        quiet_from: quiet standing is measured from this time after the beginning of the disturbance on [s].
        saturation: a joint counts as saturated above this share of its torque limit.
        speed_share: a trial is within limits if no joint's speed exceeds this share of its limit,
        speed_time: as a mean over this time [s], which forgives the single ticks of an impact. Torques cannot exceed
            their limits.
        ankle_shift: ankle strategy, shift of the CoP within the standing soles [m].
        hip_angle_deg, hip_momentum: hip strategy, turn of the trunk and change of the angular momentum [kg m^2/s].
        foot_tilt_deg: foot tilt, angle of a loaded sole from flat.
        smoothing_time: time constant of the running means that these three are told from [s].
        reference_time: time before the disturbance whose motions are the robot's habit [s].
        habit_factor: a motion counts if it exceeds the habit by this factor.
        lost_tilt_deg: angle of the trunk from upright from which on no strategy counts.
        step_length: a foot that lands farther from its place has stepped [m].
        light_force, loaded_force: below and above which a foot carries nothing and carries load [N].
        debounce_time: for which a foot must be light to have left the floor, and loaded to have landed [s].
        still_distance: a foot that moves by less in a policy step stands still [m].
        strategy_stride: means of the strategies are taken over every such tick.
        impulse_step, impulse_end: grid of the impulses and where the search ends [Ns].
        height_step, height_end: of the heights of drops [m].
        tilt_step_deg, tilt_end_deg: of the tilts of drops.
        num_screening: short trials of every cell, which find the cells that give way.
        num_full_length: full-length trials of the cell that is to hold.
        min_share: share of the full-length trials that must recover.
        num_neighbours: neighbouring cells whose screening trials are counted together.
        min_neighbour_share: share of these that must recover; otherwise the cells give way.
    """

    version: int = 2

    policy_hz: int = POLICY_HZ
    control_hz: int = CONTROL_HZ
    filter_cutoff_hz: float = CUTOFF_HZ

    push_duration: float = PUSH_DURATION
    settle_time: float = 1.0
    start_angle_noise: float = 0.02
    horizon: float = 10.0
    judged_time: float = 1.0
    max_com_speed: float = 0.15
    max_tilt_deg: float = 20.0
    quiet_time: float = 2.0
    quiet_from: float = 5.0
    saturation: float = 0.999
    speed_share: float = 1.1
    speed_time: float = 0.01

    ankle_shift: float = 0.02
    hip_angle_deg: float = 3.0
    hip_momentum: float = 4.0
    foot_tilt_deg: float = 1.5
    smoothing_time: float = 0.1
    reference_time: float = 0.5
    habit_factor: float = 2.0
    lost_tilt_deg: float = 45.0
    step_length: float = 0.03
    light_force: float = 20.0
    loaded_force: float = 100.0
    debounce_time: float = 0.02
    still_distance: float = 0.005
    strategy_stride: int = 4

    impulse_step: float = 6.0
    impulse_end: float = 900.0
    height_step: float = 0.05
    height_end: float = 3.0
    tilt_step_deg: float = 1.0
    tilt_end_deg: float = 60.0
    num_screening: int = 8
    num_full_length: int = 40
    min_share: float = 0.95
    num_neighbours: int = 4
    min_neighbour_share: float = 0.90

    def grid(self, search: str) -> tuple[float, float]:
        """Step of the grid along which "impulse", "height" or "tilt" is searched, and where the search ends."""
        return {
            "impulse": (self.impulse_step, self.impulse_end),
            "height": (self.height_step, self.height_end),
            "tilt": (self.tilt_step_deg, self.tilt_end_deg),
        }[search]

    @property
    def fingerprint(self) -> str:
        """Twelve hexadecimal digits that name the numbers, without the version."""
        numbers = dataclasses.asdict(self)
        del numbers["version"]
        return hashlib.sha256(json.dumps(numbers, sort_keys=True).encode()).hexdigest()[:12]


PROTOCOL = Protocol()
"""The protocol of this version of surefoot; its forces, impulses and lengths are those of the paper's robot."""


@functools.cache
def protocol_for(robot: Robot) -> Protocol:
    """The protocol with forces and impulses scaled by a robot's mass, and lengths by that of its legs.

    The grid of impulses is a whole number of newtons for the duration of a push.
    """
    mass, length = robot.mass_scale, robot.length_scale
    newtons = max(round(PROTOCOL.impulse_step / PROTOCOL.push_duration * mass), 1)
    impulse_step = round(newtons * PROTOCOL.push_duration, _DIGITS)
    num_cells = round(PROTOCOL.impulse_end / PROTOCOL.impulse_step)
    return dataclasses.replace(
        PROTOCOL,
        ankle_shift=round(PROTOCOL.ankle_shift * length, _DIGITS),
        hip_momentum=round(PROTOCOL.hip_momentum * mass * length**1.5, _DIGITS),
        step_length=round(PROTOCOL.step_length * length, 3),
        light_force=round(PROTOCOL.light_force * mass, _DIGITS),
        loaded_force=round(PROTOCOL.loaded_force * mass, _DIGITS),
        still_distance=round(PROTOCOL.still_distance * length, _DIGITS),
        impulse_step=impulse_step,
        impulse_end=round(num_cells * impulse_step, _DIGITS),
    )


_DIGITS = 9
"""Scaled numbers are rounded to so many digits, so that a scale of one gives the numbers themselves."""
