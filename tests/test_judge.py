"""The one definition of success, and what else is seen of a trial: by hand, and against the trial's own ticks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from conftest import Broken, MovingPolicy, an_outcome, lean, pushed, run_one, squat

from surefoot.agents.load import usual_robot
from surefoot.agents.nominal import NominalAgent
from surefoot.evaluation.outcome import Outcome, joint_groups
from surefoot.evaluation.trial_monitor import TrialMonitor
from surefoot.evaluation.trials import run_list
from surefoot.physics.pushes import Drop
from surefoot.physics.step_record import StepRecord
from surefoot.rates import TICKS_PER_STEP
from surefoot.robots import Robot
from surefoot.robots.domain import DomainParameters

FORWARD, LEFT = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
GROUPS = ("torso_pitch", "hip_roll", "hip_pitch", "knee_pitch", "ankle_pitch", "ankle_roll")


# Verdicts.


def test_the_nominal_pose_recovers_from_nothing() -> None:
    outcome = run_list(NominalAgent(usual_robot(), "straight"), [pushed(0.0, 3)], num_slots=1, num_threads=1)[
        pushed(0.0, 3)
    ]
    assert (outcome.recovered, outcome.reason) == (True, "recovered")
    assert outcome.com_speed < 0.01
    assert outcome.foot_shift < 0.03
    assert outcome.is_without_step(0.03)
    assert 0.1 < outcome.torque_ratio < 1.0
    assert outcome.speed_ratio < 0.5


@pytest.mark.parametrize("direction", [FORWARD, LEFT, (-1.0, 0.0, 0.0)])
def test_the_nominal_pose_falls_from_400_newton_seconds(direction: tuple) -> None:
    trial = pushed(400.0, 0, direction)
    outcome, trace = run_one(NominalAgent(usual_robot(), "straight"), trial, "non_foot_contact", "com_height")
    assert (outcome.recovered, outcome.reason, outcome.is_without_step(0.03)) == (False, "fell", False)
    # 400 Ns / 137 kg = 2.9 m/s over a height of 1.1 m: down within about a second, and judged at once.
    assert 0.3 < outcome.seconds < 1.2
    assert np.isnan(outcome.com_speed)
    on_the_ground = np.flatnonzero(trace["non_foot_contact"])
    assert on_the_ground[0] >= len(trace["non_foot_contact"]) - 20
    assert outcome.torque_ratio == 1.0


def test_a_policy_that_never_comes_to_rest_is_restless(robot: Robot) -> None:
    # The CoM goes up and down by a few cm once a second; its mean speed grows with the amplitude.
    calm, _ = run_one(MovingPolicy(robot, squat(0.2)), pushed(0.0, 1))
    restless, _ = run_one(MovingPolicy(robot, squat(0.4)), pushed(0.0, 1))
    assert (calm.recovered, calm.reason) == (True, "recovered")
    assert calm.com_speed < 0.15
    assert (restless.recovered, restless.reason) == (False, "restless")
    assert 0.15 <= restless.com_speed < 0.25
    assert restless.seconds >= 10.0


def test_a_policy_that_ends_up_leaning_is_tilted(robot: Robot) -> None:
    outcome, trace = run_one(MovingPolicy(robot, lean(0.3), "straight"), pushed(0.0, 1), "torso_uprightness")
    assert np.degrees(np.arccos(trace["torso_uprightness"][-500:])).max() > 20.0
    assert (outcome.recovered, outcome.reason) == (False, "tilted")
    assert outcome.com_speed < 0.15
    upright, trace = run_one(MovingPolicy(robot, lean(0.15), "straight"), pushed(0.0, 1), "torso_uprightness")
    assert 8.0 < np.degrees(np.arccos(trace["torso_uprightness"][-500:])).max() < 20.0
    assert (upright.recovered, upright.reason) == (True, "recovered")


def test_a_policy_that_gives_nan_to_one_robot_fails_there_and_nowhere_else(robot: Robot) -> None:
    trials = [pushed(200.0, seed) for seed in range(3)]
    broken = run_list(Broken(robot, who=1), trials, num_slots=3, num_threads=1)
    whole = run_list(NominalAgent(robot, "straight"), trials, num_slots=3, num_threads=1)
    assert (broken[trials[1]].recovered, broken[trials[1]].reason) == (False, "not finite")
    for trial in (trials[0], trials[2]):
        assert repr(broken[trial]) == repr(whole[trial])


def test_every_trial_of_a_policy_that_gives_nan_fails_in_its_first_policy_step(robot: Robot) -> None:
    trials = [pushed(200.0, seed, full_length=False) for seed in range(3)]
    outcomes = run_list(Broken(robot), trials, num_slots=1, num_threads=1)
    assert [outcomes[trial].reason for trial in trials] == ["not finite"] * 3
    # 20 ticks after the start, which is 500 to 519 ticks before the push.
    assert all(-1.0 < outcomes[trial].seconds <= -0.96 for trial in trials)


@pytest.mark.usefixtures("in_scratch_folder")
def test_a_robot_that_diverges_ends_its_trial_and_no_other(robot: Robot) -> None:
    policy = NominalAgent(robot, "straight")
    trials = [pushed(200.0, 0), pushed(1e12, 1), pushed(200.0, 2)]
    outcomes = run_list(policy, trials, num_slots=3, num_threads=1)
    assert (outcomes[trials[1]].recovered, outcomes[trials[1]].reason) == (False, "diverged")
    alone = run_list(policy, [trials[0], trials[2]], num_slots=2, num_threads=1)
    for trial in (trials[0], trials[2]):
        assert repr(outcomes[trial]) == repr(alone[trial])


@pytest.mark.usefixtures("in_scratch_folder")
def test_every_trial_in_a_slot_that_diverges_again_is_diverged(robot: Robot) -> None:
    trials = [pushed(1e12, seed, full_length=False) for seed in range(3)]
    outcomes = run_list(NominalAgent(robot, "straight"), trials, num_slots=1, num_threads=1)
    assert [outcomes[trial].reason for trial in trials] == ["diverged"] * 3
    # In the policy step in which the push begins.
    assert all(0.0 <= outcomes[trial].seconds <= 0.04 for trial in trials)


# The numbers of an outcome against the trial's own ticks.


def test_the_numbers_of_a_whole_trial_are_those_of_its_ticks(robot: Robot) -> None:
    trial = pushed(40.0, 11)
    outcome, trace = run_one(
        NominalAgent(robot, "bent"), trial, "com_velocity", "sole_position", "joint_torque", "joint_velocity"
    )
    assert outcome.reason == "recovered"
    num_ticks = len(trace["com_velocity"])
    # 1 s to settle, and the push's start within the policy step, which the seed draws after the 11 start angles.
    rng = np.random.default_rng(trial.seed)
    rng.uniform(-0.02, 0.02, robot.num_joints)
    start = 500 + int(rng.integers(20))
    end = start + 10 * 500
    assert outcome.seconds == 10.0
    assert end <= num_ticks < end + 20
    judged = slice(end - 500, end)
    assert outcome.com_speed == pytest.approx(np.linalg.norm(trace["com_velocity"][judged], axis=1).mean(), rel=1e-12)
    # From the last policy step that ended before the push.
    place = trace["sole_position"][start // 20 * 20 - 1, :, :2]
    shift = np.linalg.norm(trace["sole_position"][start:, :, :2] - place, axis=-1).max()
    assert outcome.foot_shift == pytest.approx(shift, rel=1e-12)
    torque = np.abs(trace["joint_torque"]) / [150, *[350, 350, 350, 205, 205] * 2]
    assert outcome.torque_ratio == pytest.approx(torque.max(), rel=1e-12)
    speed = np.abs(trace["joint_velocity"]) / [9.0, *[6.11, 6.11, 11.0, 11.0, 11.0] * 2]
    assert outcome.speed_ratio == pytest.approx(speed.max(), rel=1e-9)


def test_a_foot_that_moves_more_than_3_cm_has_stepped(robot: Robot) -> None:
    def march(time: np.ndarray) -> dict[str, np.ndarray]:
        """After 1.5 s the left knee comes up and the foot is put down again further ahead."""
        up = np.clip((time - 1.5) / 0.2, 0, 1) - np.clip((time - 1.9) / 0.2, 0, 1)
        return {"left_hip_pitch": -0.4 * up, "left_knee_pitch": 0.6 * up, "left_ankle_pitch": -0.2 * up}

    trial = pushed(0.0, 5, full_length=False)
    standing, _ = run_one(NominalAgent(robot, "straight"), trial)
    stepping, trace = run_one(MovingPolicy(robot, march, "straight"), trial, "foot_contact")
    assert standing.foot_shift < 0.03
    assert standing.is_without_step(0.03)
    assert not trace["foot_contact"][750:, 0].all()
    assert stepping.foot_shift > 0.03
    assert not stepping.is_without_step(0.03)


@pytest.mark.parametrize(
    ("recovered", "foot_shift", "without_step"),
    [(True, 0.03, True), (True, 0.0301, False), (False, 0.0, False)],
)
def test_without_step_is_a_recovery_with_both_feet_in_place(
    recovered: bool, foot_shift: float, without_step: bool
) -> None:
    outcome = an_outcome(recovered=recovered, foot_shift=foot_shift)
    assert outcome.is_without_step(0.03) is without_step


@pytest.mark.parametrize("horizon", [2.0, 3.5])
def test_a_trial_is_judged_at_its_own_horizon(robot: Robot, horizon: float) -> None:
    trial = replace(pushed(12.0, 11), horizon=horizon, quiet_from=1.0)
    outcome, trace = run_one(NominalAgent(robot), trial, "com_velocity")
    rng = np.random.default_rng(trial.seed)
    rng.uniform(-0.02, 0.02, robot.num_joints)
    end = 500 + int(rng.integers(20)) + round(horizon * 500)
    assert outcome.seconds == horizon
    assert end <= len(trace["com_velocity"]) < end + 20
    mean_speed = np.linalg.norm(trace["com_velocity"][end - 500 : end], axis=1).mean()
    assert outcome.com_speed == pytest.approx(mean_speed, rel=1e-12)


# By hand: one robot whose ticks are written policy step by policy step.


class Watched:
    """A robot at rest in a trial of 2 s that begins at its reset, of which the last second is the calm time."""

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


# On the real robot.


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
    trial = replace(pushed(24.0, 11, LEFT), horizon=4.0, quiet_from=1.0)
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
    # The first policy step that begins in the calm time, 1 s after the push began, and 3 s from there.
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
