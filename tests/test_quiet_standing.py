"""What the trial monitor sees beside the verdict: quiet standing, peaks, saturation and tilt."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from conftest import MovingPolicy, pushed, run_one, squat

from surefoot.agents.nominal import NominalAgent
from surefoot.evaluation.outcome import Outcome, joint_groups
from surefoot.evaluation.trial_monitor import TrialMonitor
from surefoot.evaluation.trials import run_list
from surefoot.physics.pushes import Drop
from surefoot.physics.step_record import StepRecord
from surefoot.rates import TICKS_PER_STEP
from surefoot.robots import Robot
from surefoot.robots.domain import DomainParameters

GROUPS = ("torso_pitch", "hip_roll", "hip_pitch", "knee_pitch", "ankle_pitch", "ankle_roll")


class Watched:
    """A robot at rest in a trial of 2 s that begins at its reset, of which the last second is the quiet time."""

    def __init__(self, robot: Robot, standing: StepRecord, altered: Callable[..., StepRecord], **changes: float):
        self.standing, self.altered = standing, altered
        self.still = {f"{joint}_{what}": 0.0 for joint in robot.joint_names for what in ("velocity", "torque")}
        self.still |= {"com_velocity": 0.0, "root_up": (0.0, 0.0, 1.0)}
        self.judge, self.tick = TrialMonitor(robot, 1), 0
        values = {"start": 0, "push_end": 60, "horizon": 2.0, "quiet_from": 1.0, "full_length": True} | changes
        first = altered(standing, **self.still)
        self.judge.reset(np.array([0]), first, **{name: np.array([value]) for name, value in values.items()})

    def goes_on(self, num_steps: int, **sensors: object) -> Outcome | None:
        ticks = self.altered(self.standing, **(self.still | sensors))
        for _ in range(num_steps):
            self.tick += TICKS_PER_STEP
            ended = self.judge.update(np.array([0]), ticks, np.array([self.tick]), np.array([False]))
        return ended.get(0)


@pytest.fixture
def watched(robot: Robot, standing: StepRecord, altered: Callable[..., StepRecord]) -> Watched:
    return Watched(robot, standing, altered)


def test_a_robot_that_does_nothing_is_perfectly_calm(watched: Watched) -> None:
    assert watched.goes_on(49) is None
    outcome = watched.goes_on(1)
    assert (outcome.recovered, outcome.seconds, outcome.steps, outcome.com_speed) == (True, 2.0, 0, 0.0)
    assert (outcome.quiet_drift, outcome.quiet_power, outcome.quiet_steps) == (0.0, 0.0, 0.0)
    assert outcome.torque_peaks == outcome.speed_peaks == outcome.saturated_s == (0.0,) * 6


def test_calm_power_is_the_mean_over_the_calm_time(watched: Watched) -> None:
    watched.goes_on(25, left_knee_pitch_torque=300.0, left_knee_pitch_velocity=2.0)
    # |30 * -2| = 60 W for 10 of 25 steps and |30 * -2| + |100 * 0.5| = 110 W for 5: (600 + 550) / 25 = 46 W.
    torso = {"torso_pitch_torque": 30.0, "torso_pitch_velocity": -2.0}
    watched.goes_on(10, **torso)
    watched.goes_on(5, **torso, left_knee_pitch_torque=100.0, left_knee_pitch_velocity=0.5)
    assert watched.goes_on(10).quiet_power == pytest.approx(46.0, rel=1e-12)


def test_calm_drift_is_the_farthest_from_the_place_at_which_the_calm_time_begins(watched: Watched) -> None:
    watched.goes_on(20, com_position=(5.0, 5.0, 1.0))
    watched.goes_on(5, com_position=(0.2, 0.1, 1.0))
    watched.goes_on(5, com_position=(0.23, 0.1, 1.0))
    watched.goes_on(5, com_position=(0.23, 0.14, 2.0))  # hypot(0.03, 0.04); upwards is not counted
    assert watched.goes_on(15, com_position=(0.2, 0.1, 1.0)).quiet_drift == pytest.approx(0.05, abs=1e-12)


def test_a_trial_that_ends_early_was_not_seen_to_be_calm(watched: Watched) -> None:
    watched.goes_on(30)
    outcome = watched.goes_on(1, ground_contact=watched.standing["ground_contact"] + 1.0)
    assert (outcome.reason, outcome.seconds) == ("fell", 31 * 0.04)
    assert np.isnan([outcome.quiet_drift, outcome.quiet_power, outcome.quiet_steps, outcome.com_speed]).all()


def test_peaks_are_the_largest_of_either_side_of_a_joint_group(robot: Robot, watched: Watched) -> None:
    assert joint_groups(robot) == GROUPS
    watched.goes_on(1, left_knee_pitch_torque=-200.0, right_knee_pitch_torque=150.0, left_hip_roll_velocity=-3.0)
    watched.goes_on(1, right_hip_roll_velocity=2.0, torso_pitch_torque=75.0, right_ankle_roll_velocity=5.5)
    outcome = watched.goes_on(48)
    assert dict(zip(GROUPS, outcome.torque_peaks, strict=True)) == {
        "torso_pitch": 75.0, "hip_roll": 0.0, "hip_pitch": 0.0, "knee_pitch": 200.0, "ankle_pitch": 0.0,
        "ankle_roll": 0.0,
    }  # fmt: skip
    assert dict(zip(GROUPS, outcome.speed_peaks, strict=True)) == {
        "torso_pitch": 0.0, "hip_roll": 3.0, "hip_pitch": 0.0, "knee_pitch": 0.0, "ankle_pitch": 0.0, "ankle_roll": 5.5
    }  # fmt: skip
    assert outcome.torque_ratio == pytest.approx(200 / 350)  # 75 of 150 is less
    assert outcome.speed_ratio == pytest.approx(5.5 / 11.0)  # 3 of 6.11 is less


def test_saturation_is_the_time_of_the_joint_that_was_longest_at_its_limit(watched: Watched) -> None:
    watched.goes_on(1, left_knee_pitch_torque=350.0, torso_pitch_torque=149.8)  # 99.87 %
    watched.goes_on(
        2, right_knee_pitch_torque=-349.7, left_ankle_roll_torque=np.where(np.arange(20) < 3, 205, 0)[:, None]
    )
    outcome = watched.goes_on(47)
    # 20 ticks at the left and 40 at the right knee; 2 * 3 ticks of 2 ms at the ankle.
    expected = {"knee_pitch": 0.08, "ankle_roll": 0.012}
    assert outcome.saturated_s == pytest.approx(tuple(expected.get(group, 0.0) for group in GROUPS), abs=1e-12)


def test_the_tilt_counts_from_the_disturbance_on(
    robot: Robot, standing: StepRecord, altered: Callable[..., StepRecord]
) -> None:
    def tilted(angle: float) -> dict[str, object]:
        return {"root_up": (-np.sin(angle), 0.0, np.cos(angle))}

    watched = Watched(robot, standing, altered, start=100, push_end=160)
    watched.goes_on(5, **tilted(0.6))
    watched.goes_on(3, **tilted(0.2))
    watched.goes_on(3, **tilted(-0.25))
    outcome = watched.goes_on(44)
    assert outcome.root_tilt == pytest.approx(0.25, abs=1e-9)
    assert outcome.seconds == 2.0


def test_a_reset_forgets_the_last_trial(robot: Robot, standing: StepRecord, altered: Callable[..., StepRecord]) -> None:
    watched = Watched(robot, standing, altered)
    busy = {"left_knee_pitch_torque": 350.0, "left_knee_pitch_velocity": 2.0, "com_velocity": 1.0}
    spoilt = watched.goes_on(50, **busy, com_position=(9.0, 9.0, 1.0), root_up=(0.0, 0.0, -1.0))
    fresh = Watched(robot, standing, altered)
    fresh.judge = watched.judge
    first = altered(standing, **fresh.still)
    one = np.array([1.0])
    fresh.judge.reset(np.array([0]), first, 0 * one, 60 * one, 2 * one, one, np.array([True]))
    again = fresh.goes_on(50)
    assert repr(again) == repr(Watched(robot, standing, altered).goes_on(50))
    assert repr(again) != repr(spoilt)


def test_the_nominal_pose_stands_calmly(robot: Robot) -> None:
    trial = replace(pushed(0.0, 3), horizon=8.0, quiet_from=6.0)
    outcome, _ = run_one(NominalAgent(robot, "bent"), trial)
    assert outcome.recovered
    assert outcome.quiet_drift < 0.002
    assert outcome.quiet_power < 0.5
    assert (outcome.quiet_steps, outcome.steps) == (0.0, 0)
    assert outcome.saturated_s == (0.0,) * 6
    # A robot that squats all the time is not calm.
    restless, _ = run_one(MovingPolicy(robot, squat(0.2)), trial)
    assert restless.quiet_power > 20.0


def test_the_calm_time_is_what_its_ticks_say(robot: Robot) -> None:
    trial = replace(pushed(24.0, 11, (0.0, 1.0, 0.0)), horizon=4.0, quiet_from=1.0)
    outcome, trace = run_one(
        NominalAgent(robot),
        trial,
        "com_position",
        "joint_power",
        "joint_torque",
        "joint_velocity",
        "root_uprightness",
    )
    rng = np.random.default_rng(trial.seed)
    rng.uniform(-0.02, 0.02, robot.num_joints)
    start = 500 + int(rng.integers(20))
    # The first policy step that begins in the quiet time, 1 s after the push began, and 3 s from there.
    first = -(-(start + 500) // 20) * 20
    calm = slice(first, first + 1500)
    assert outcome.quiet_power == pytest.approx(trace["joint_power"][calm].sum(axis=1).mean(), rel=1e-9)
    place = trace["com_position"][:, :2]
    drift = np.linalg.norm(place[first + 19 : calm.stop : 20] - place[first - 1], axis=1)
    assert outcome.quiet_drift == pytest.approx(drift.max(), rel=1e-9)
    columns = [[0], [1, 6], [2, 7], [3, 8], [4, 9], [5, 10]]
    torque, speed = np.abs(trace["joint_torque"]).max(axis=0), np.abs(trace["joint_velocity"]).max(axis=0)
    assert outcome.torque_peaks == tuple(torque[group].max() for group in columns)
    assert outcome.speed_peaks == tuple(speed[group].max() for group in columns)
    assert outcome.root_tilt == pytest.approx(np.arccos(trace["root_uprightness"][start:].min()), abs=1e-9)


def test_a_joint_is_saturated_while_its_motor_gives_all_it_has(robot: Robot) -> None:
    """Landing from 0.5 m takes the knees to their limit; motors of 80 % have a limit of 80 %."""
    for strength in (1.0, 0.8):
        domain = DomainParameters(motor_strength=strength)
        trial = replace(pushed(0.0, 1), drop=Drop(0.5), horizon=2.0, quiet_from=1.0, domain=domain)
        outcome = run_list(NominalAgent(robot), [trial], num_slots=1, num_threads=1, domain=domain)[trial]
        knee = GROUPS.index("knee_pitch")
        assert outcome.torque_peaks[knee] == pytest.approx(350.0 * strength)
        assert outcome.torque_ratio == pytest.approx(1.0)
        assert 0.002 <= outcome.saturated_s[knee] < 1.0
