from __future__ import annotations

import numpy as np
import pytest
from conftest import step_to
from scipy.signal import butter, lfilter, lfilter_zi

from surefoot.errors import UserError
from surefoot.physics.mujoco_engine import MujocoEngine
from surefoot.physics.step_record import StepRecord
from surefoot.rates import TICKS_PER_STEP
from surefoot.robots import Robot
from surefoot.task import observation
from surefoot.task.control_loop import ControlLoop
from surefoot.task.imperfections import PERFECT, Imperfections

LEG = ("hip_roll", "hip_pitch", "knee_pitch", "ankle_pitch", "ankle_roll")
JOINTS = {"torso_pitch", *(f"{side}_{name}" for side in ("left", "right") for name in LEG)}


def make_loop(robot: Robot, num_robots: int, pose: str = "bent", action_scale: float = 1.0) -> ControlLoop:
    return ControlLoop(robot, num_robots, robot.pose(pose), action_scale, num_threads=1)


def targets_of(ticks: StepRecord) -> np.ndarray:
    """The joint targets behind the torques: torque = Kp (target - q) - Kd q', solved for the target."""
    robot = ticks.robot
    assert (np.abs(ticks.joint_torque) < robot.torque_limit).all()
    return ticks.joint_position + (ticks.joint_torque + robot.damping * ticks.joint_velocity) / robot.stiffness


def test_zero_actions_hold_the_nominal_pose(robot: Robot) -> None:
    loop = make_loop(robot, 2)
    loop.reset(np.arange(2), np.tile(robot.pose("bent"), (2, 1)))
    for _ in range(25):
        ticks = loop.step(np.zeros((2, 11)))
    # The joints sag under the load by torque / stiffness, at most 0.1 rad, and come to rest.
    assert np.abs(ticks.joint_position[:, -1] - robot.pose("bent")).max() < 0.1
    assert np.abs(ticks.com_velocity[:, -1]).max() < 0.05
    assert ticks.foot_contact.all()


def test_an_action_is_reached_along_a_cubic_from_the_last_target(robot: Robot) -> None:
    loop = make_loop(robot, 1, action_scale=0.5)
    loop.reset(np.array([0]), robot.pose("bent")[None], height=3.0)
    knee = robot.joint_names.index("left_knee_pitch")
    for last, action, goal in ((0.5, 0.1, 0.55), (0.55, 0.1, 0.55), (0.55, -0.06, 0.47)):  # 0.5 + 0.5 * action
        actions = np.zeros((1, 11))
        actions[0, knee] = action
        path = targets_of(loop.step(actions))[0, :, knee]
        # Tick 5 of 20 is at 3 / 16 - 2 / 64 = 0.15625 of the way, tick 10 half way, tick 20 there.
        assert path[4] == pytest.approx(last + 0.15625 * (goal - last), abs=1e-9)
        assert path[9] == pytest.approx(0.5 * (last + goal), abs=1e-9)
        assert path[19] == pytest.approx(goal, abs=1e-9)


def test_actions_are_clipped_to_one_unit_and_to_the_joint_ranges(robot: Robot) -> None:
    loop = make_loop(robot, 2, pose="straight", action_scale=0.3)
    loop.reset(np.arange(2), np.zeros((2, 11)), height=50.0)
    for _ in range(25):
        ticks = loop.step(np.stack([np.full(11, 50.0), np.full(11, -50.0)]))
    up, down = targets_of(ticks)[:, -1]
    # +-0.3 rad but for the ranges: torso -0.13, knees -0.083.
    np.testing.assert_allclose(up, np.full(11, 0.3), atol=1e-9)
    expected = np.full(11, -0.3)
    expected[robot.joint_names.index("torso_pitch")] = -0.13
    expected[[3, 8]] = -0.083
    np.testing.assert_allclose(down, expected, atol=1e-9)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_large_action_asks_for_the_end_of_a_joints_range_and_no_more(robot: Robot, sign: float) -> None:
    # One joint each. Hips do not roll inwards or pitch to the chest: there the other leg or the chest is in the way.
    free = {1.0: JOINTS - {"right_hip_roll"}, -1.0: JOINTS - {"left_hip_roll", "left_hip_pitch", "right_hip_pitch"}}
    indices = [robot.joint_names.index(name) for name in free[sign]]
    loop = make_loop(robot, len(indices), pose="straight", action_scale=3.0)
    loop.reset(np.arange(len(indices)), np.zeros((len(indices), 11)), height=50.0)
    actions = np.zeros((len(indices), 11))
    actions[np.arange(len(indices)), indices] = sign
    for _ in range(40):
        ticks = loop.step(actions)
    reached = targets_of(ticks)[np.arange(len(indices)), -1, indices]
    limit = robot.joint_upper if sign > 0 else robot.joint_lower
    np.testing.assert_allclose(reached, limit[indices], atol=1e-9)


