"""Protocol: every number that defines what is measured, in one place, under one version."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from dataclasses import dataclass

from surefoot.physics.pushes import PUSH_DURATION
from surefoot.physics.signals import CUTOFF_HZ
from surefoot.rates import CONTROL_HZ, POLICY_HZ


@dataclass(frozen=True)
class Protocol:
    """The definition of a trial, of success, of the strategies and of the search; SI units, angles in degrees.

    Whoever changes a number raises `version`: results are kept with it, and those of another version are measured
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

    version: int = 1

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

    @property
    def fingerprint(self) -> str:
        """Twelve hexadecimal digits that name the numbers, without the version."""
        numbers = dataclasses.asdict(self)
        del numbers["version"]
        return hashlib.sha256(json.dumps(numbers, sort_keys=True).encode()).hexdigest()[:12]


PROTOCOL = Protocol()
"""The protocol of this version of surefoot."""
