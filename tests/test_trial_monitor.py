"""The one definition of success, and what else is seen of a trial: by hand, and against the trial's own ticks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import Broken, MovingPolicy, an_outcome, lean, pushed, run_one, squat

from surefoot.agents.load import usual_robot
from surefoot.agents.nominal import NominalAgent
from surefoot.evaluation.trials import run_list
from surefoot.robots import Robot

FORWARD, LEFT = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)


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


def test_a_trial_within_limits_exceeds_no_speed_limit_by_more_than_a_tenth_as_a_mean_over_10_ms(robot: Robot) -> None:
    agent, trial = NominalAgent(robot, "bent"), pushed(400.0, 0, FORWARD)
    outcome, trace = run_one(agent, trial, "joint_velocity")
    # By hand: the mean of five ticks of 2 ms, over all places of these five in the trial.
    velocity = trace["joint_velocity"]
    means = [np.abs(velocity[i : i + 5].mean(axis=0)) for i in range(len(velocity) - 4)]
    expected = float((np.array(means) / robot.velocity_limit).max())
    assert outcome.sustained_speed_ratio == pytest.approx(expected, rel=1e-12)
    assert (
        outcome.sustained_speed_ratio
        < outcome.speed_ratio
        == pytest.approx(float((np.abs(velocity) / robot.velocity_limit).max()))
    )
    assert an_outcome(sustained_speed_ratio=1.1).is_within_limits(1.1)
    assert not an_outcome(sustained_speed_ratio=1.11).is_within_limits(1.1)
    # A trial of an older table, which does not know, is not within limits.
    assert not an_outcome(sustained_speed_ratio=np.nan).is_within_limits(1.1)