def test_the_observation_is_the_unfiltered_one_through_scipys_butterworth(robot: Robot) -> None:
    loop = make_loop(robot, 2)
    start = loop.reset(np.arange(2), robot.pose("bent") + np.array([[0.0], [0.01]]))
    rng = np.random.default_rng(1)
    b, a = butter(1, 10.0, fs=500.0)
    state = lfilter_zi(b, a)[0] * observation.observe(start)
    for _ in range(10):
        unfiltered = observation.observe(loop.step(rng.uniform(-0.1, 0.1, (2, 11))))
        filtered, state = lfilter(b, a, unfiltered, axis=1, zi=state)
        np.testing.assert_allclose(loop.observation, filtered[:, -1], rtol=0, atol=1e-10)


def test_the_filter_starts_in_the_steady_state_of_the_first_observation(robot: Robot) -> None:
    loop = make_loop(robot, 3)
    loop.reset(np.arange(3), np.tile(robot.pose("bent"), (3, 1)))
    for _ in range(5):
        loop.step(np.random.default_rng(0).uniform(-0.2, 0.2, (3, 11)))
    before = loop.observation.copy()
    start = loop.reset(np.array([1]), robot.pose("bent")[None], height=0.3)
    np.testing.assert_array_equal(loop.observation[1], observation.observe(start)[0, 0])
    np.testing.assert_array_equal(loop.observation[[0, 2]], before[[0, 2]])


def test_the_nominal_com_height_is_that_of_the_nominal_pose(robot: Robot) -> None:
    # Straight: 1.171429 m from root to sole, CoM 0.0672 m below the root (test_robot.py).
    assert make_loop(robot, 1, "straight").nominal_com_height == pytest.approx(1.1042, abs=5e-4)
    # Bent by 0.5 rad: thigh 0.43096 (1 - cos 0.19) = 7.8 mm and shank 0.40627 (1 - cos 0.31) = 19.4 mm lower the
    # root by 27 mm, and the CoM, three quarters of which it carries, by a bit less.
    bent = make_loop(robot, 1, "bent").nominal_com_height
    assert 1.1042 - 0.027 < bent < 1.1042 - 0.018


def test_a_push_acts_at_its_ticks_and_reset_cancels_it(robot: Robot) -> None:
    loop = make_loop(robot, 2)
    loop.reset(np.arange(2), np.tile(robot.pose("bent"), (2, 1)), height=5.0)
    impulse = np.tile([24.0, 0.0, 0.0], (2, 1))
    loop.pushes.schedule(np.arange(2), 0, np.full(2, robot.body_id("root")), impulse, np.array([33, 33]), 0.12)
    momentum = [137.2875 * loop.step(np.zeros((2, 11))).com_velocity[..., 0] for _ in range(2)]
    # Tick 33 is the first one pushed; tick 39, the last seen, has felt 6 ticks of 24 / 60 = 0.4 Ns.
    np.testing.assert_allclose(momentum[0], 0.0, atol=0.01)
    np.testing.assert_allclose(momentum[1][:, :14], 0.0, atol=0.01)
    np.testing.assert_allclose(momentum[1][:, 19], 2.4, atol=0.01)
    loop.reset(np.array([1]), robot.pose("bent")[None], height=5.0)
    for _ in range(5):
        ticks = loop.step(np.zeros((2, 11)))
    np.testing.assert_allclose(137.2875 * ticks.com_velocity[:, -1, 0], [24.0, 0.0], atol=0.02)
    np.testing.assert_array_equal(loop.tick, [140, 100])


