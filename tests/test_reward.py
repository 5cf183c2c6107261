"""Each number on a constructed state: a standing robot's ticks in which some sensors read what the test says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from conftest import HEIGHT, LEFT_SOLE, RIGHT_SOLE, WEIGHT, contact, context, step_to, still

from surefoot.physics.mujoco_engine import MujocoEngine
from surefoot.physics.step_record import StepRecord
from surefoot.rates import TICKS_PER_STEP
from surefoot.robots import Robot
from surefoot.task import reward
from surefoot.task.reward import RewardContext

SUM_OF_WEIGHTS = 14.0  # 2 + 3 + 2 + 1 + 4 * 1 + 2 * 1

TIME_CONSTANT = np.sqrt(HEIGHT / 9.806651)  # 0.3349 s

REWARDING = {name: term for name, term in reward.TERMS.items() if term.alpha is not None}


def about_x(angle: float) -> tuple[float, ...]:
    """The world's z axis as seen from a body that is turned about x."""
    return (0.0, np.sin(angle), np.cos(angle))


def about_y(angle: float) -> tuple[float, ...]:
    return (-np.sin(angle), 0.0, np.cos(angle))


def step_reward(ticks: StepRecord, **weights: float) -> tuple[np.ndarray, dict[str, float]]:
    return reward.step_reward(ticks, context(**weights))


def of_step(ticks: StepRecord, power_weight: float = 0.0) -> float:
    return float(step_reward(ticks, power=power_weight)[0][0])


def test_the_table_is_that_of_the_groups_code() -> None:
    table = {name: (term.weight, term.alpha) for name, term in REWARDING.items()}
    assert table == {
        "com_position_xy": (2.0, 19.51),
        "com_height": (3.0, 113.84),
        "com_velocity_xy": (2.0, 0.57),
        "com_velocity_z": (1.0, 3.69),
        "torso_attitude_pitch": (1.0, 4.68),
        "torso_attitude_roll": (1.0, 4.68),
        "root_attitude_pitch": (1.0, 4.68),
        "root_attitude_roll": (1.0, 4.68),
        "left_foot_force": (1.0, 2e-5),
        "right_foot_force": (1.0, 2e-5),
    }
    assert sum(weight for weight, _ in table.values()) == SUM_OF_WEIGHTS
    penalties = {name: term.weight for name, term in reward.TERMS.items() if name not in table}
    assert penalties == {
        "no_foot_contact": 2.0,
        "non_foot_contact": 10.0,
        "power": None,
        "foot_travel": None,
        "sway": None,
        "posture": None,
    }


