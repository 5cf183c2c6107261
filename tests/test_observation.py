from __future__ import annotations

import numpy as np
import pytest
from conftest import step_to
from scipy.spatial.transform import Rotation

from surefoot.physics.mujoco_engine import MujocoEngine
from surefoot.physics.step_record import StepRecord
from surefoot.rates import TICKS_PER_STEP
from surefoot.robots import Robot
from surefoot.task import observation
from surefoot.task.control_loop import ControlLoop

LEG = ("hip_roll", "hip_pitch", "knee_pitch", "ankle_pitch", "ankle_roll")
JOINTS = ["torso_pitch", *(f"left_{name}" for name in LEG), *(f"right_{name}" for name in LEG)]
# The list of section IV-C, in its order: joint angle and velocity, root velocities and orientation, CoM velocity and
# position, ground contact force, torso position, foot positions.
COMPONENTS = [
    *(f"joint_position.{joint}" for joint in JOINTS),
    *(f"joint_velocity.{joint}" for joint in JOINTS),
    *(f"pelvis_velocity.{axis}" for axis in "xyz"),
    *(f"pelvis_angular_velocity.{axis}" for axis in "xyz"),
    "pelvis_attitude.roll",
    "pelvis_attitude.pitch",
    *(f"com_velocity.{axis}" for axis in "xyz"),
    *(f"com_position.{axis}" for axis in "xyz"),
    "foot_force.left",
    "foot_force.right",
    *(f"torso_position.{axis}" for axis in "xyz"),
    *(f"left_foot_position.{axis}" for axis in "xyz"),
    *(f"right_foot_position.{axis}" for axis in "xyz"),
]


def part(vector: np.ndarray, name: str) -> np.ndarray:
    """The components of one quantity of an observation (..., 47)."""
    return vector[..., [i for i, component in enumerate(COMPONENTS) if component.startswith(f"{name}.")]]


def in_the_air(robot: Robot, qpos: np.ndarray, qvel: np.ndarray) -> StepRecord:
    """One tick of robots in any state (n, 18), (n, 17) of MuJoCo's order."""
    engine = MujocoEngine(robot, len(qpos), num_threads=1)
    engine.state[0][:], engine.state[1][:] = qpos, qvel
    engine.batch.forward()
    return engine.read(np.arange(len(qpos)))