def test_a_step_of_some_robots_leaves_the_others_clock_target_and_filter(robot: Robot) -> None:
    everyone = np.arange(3)
    loop, reference = make_loop(robot, 3), make_loop(robot, 3)
    actions = np.random.default_rng(3).uniform(-0.1, 0.1, (4, 3, 11))
    for each in (loop, reference):
        each.reset(everyone, np.tile(robot.pose("bent"), (3, 1)))
        each.step(actions[0])
    waited = loop.observation[1].copy()
    for k in (1, 2):
        loop.step(actions[k, [0, 2]], np.array([0, 2]))
    np.testing.assert_array_equal(loop.tick, [60, 20, 60])
    np.testing.assert_array_equal(loop.observation[1], waited)
    for k in (1, 2):
        reference.step(actions[k])
    # Who waited goes on as if nothing had been.
    late = make_loop(robot, 3)
    late.reset(everyone, np.tile(robot.pose("bent"), (3, 1)))
    late.step(actions[0])
    late.step(actions[3])
    loop.step(actions[3, [1]], np.array([1]))
    np.testing.assert_array_equal(loop.observation[1], late.observation[1])
    np.testing.assert_array_equal(loop.observation[[0, 2]], reference.observation[[0, 2]])


def test_the_loop_moves_the_robot_as_the_simulation_alone_does(robot: Robot) -> None:
    loop = make_loop(robot, 1, pose="straight")
    loop.reset(np.array([0]), np.zeros((1, 11)))
    engine = MujocoEngine(robot, 1, num_threads=1)
    engine.reset(np.array([0]), np.zeros((1, 11)))
    for _ in range(5):
        record = loop.step(np.zeros((1, 11))).record.copy()
        np.testing.assert_array_equal(record, step_to(engine, np.zeros((1, TICKS_PER_STEP, 11))).record)


def test_a_first_push_and_another_add_up_and_reset_cancels_both(robot: Robot) -> None:
    loop = make_loop(robot, 2)
    loop.reset(np.arange(2), np.tile(robot.pose("bent"), (2, 1)), height=5.0)
    for slot, body, impulse, start in ((0, "root", [24.0, 0.0, 0.0], 5), (1, "torso", [0.0, -12.0, 0.0], 45)):
        loop.pushes.schedule(np.arange(2), slot, robot.body_id(body), np.array(impulse), start, 0.12)
    loop.step(np.zeros((2, 11)))
    loop.reset(np.array([1]), robot.pose("bent")[None], height=5.0)
    for _ in range(6):
        ticks = loop.step(np.zeros((2, 11)))
    momentum = 137.2875 * ticks.com_velocity[:, -1, :2]
    np.testing.assert_allclose(momentum, [[24.0, -12.0], [0.0, 0.0]], atol=0.02)


# Imperfections.


def imperfect_loop(robot: Robot, imperfections: Imperfections, seed: int = 3, **options: float) -> ControlLoop:
    """Two bent robots at rest at 50 m, the second of them imperfect."""
    loop = make_loop(robot, 2, **options)
    loop.reset(np.arange(2), np.tile(robot.pose("bent"), (2, 1)), height=50.0)
    loop.set_imperfections(1, imperfections, seed)
    return loop


@pytest.mark.parametrize("latency_ms", [0, 2, 14, 40])
def test_latency_shifts_the_targets_by_exactly_its_ticks(robot: Robot, latency_ms: int) -> None:
    loop = imperfect_loop(robot, Imperfections(latency=latency_ms / 1000))
    actions = np.random.default_rng(0).uniform(-0.02, 0.02, (6, 1, 11))
    targets = np.concatenate([targets_of(loop.step(np.tile(action, (2, 1)))) for action in actions], axis=1)
    num_ticks = latency_ms // 2
    np.testing.assert_allclose(targets[1, num_ticks:], targets[0, : 120 - num_ticks], atol=1e-9)
    # Until the first action arrives the nominal pose is held.
    np.testing.assert_allclose(targets[1, :num_ticks], np.tile(robot.pose("bent"), (num_ticks, 1)), atol=1e-9)
    assert np.abs(np.diff(targets[0], axis=0)).max() > 1e-4