def test_standing_perfectly_still_earns_1_per_step(perfect: StepRecord) -> None:
    # 0.1 * 10 / 14 * (2 + 3 + 2 + 1 + 4 + 2) = 1
    assert of_step(perfect) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize(
    ("sensors", "term", "error"),
    [
        # 3-4-5 triangle; the velocity that goes with it is the one that the term asks for.
        (
            {"com_position": (0.06, 0.08, HEIGHT), "com_velocity": (-0.06 / TIME_CONSTANT, -0.08 / TIME_CONSTANT, 0)},
            "com_position_xy",
            0.1,
        ),
        ({"com_velocity": (0.3, -0.4, 0.0)}, "com_velocity_xy", 0.5),
        ({"com_velocity": (0.0, 0.0, -0.7)}, "com_velocity_z", 0.7),
        ({"torso_up": about_y(0.3)}, "torso_attitude_pitch", 0.3),
        ({"torso_up": about_x(-0.2)}, "torso_attitude_roll", 0.2),
        ({"root_up": about_y(-0.25)}, "root_attitude_pitch", 0.25),
        ({"root_up": about_x(0.4)}, "root_attitude_roll", 0.4),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_one_error_costs_its_terms_share_and_nothing_else(
    perfect: StepRecord, altered: Callable[..., StepRecord], sensors: dict, term: str, error: float
) -> None:
    weight, alpha = reward.TERMS[term].weight, reward.TERMS[term].alpha
    # e.g. com_position_xy: exp(-19.51 * 0.01) = 0.8228, and 2 / 14 of the reward: 1 - 0.1772 * 2 / 14 = 0.97469
    expected = 1.0 - (1.0 - np.exp(-alpha * error**2)) * weight / SUM_OF_WEIGHTS
    assert of_step(altered(perfect, **sensors)) == pytest.approx(expected, abs=1e-9)


def test_a_low_com_costs_its_height_term(perfect: StepRecord, altered: Callable[..., StepRecord]) -> None:
    low = altered(perfect, com_position=(0.0, 0.0, HEIGHT - 0.1))
    # exp(-113.84 * 0.1^2) = 0.32033; 1 - 0.67967 * 3 / 14 = 0.85436
    assert of_step(low) == pytest.approx(0.85436, abs=1e-5)
    # The same in a pit: only the height over the soles counts.
    pit = altered(
        perfect, com_position=(0, 0, HEIGHT - 2), left_sole_position=(0, 0.14, -2), right_sole_position=(0, -0.14, -2)
    )
    assert of_step(pit) == pytest.approx(1.0, abs=1e-9)


def test_an_uneven_load_costs_both_feet(perfect: StepRecord, altered: Callable[..., StepRecord]) -> None:
    uneven = altered(
        perfect,
        left_foot_contact=contact(perfect, 0.5 * WEIGHT + 200.0, LEFT_SOLE),
        right_foot_contact=contact(perfect, 0.5 * WEIGHT - 200.0, RIGHT_SOLE),
    )
    # exp(-2e-5 * 200^2) = exp(-0.8) = 0.44933; 1 - 2 * 0.55067 / 14 = 0.92133
    assert of_step(uneven) == pytest.approx(0.92133, abs=1e-5)


def test_the_velocity_asked_for_brings_the_capture_point_to_the_centre(
    perfect: StepRecord, altered: Callable[..., StepRecord]
) -> None:
    offset = np.array([0.05, -0.02])
    position = (*offset, HEIGHT)
    # Target: -offset * sqrt(g / z) = -offset / 0.3349 s: a capture point of offset + v * 0.3349 s = 0.
    velocity = -offset / TIME_CONSTANT
    ticks = altered(perfect, com_position=position, com_velocity=(*velocity, 0.0))
    np.testing.assert_allclose(ticks.capture_point, 0.0, atol=1e-12)
    np.testing.assert_allclose(reward.com_velocity_xy(ticks, context()), 0.0, atol=1e-12)
    # At rest there, the error is the missing velocity itself: 0.0539 / 0.3349 = 0.1608 m/s.
    still = altered(perfect, com_position=position)
    np.testing.assert_allclose(reward.com_velocity_xy(still, context()), np.hypot(*offset) / TIME_CONSTANT, rtol=1e-9)


def test_on_one_foot_the_centre_of_support_is_that_foot(
    perfect: StepRecord, altered: Callable[..., StepRecord]
) -> None:
    left_only = altered(perfect, right_foot_contact=contact(perfect, 0.0, RIGHT_SOLE))
    np.testing.assert_allclose(reward.com_position_xy(left_only, context()), 0.14, rtol=1e-12)


def test_in_the_air_the_velocity_term_is_void_and_the_penalty_is_two(
    perfect: StepRecord, altered: Callable[..., StepRecord]
) -> None:
    nothing = contact(perfect, 0.0, (0.0, 0.0, 0.0))
    air = altered(perfect, left_foot_contact=nothing, right_foot_contact=nothing, ground_contact=0.0)
    # Lost: com_velocity_xy (weight 2) wholly, both foot forces but for exp(-2e-5 * 673.166^2) = 1.1598e-4 of each.
    terms = (14.0 - 2.0 - 2.0 + 2 * 1.1598e-4) / 14.0
    assert of_step(air) == pytest.approx(terms - 0.2, abs=1e-6)
    _, means = step_reward(air)
    assert means["com_velocity_xy"] == 0.0
    assert means["no_foot_contact"] == -2.0


def test_touching_the_ground_with_anything_else_costs_ten_times_a_tenth(
    perfect: StepRecord, altered: Callable[..., StepRecord]
) -> None:
    touched = altered(perfect, ground_contact=9.0)  # 4 of each foot and 1 more
    assert of_step(touched) == pytest.approx(1.0 - 1.0, abs=1e-9)
    _, means = step_reward(touched)
    assert means["non_foot_contact"] == -10.0


def test_power_costs_its_weight_times_the_watts(perfect: StepRecord, altered: Callable[..., StepRecord]) -> None:
    names = perfect.robot.joint_names
    torque, velocity = np.zeros(len(names)), np.zeros(len(names))
    for joint, its_torque, its_velocity in (("torso_pitch", -50.0, 2.0), ("right_knee_pitch", 100.0, 3.0)):
        torque[names.index(joint)], velocity[names.index(joint)] = its_torque, its_velocity
    working = altered(perfect, joint_torque=torque, joint_velocity=velocity)
    # |-50 * 2| + |100 * 3| = 400 W; 400 * 1e-3 = 0.4 on the scale of 10, 0.04 of a step
    assert of_step(working, power_weight=1e-3) == pytest.approx(1.0 - 0.04, abs=1e-9)
    assert of_step(working, power_weight=0.0) == pytest.approx(1.0, abs=1e-9)
    assert step_reward(working, power=1e-3)[1]["power"] == pytest.approx(-0.4)
    # With a logarithmic scale of 100 W: 100 * ln(1 + 400 / 100) = 160.94 W count.
    assert reward.step_reward(working, replace(context(power=1e-3), power_log_scale=100.0))[1][
        "power"
    ] == pytest.approx(-0.16094, abs=1e-5)


def test_a_steps_reward_is_the_mean_over_its_ticks(
    robot: Robot, perfect: StepRecord, altered: Callable[..., StepRecord]
) -> None:
    fallen = altered(perfect, ground_contact=9.0, torso_up=about_y(0.3))
    mixed = StepRecord.join([perfect.ticks(slice(0, 15)), fallen.ticks(slice(15, 20))])
    expected = 0.75 * of_step(perfect) + 0.25 * of_step(fallen)
    assert of_step(mixed) == pytest.approx(expected, abs=1e-12)
    assert expected < 0.75


def test_every_robot_has_its_own_reward_and_the_means_are_over_all(
    robot: Robot, perfect: StepRecord, altered: Callable[..., StepRecord]
) -> None:
    leaning = altered(perfect, torso_up=about_y(0.3))
    both = perfect[np.array([0, 0])]
    both.record[0] = leaning.record[0]
    rewards, means = step_reward(both)
    np.testing.assert_allclose(rewards, [of_step(leaning), of_step(perfect)], rtol=1e-12)
    # exp(-4.68 * 0.09) = 0.65627; (0.65627 + 1) / 2
    assert means["torso_attitude_pitch"] == pytest.approx(0.5 * (0.65627 + 1.0), abs=1e-5)
    assert means["root_attitude_pitch"] == pytest.approx(1.0)
    assert tuple(means) == tuple(reward.TERMS)


def test_a_robot_that_really_stands_earns_nearly_1_per_step(standing: StepRecord) -> None:
    """The straight pose, held for 2 s by the impedance alone."""
    nominal = 1.1048  # CoM over the soles, straight legs: -0.0666 + 1.1714
    rewards, means = reward.step_reward(standing, RewardContext(nominal, penalty_weights={"power": 1e-4}))
    assert 0.95 < rewards[0] < 1.0
    # The reward is what the terms add up to.
    terms = sum(term.weight * means[name] for name, term in REWARDING.items()) / SUM_OF_WEIGHTS
    penalties = means["no_foot_contact"] + means["non_foot_contact"] + means["power"]
    assert rewards[0] == pytest.approx(terms + 0.1 * penalties, rel=1e-12)
    # What is missing is the CoM's offset: the robot stands with its CoM about 7 cm behind the middle of its soles.
    assert min(REWARDING, key=lambda name: means[name]) == "com_position_xy"


def test_a_robot_dropped_from_2_m_is_penalised_for_flying(robot: Robot) -> None:
    engine = MujocoEngine(robot, 1, num_threads=1)
    pose = robot.pose("straight")[None]
    start = engine.reset(np.array([0]), pose, height=2.0)
    ticks = step_to(engine, np.tile(pose[:, None], (1, TICKS_PER_STEP, 1)))
    rewards, means = reward.step_reward(ticks, RewardContext(float(start.com_height[0, 0])))
    assert means["no_foot_contact"] == -2.0
    # Upright in the air: (3 + 1 + 4) / 14 of the terms at best, the position term near 1, minus 0.2.
    assert rewards[0] == pytest.approx((2 * means["com_position_xy"] + 8.0) / 14.0 - 0.2, abs=0.02)


def test_a_foot_that_travels_costs_its_speed(perfect: StepRecord, altered: Callable[..., StepRecord]) -> None:
    # 1 mm forward and 1 mm up per tick: 0.5 m/s over the floor; 0.1 * 4 per m/s * 0.5 m/s = 0.2.
    way = np.outer(np.arange(TICKS_PER_STEP), (0.001, 0.0, 0.001))[None]
    moving = altered(still(perfect), left_sole_position=LEFT_SOLE + way)
    free, means = step_reward(moving)
    charged, charged_means = step_reward(moving, foot_travel=4.0)
    assert free[0] - charged[0] == pytest.approx(0.2)
    assert (means["foot_travel"], charged_means["foot_travel"]) == (0.0, pytest.approx(-2.0))
    # With a logarithmic scale of 0.1 m/s, 0.5 m/s counts as 0.1 ln(6) = 0.17918 m/s; times 4.
    scaled = reward.step_reward(moving, replace(context(foot_travel=4.0), foot_travel_log_scale=0.1))[1]
    assert scaled["foot_travel"] == pytest.approx(-0.71670, abs=1e-5)


def test_a_com_that_sways_costs_its_horizontal_speed(perfect: StepRecord, altered: Callable[..., StepRecord]) -> None:
    # 0.3 m/s forward and 0.4 m/s to the left are 0.5 m/s over the floor; 0.1 * 2 per m/s * 0.5 m/s = 0.1.
    swaying = altered(still(perfect), com_velocity=(0.3, 0.4, 0.2))
    free = step_reward(swaying)[0]
    charged, means = step_reward(swaying, sway=2.0)
    assert free[0] - charged[0] == pytest.approx(0.1)
    assert means["sway"] == pytest.approx(-1.0)


def test_leaving_the_nominal_pose_costs_the_joints_mean_distance(
    robot: Robot, perfect: StepRecord, altered: Callable[..., StepRecord]
) -> None:
    # Two of eleven joints, 0.3 and 0.25 rad away to either side: 0.05 rad in the mean; 0.1 * 4 per rad * 0.05 = 0.02.
    pose = still(perfect).joint_position[0, 0].copy()
    pose[[robot.joint_names.index("torso_pitch"), robot.joint_names.index("left_knee_pitch")]] += (0.3, -0.25)
    free = step_reward(still(perfect))[0]
    charged, means = reward.step_reward(still(perfect), replace(context(posture=4.0), nominal_pose=pose))
    assert free[0] - charged[0] == pytest.approx(0.02)
    assert means["posture"] == pytest.approx(-0.2)