def random_state(robot: Robot, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Anything that a flying robot may do: (18,), (17,)."""
    rng = np.random.default_rng(seed)
    turn = Rotation.from_euler("ZYX", rng.uniform(-0.8, 0.8, 3)).as_quat(scalar_first=True)
    joints = rng.uniform(robot.joint_lower, robot.joint_upper)
    position = [*rng.uniform(-1, 1, 2), 4.0]
    return np.concatenate([position, turn, joints]), rng.normal(size=17)


def test_the_observation_is_the_papers_list_of_47(robot: Robot) -> None:
    assert list(observation.component_names(robot)) == COMPONENTS
    assert len(COMPONENTS) == 47


def test_every_quantity_of_a_known_state_stands_in_its_place(robot: Robot) -> None:
    joints = np.linspace(-0.05, 0.05, 11)
    qpos = np.concatenate([[3.0, -2.0, 5.0, 1.0, 0.0, 0.0, 0.0], joints])
    qvel = np.concatenate([[0.3, -0.2, 0.1, 0.0, 0.0, 0.0], np.linspace(-1.0, 1.0, 11)])
    ticks = in_the_air(robot, qpos[None], qvel[None])
    vector = observation.observe(ticks)[0, 0]
    np.testing.assert_allclose(part(vector, "joint_position"), joints, atol=1e-15)
    # A share of the speed limit: torso 9, hip roll and pitch 6.11, knee and ankles 11 rad/s.
    limits = np.array([9.0, *[6.11, 6.11, 11.0, 11.0, 11.0] * 2])
    np.testing.assert_allclose(part(vector, "joint_velocity"), np.linspace(-1.0, 1.0, 11) / limits, rtol=1e-12)
    np.testing.assert_allclose(part(vector, "pelvis_velocity"), [0.3, -0.2, 0.1], atol=1e-15)
    np.testing.assert_allclose(part(vector, "pelvis_angular_velocity"), 0.0, atol=1e-15)
    np.testing.assert_allclose(part(vector, "pelvis_attitude"), 0.0, atol=1e-15)
    np.testing.assert_array_equal(part(vector, "foot_force"), 0.0)
    np.testing.assert_allclose(part(vector, "com_velocity"), ticks.com_velocity[0, 0], atol=1e-15)
    root = np.array([3.0, -2.0, 5.0])
    np.testing.assert_allclose(part(vector, "com_position"), ticks.com_position[0, 0] - root, atol=1e-14)
    np.testing.assert_allclose(part(vector, "left_foot_position"), ticks.sole_position[0, 0, 0] - root, atol=1e-14)
    np.testing.assert_allclose(part(vector, "right_foot_position"), ticks.sole_position[0, 0, 1] - root, atol=1e-14)


def test_positions_of_the_straight_robot_are_those_of_the_urdf(robot: Robot) -> None:
    qpos = np.zeros(18)
    qpos[2], qpos[3] = 5.0, 1.0
    vector = observation.observe(in_the_air(robot, qpos[None], np.zeros((1, 17))))[0, 0]
    # Hip 0.1016 + knee 0.0361046 to the side; 0.000112225 - 0.0102381 + 0.045 to the front;
    # 0.1853 + 0.0609 + 0.430959 + 0.40627 + 0.088 down.
    foot = np.array([0.034874125, 0.1377046, -1.171429])
    np.testing.assert_allclose(part(vector, "left_foot_position"), foot, atol=1e-9)
    np.testing.assert_allclose(part(vector, "right_foot_position"), foot * [1, -1, 1], atol=1e-9)
    # The torso link's CoM: 0.04191 - 0.095548, 0, 0.0203 + 0.243098.
    np.testing.assert_allclose(part(vector, "torso_position"), [-0.053638, 0.0, 0.263398], atol=1e-9)
    # The whole robot's, from the URDF (test_robot.py); within 1 mm.
    np.testing.assert_allclose(part(vector, "com_position"), [-0.01263, -0.00047, -0.06723], atol=1e-3)


def test_the_root_turns_about_the_heading_frames_axes(robot: Robot) -> None:
    # Yawed by 90 degrees, the world's +y is forward. MuJoCo's angular velocity is in the body frame.
    half = np.sqrt(0.5)
    qpos = np.concatenate([[0, 0, 5, half, 0, 0, half], np.zeros(11)])
    qvel = np.concatenate([[0.0, 2.0, 0.5], [0.1, 0.2, 0.3], np.zeros(11)])
    vector = observation.observe(in_the_air(robot, qpos[None], qvel[None]))[0, 0]
    np.testing.assert_allclose(part(vector, "pelvis_velocity"), [2.0, 0.0, 0.5], atol=1e-15)
    np.testing.assert_allclose(part(vector, "pelvis_angular_velocity"), [0.1, 0.2, 0.3], atol=1e-15)


def test_a_pitched_root_is_seen_as_pitch_and_the_heading_frame_stays_level(robot: Robot) -> None:
    qpos = np.concatenate([[0, 0, 5], [np.cos(0.1), 0, np.sin(0.1), 0], np.zeros(11)])
    qvel = np.concatenate([[1.0, 0, 0], np.zeros(14)])
    vector = observation.observe(in_the_air(robot, qpos[None], qvel[None]))[0, 0]
    np.testing.assert_allclose(part(vector, "pelvis_attitude"), [0.0, 0.2], atol=1e-15)
    np.testing.assert_allclose(part(vector, "pelvis_velocity"), [1.0, 0.0, 0.0], atol=1e-15)
    # The foot turns about the root with it: x cos + z sin, -x sin + z cos.
    x, z = 0.034874125, -1.171429
    expected = [x * np.cos(0.2) + z * np.sin(0.2), 0.1377046, z * np.cos(0.2) - x * np.sin(0.2)]
    np.testing.assert_allclose(part(vector, "left_foot_position"), expected, atol=1e-9)


def test_foot_forces_are_in_units_of_800_n(standing: StepRecord) -> None:
    forces = part(observation.observe(standing), "foot_force")
    np.testing.assert_allclose(forces * 800.0, standing.foot_force, rtol=1e-12)
    # Half of 1346.33 N each: 0.8415
    np.testing.assert_allclose(forces, 673.17 / 800.0, rtol=0.01)


@pytest.mark.parametrize("yaw", [0.7, -1.9, np.pi])
def test_a_state_turned_about_the_vertical_gives_the_same_numbers(robot: Robot, yaw: float) -> None:
    qpos, qvel = random_state(robot, seed=4)
    turn = Rotation.from_euler("Z", yaw)
    turned_qpos, turned_qvel = qpos.copy(), qvel.copy()
    turned_qpos[:3] = turn.apply(qpos[:3]) + [7.0, -3.0, 0.0]
    turned_qpos[3:7] = (turn * Rotation.from_quat(qpos[3:7], scalar_first=True)).as_quat(scalar_first=True)
    turned_qvel[:3] = turn.apply(qvel[:3])
    here, there = observation.observe(in_the_air(robot, np.stack([qpos, turned_qpos]), np.stack([qvel, turned_qvel])))
    np.testing.assert_allclose(there, here, rtol=0, atol=1e-12)
    assert np.abs(here).max() > 0.5


def test_a_pushed_motion_looks_the_same_from_every_heading(robot: Robot) -> None:
    """The whole world is turned: robot and push. From 1 mm above the floor, so that rounding decides no contact."""
    yaw = np.array([0.0, 0.7, 2.5, -1.9])
    everyone = np.arange(len(yaw))
    loop = ControlLoop(robot, len(yaw), robot.pose("bent"), 1.0, num_threads=1)
    loop.reset(everyone, np.tile(robot.pose("bent"), (len(yaw), 1)), yaw=yaw, height=1e-3)
    push = Rotation.from_euler("Z", yaw[:, None]).apply([40.0, 30.0, 0.0])
    loop.pushes.schedule(everyone, 0, np.full(4, robot.body_id("torso")), push, np.full(4, 37), 0.12)
    rng = np.random.default_rng(0)
    for _ in range(25):
        ticks = loop.step(np.tile(rng.uniform(-0.1, 0.1, robot.num_joints), (len(yaw), 1)))
        unfiltered = observation.observe(ticks)
        np.testing.assert_allclose(unfiltered, np.broadcast_to(unfiltered[0], unfiltered.shape), rtol=0, atol=1e-9)
        np.testing.assert_allclose(loop.observation, np.tile(loop.observation[0], (4, 1)), rtol=0, atol=1e-9)
    # The push moved them, and in the world they move differently.
    assert np.abs(part(loop.observation[0], "com_velocity")).max() > 0.2
    assert np.ptp(ticks.com_velocity[:, -1, 0]) > 0.2


def mirrored_state(robot: Robot, qpos: np.ndarray, qvel: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The state seen in a mirror in the x-z plane."""
    source, sign = (robot.mirror_source, robot.mirror_sign)
    position, (w, x, y, z) = qpos[:3] * [1, -1, 1], qpos[3:7]
    velocity, turning = qvel[:3] * [1, -1, 1], qvel[3:6] * [-1, 1, -1]
    other = np.concatenate([position, [w, -x, y, -z], sign * qpos[7:][source]])
    return other, np.concatenate([velocity, turning, sign * qvel[6:][source]])


@pytest.mark.parametrize("seed", range(4))
def test_the_mirrored_observation_is_the_observation_of_the_mirrored_robot(robot: Robot, seed: int) -> None:
    qpos, qvel = random_state(robot, seed)
    other_qpos, other_qvel = mirrored_state(robot, qpos, qvel)
    here, there = observation.observe(in_the_air(robot, np.stack([qpos, other_qpos]), np.stack([qvel, other_qvel])))
    source, sign = observation.mirror(robot)
    mirrored = sign * here[0][source]
    # Shapes are mirror images; masses are not quite (the CoM is 0.5 mm off the middle).
    tolerance = np.full(47, 1e-12)
    tolerance[[i for i, name in enumerate(COMPONENTS) if name.startswith("com_velocity")]] = 0.02
    tolerance[[i for i, name in enumerate(COMPONENTS) if name.startswith("com_position")]] = 0.002
    assert (np.abs(there[0] - mirrored) <= tolerance).all()
    assert np.abs(there[0] - here[0]).max() > 0.1


def test_mirrored_actions_and_pushes_lead_to_mirrored_observations(robot: Robot) -> None:
    loop = ControlLoop(robot, 2, robot.pose("bent"), 1.0, num_threads=1)
    loop.reset(np.arange(2), np.tile(robot.pose("bent"), (2, 1)), height=1e-3)
    push = np.array([[10.0, 25.0, 0.0], [10.0, -25.0, 0.0]])
    loop.pushes.schedule(np.arange(2), 0, np.full(2, robot.body_id("root")), push, np.full(2, 100), 0.12)
    joints, joint_sign = (robot.mirror_source, robot.mirror_sign)
    action = np.random.default_rng(1).uniform(-0.04, 0.04, robot.num_joints)
    for _ in range(12):
        loop.step(np.stack([action, joint_sign * action[joints]]))
    source, sign = observation.mirror(robot)
    here, there = loop.observation
    assert abs(part(here, "foot_force")[0] - part(here, "foot_force")[1]) > 0.1
    # NASA's feet and shanks are the same parts on both sides, hence the tolerances; feet that are about to lift off
    # feel it most.
    tolerance = np.where([name.startswith("foot_force") for name in COMPONENTS], 0.1, 0.03)
    assert (np.abs(there - sign * here[source]) <= tolerance).all()
    assert (np.abs(there - here) > 3 * tolerance).any()


def test_mirroring_twice_changes_nothing(robot: Robot) -> None:
    for source, sign in (observation.mirror(robot), (robot.mirror_source, robot.mirror_sign)):
        vector = np.random.default_rng(0).normal(size=len(source))
        np.testing.assert_array_equal(sign * (sign * vector[source])[source], vector)


def test_the_mirror_exchanges_sides_and_turns_what_points_sideways(robot: Robot) -> None:
    source, sign = observation.mirror(robot)
    mirror = {name: (COMPONENTS[source[i]], sign[i]) for i, name in enumerate(COMPONENTS)}
    assert mirror["joint_position.left_hip_roll"] == ("joint_position.right_hip_roll", -1.0)
    assert mirror["joint_velocity.right_knee_pitch"] == ("joint_velocity.left_knee_pitch", 1.0)
    assert mirror["joint_position.torso_pitch"] == ("joint_position.torso_pitch", 1.0)
    assert mirror["pelvis_velocity.y"] == ("pelvis_velocity.y", -1.0)
    assert [mirror[f"pelvis_angular_velocity.{axis}"][1] for axis in "xyz"] == [-1.0, 1.0, -1.0]
    assert mirror["pelvis_attitude.roll"] == ("pelvis_attitude.roll", -1.0)
    assert mirror["pelvis_attitude.pitch"] == ("pelvis_attitude.pitch", 1.0)
    assert mirror["foot_force.left"] == ("foot_force.right", 1.0)
    assert mirror["left_foot_position.y"] == ("right_foot_position.y", -1.0)


def test_scales_are_those_of_the_table_and_positive(robot: Robot) -> None:
    scales = observation.scales(robot)
    for name in ("joint_position", "com_velocity", "foot_force", "right_foot_position"):
        np.testing.assert_array_equal(part(scales, name), observation.TABLE[name].scale)
    assert scales.shape == (47,)
    assert (scales > 0).all()


def test_every_tick_and_robot_is_observed_alike(robot: Robot) -> None:
    engine = MujocoEngine(robot, 3, num_threads=1)
    engine.reset(np.arange(3), np.tile(robot.pose("bent"), (3, 1)), yaw=np.array([0.0, 1.0, 2.0]))
    targets = np.random.default_rng(0).uniform(-0.2, 0.2, (3, TICKS_PER_STEP, robot.num_joints))
    ticks = step_to(engine, targets)
    together = observation.observe(ticks)
    for robot_index, tick in ((0, 0), (1, 13), (2, 19)):
        one = ticks[robot_index : robot_index + 1].ticks(slice(tick, tick + 1))
        np.testing.assert_array_equal(observation.observe(one)[0, 0], together[robot_index, tick])