def observed(loop: ControlLoop, num_steps: int) -> np.ndarray:
    """What the second robot sees beyond the first one, whose motion is the same: (num_steps, 47)."""
    seen = []
    for _ in range(num_steps):
        record = loop.step(np.zeros((2, 11))).record
        np.testing.assert_array_equal(record[0], record[1])
        seen.append(loop.observation[1] - loop.observation[0])
    return np.array(seen)


def test_observation_noise_is_added_at_every_tick_before_the_filter(robot: Robot) -> None:
    noise = observed(imperfect_loop(robot, Imperfections(observation_noise=0.5)), 150)[2:]
    # White noise through y[k] = b0 (x[k] + x[k-1]) - a1 y[k-1] has sum h^2 = b0^2 (1 + (1 - a1)^2 / (1 - a1^2)) = b0
    # of its variance, with b0 = 0.0592 at 10 of 500 Hz: 0.5 * 0.2433 = 0.1217.
    b0 = butter(1, 10.0, fs=500.0)[0][0]
    assert noise.std() == pytest.approx(0.5 * np.sqrt(b0), rel=4 / np.sqrt(2 * noise.size))
    # In every component's own unit: forces of 800 N as much as angles.
    np.testing.assert_allclose(noise.std(axis=0), 0.5 * np.sqrt(b0), rtol=4 / np.sqrt(2 * len(noise)))
    # Of one step a1^20 = 0.08 is left in the next.
    assert np.corrcoef(noise[1:].ravel(), noise[:-1].ravel())[0, 1] == pytest.approx(0.08, abs=4 / np.sqrt(noise.size))


def test_a_bias_is_the_same_throughout_and_the_seeds_own(robot: Robot) -> None:
    loop = imperfect_loop(robot, Imperfections(sensor_bias=0.1))
    first = loop.observation[1] - loop.observation[0]
    bias = observed(loop, 20)
    np.testing.assert_allclose(bias, np.tile(first, (20, 1)), atol=1e-12)
    in_deviations = bias[-1] / observation.scales(robot)
    assert in_deviations.std() == pytest.approx(0.1, rel=4 / np.sqrt(2 * 47))
    again, other = (observed(imperfect_loop(robot, Imperfections(sensor_bias=0.1), seed), 20)[-1] for seed in (3, 4))
    np.testing.assert_allclose(again, bias[-1], atol=1e-12)
    assert (other != bias[-1]).all()


def test_action_noise_is_in_rad_and_new_at_every_policy_step(robot: Robot) -> None:
    loop = imperfect_loop(robot, Imperfections(action_noise=0.004), action_scale=0.2)
    noise = []
    for _ in range(60):
        both = targets_of(loop.step(np.full((2, 11), 0.05)))
        np.testing.assert_allclose(both[0, -1], robot.pose("bent") + 0.2 * 0.05, atol=1e-9)
        noise.append(both[1, -1] - both[0, -1])
        # Along a cubic from one to the next: half way at the middle.
        last = noise[-2] if len(noise) > 1 else np.zeros(11)
        np.testing.assert_allclose(both[1, 9] - both[0, 9], 0.5 * (last + noise[-1]), atol=1e-9)
    assert np.std(noise) == pytest.approx(0.004, rel=4 / np.sqrt(2 * 660))
    assert abs(np.corrcoef(np.ravel(noise[1:]), np.ravel(noise[:-1]))[0, 1]) < 4 / np.sqrt(649)


def test_action_noise_never_asks_for_more_than_a_joints_range(robot: Robot) -> None:
    loop = make_loop(robot, 1, "straight")
    loop.reset(np.array([0]), np.zeros((1, 11)), height=50.0)
    loop.set_imperfections(0, Imperfections(action_noise=5.0), seed=0)
    for _ in range(10):
        loop.step(np.zeros((1, 11)))
        assert (loop.engine.joint_targets >= robot.joint_lower - 1e-12).all()
        assert (loop.engine.joint_targets <= robot.joint_upper + 1e-12).all()


ROUGH = Imperfections(observation_noise=0.5, action_noise=0.05, sensor_bias=0.1, latency=0.01)


def stepped(loop: ControlLoop, ids: np.ndarray, robot: int, num_steps: int = 5) -> list[np.ndarray]:
    """Records and observations of one robot under a policy that reacts to what it sees."""
    seen = []
    for _ in range(num_steps):
        ticks = loop.step(0.05 * np.tanh(loop.observation[ids, :11]), ids)
        seen += [ticks.record[ids == robot].copy(), loop.observation[robot].copy()]
    return seen


def test_a_perfect_robot_beside_an_imperfect_one_moves_as_one_alone(robot: Robot) -> None:
    alone = make_loop(robot, 1)
    alone.reset(np.array([0]), robot.pose("bent")[None], height=50.0)
    expected = stepped(alone, np.array([0]), 0)
    loop = imperfect_loop(robot, ROUGH)
    loop.set_imperfections(0, PERFECT, seed=8)
    for found, wanted in zip(stepped(loop, np.array([0, 1]), 0), expected, strict=True):
        np.testing.assert_array_equal(found, wanted)
    imperfect = stepped(imperfect_loop(robot, ROUGH), np.array([0, 1]), 1)
    assert (imperfect[1] != expected[1]).all()


def test_an_imperfect_robot_moves_as_one_alone(robot: Robot) -> None:
    alone = make_loop(robot, 1)
    alone.reset(np.array([0]), robot.pose("bent")[None], height=50.0)
    alone.set_imperfections(0, ROUGH, seed=3)
    expected = stepped(alone, np.array([0]), 0)
    for found, wanted in zip(stepped(imperfect_loop(robot, ROUGH), np.array([0, 1]), 1), expected, strict=True):
        np.testing.assert_array_equal(found, wanted)


def test_reset_makes_a_robot_perfect_again(robot: Robot) -> None:
    loop = imperfect_loop(robot, ROUGH)
    stepped(loop, np.array([0, 1]), 1)
    loop.reset(np.arange(2), np.tile(robot.pose("bent"), (2, 1)), height=50.0)
    for _ in range(5):
        record = loop.step(np.full((2, 11), 0.02)).record
        np.testing.assert_array_equal(record[0], record[1])
        np.testing.assert_array_equal(loop.observation[0], loop.observation[1])


def test_reset_makes_a_robot_perfect_again_beside_one_that_stays_imperfect(robot: Robot) -> None:
    loop, pose = imperfect_loop(robot, ROUGH), robot.pose("bent")[None]
    loop.set_imperfections(0, ROUGH, seed=4)
    loop.reset(np.array([0]), pose, height=50.0)
    alone = make_loop(robot, 1)
    alone.reset(np.array([0]), pose, height=50.0)
    expected = stepped(alone, np.array([0]), 0)
    for found, wanted in zip(stepped(loop, np.array([0, 1]), 0), expected, strict=True):
        np.testing.assert_array_equal(found, wanted)


def test_actions_of_a_wrong_shape_are_refused_with_both_shapes(robot: Robot) -> None:
    loop = make_loop(robot, 3)
    for actions, shape in ((np.zeros((3, 10)), "(3, 10)"), (np.zeros(11), "(11,)"), (np.zeros((2, 11)), "(2, 11)")):
        with pytest.raises(UserError) as error:
            loop.step(actions)
        assert str(error.value) == f"actions must have shape (3, 11), not {shape}"
    with pytest.raises(UserError) as error:
        loop.step(np.zeros((3, 11)), np.array([0, 1]))
    assert str(error.value) == "actions must have shape (2, 11), not (3, 11)"
