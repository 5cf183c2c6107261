"""Worlds that differ from the model's own: what a changed floor, mass, motor or physics rate does, measured."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import TIPTOE, hold, step_to

from surefoot.physics.mujoco_engine import MujocoEngine
from surefoot.physics.rotations import sole_corners
from surefoot.physics.step_record import StepRecord
from surefoot.rates import CONTROL_DT, TICKS_PER_STEP
from surefoot.robots import Robot, load_robot
from surefoot.robots.domain import NOMINAL_DOMAIN, DomainParameters
from surefoot.robots.model import FLOOR, foot_friction


def standing_in(
    robot: Robot, domain: DomainParameters, num_steps: int = 50, yaw: float = 0.0, ankles: float = 0.0
) -> StepRecord:
    """The last policy step of the bent robot, its ankles turned by so much [rad]."""
    engine = MujocoEngine(robot, 1, num_threads=1, domain=domain)
    pose = robot.pose("bent").copy()
    pose[[robot.joint_names.index(f"{side}_ankle_pitch") for side in ("left", "right")]] += ankles
    engine.reset(np.array([0]), pose[None], yaw=yaw)
    for _ in range(num_steps):
        ticks = step_to(engine, np.tile(pose, (1, TICKS_PER_STEP, 1)))
    return ticks


def test_the_nominal_domain_is_the_models_own_to_the_last_bit(robot: Robot) -> None:
    plain, nominal = robot.build().compile(), robot.model(NOMINAL_DOMAIN)
    for part in ("body_mass", "body_inertia", "actuator_forcerange", "dof_damping", "jnt_range", "qpos0"):
        np.testing.assert_array_equal(getattr(nominal, part), getattr(plain, part), part)
    floors = [model.geom(FLOOR) for model in (plain, nominal)]
    np.testing.assert_array_equal(floors[1].friction, floors[0].friction)
    np.testing.assert_array_equal(floors[1].quat, floors[0].quat)
    assert nominal.opt.timestep == plain.opt.timestep
    # A domain that is as good as nominal goes another way, and moves the robot alike.
    nearly = standing_in(robot, DomainParameters(friction=1.0 + 1e-12), 5)
    np.testing.assert_allclose(nearly.record, standing_in(robot, NOMINAL_DOMAIN, 5).record, rtol=1e-6, atol=1e-6)


def test_friction_is_a_coefficient_whatever_the_models_own_is(tmp_path: Path) -> None:
    """The second robot's soles, with 0.6 and a priority over the floor's 1, as those of Menagerie's G1."""
    for file in TIPTOE.parent.iterdir():
        text = file.read_bytes().replace(
            b'<geom friction="1" condim="3"', b'<geom friction="0.6" priority="1" condim="3"'
        )
        (tmp_path / file.name).write_bytes(text)
    slippery = load_robot(tmp_path / TIPTOE.name)
    assert (load_robot(TIPTOE).friction, slippery.friction) == (1.0, 0.6)
    for robot in (load_robot(TIPTOE), slippery):
        model = robot.model(DomainParameters(friction=0.3))
        assert foot_friction(model, robot.feet) == 0.3


@pytest.mark.parametrize("friction", [0.3, 0.5, 1.2])
def test_sliding_feet_are_braked_by_the_worlds_friction(robot: Robot, friction: float) -> None:
    engine = MujocoEngine(robot, 1, num_threads=1, domain=DomainParameters(friction=friction))
    engine.reset(np.array([0]), robot.pose("straight")[None])
    engine.state[1][0, 0] = 3.0
    ratios = []
    for _ in range(5):
        ticks = step_to(engine, hold(robot, 1, "straight"))
        for foot in ("left", "right"):
            force = ticks[f"{foot}_foot_contact"][..., 1:4]
            loaded = force[..., 2] > 50.0
            ratios.append(np.hypot(force[..., 0], force[..., 1])[loaded] / force[..., 2][loaded])
    # Elliptic cone: |tangential| <= mu * normal, and equal to it while a foot slides.
    assert np.concatenate(ratios).max() == pytest.approx(friction, abs=1e-6)


@pytest.mark.parametrize("scale", [0.9, 1.1])
def test_the_feet_bear_the_scaled_weight(robot: Robot, scale: float) -> None:
    domain = DomainParameters(mass_scale=scale)
    ticks = standing_in(robot, domain)
    assert ticks.foot_force[0, -1].sum() == pytest.approx(scale * 1346.33, rel=0.01)
    plain, scaled = robot.model(), robot.model(domain)
    np.testing.assert_allclose(scaled.body_mass, scale * plain.body_mass, rtol=1e-12)
    np.testing.assert_allclose(scaled.body_inertia, scale * plain.body_inertia, rtol=1e-12)
    # What MuJoCo derives from masses has followed.
    np.testing.assert_allclose(scaled.body_subtreemass, scale * plain.body_subtreemass, rtol=1e-12)


def test_a_push_moves_a_lighter_robot_more(robot: Robot) -> None:
    speeds = []
    for scale in (1.0, 0.9):
        engine = MujocoEngine(robot, 1, num_threads=1, domain=DomainParameters(mass_scale=scale))
        engine.reset(np.array([0]), robot.pose("bent")[None], height=5.0)
        engine.wrench[0, 5, robot.body_id("root"), 0] = 5000.0  # 10 Ns in one tick
        speeds.append(step_to(engine, hold(robot, 1)).com_velocity[0, 10, 0])
    np.testing.assert_allclose(speeds, [10.0 / 137.2875, 10.0 / (0.9 * 137.2875)], rtol=1e-3)


@pytest.mark.parametrize("strength", [0.8, 1.2])
def test_a_far_target_gives_the_worlds_torque_limit(robot: Robot, strength: float) -> None:
    engine = MujocoEngine(robot, 11, num_threads=1, domain=DomainParameters(motor_strength=strength))
    engine.reset(np.arange(11), np.zeros((11, 11)), height=5.0)
    targets = np.zeros((11, TICKS_PER_STEP, 11))
    targets[np.arange(11), :, np.arange(11)] = 100.0
    largest = np.abs(step_to(engine, targets).joint_torque).max(axis=(0, 1))
    np.testing.assert_allclose(largest, strength * np.array([150, *[350, 350, 350, 205, 205] * 2]), rtol=1e-12)


# Slopes.


@pytest.mark.parametrize(
    ("uphill_deg", "yaw_deg", "ankles_deg"),
    [(0.0, 0.0, -4.0), (180.0, 0.0, 4.0), (90.0, 90.0, -4.0), (90.0, -90.0, 4.0), (210.0, 30.0, 4.0)],
)
def test_a_robot_stands_on_a_slope_with_its_feet_on_the_plane(
    robot: Robot, uphill_deg: float, yaw_deg: float, ankles_deg: float
) -> None:
    """It faces uphill or downhill, its ankles turned by the 4 degrees of the slope."""
    slope, uphill, yaw, ankles = np.radians([4.0, uphill_deg, yaw_deg, ankles_deg])
    ticks = standing_in(robot, DomainParameters(slope=slope, uphill=uphill), yaw=yaw, ankles=ankles)
    corners = sole_corners(ticks.sole_position, ticks.foot_orientation, robot.sole_half_size)[0, -1]
    # The plane through the origin that rises towards `uphill`: z = tan(slope) (x cos u + y sin u).
    along = corners[..., 0] * np.cos(uphill) + corners[..., 1] * np.sin(uphill)
    np.testing.assert_allclose(corners[..., 2], np.tan(slope) * along, atol=0.003)
    assert np.ptp(corners[..., 2]) > 0.01
    assert ticks.foot_contact[0, -1].all()
    assert not ticks.non_foot_contact.any()
    assert np.abs(ticks.com_velocity[0, -1]).max() < 0.05
    assert ticks.root_uprightness[0, -1] > np.cos(np.radians(4.0))


@pytest.mark.parametrize("height", [0.0, 0.2])
def test_reset_puts_the_lowest_corner_over_the_slope(robot: Robot, height: float) -> None:
    engine = MujocoEngine(robot, 1, num_threads=1, domain=DomainParameters(slope=0.14, uphill=0.5))
    start = engine.reset(np.array([0]), robot.pose("bent")[None], height=height, roll=0.05, pitch=-0.1)
    corners = sole_corners(start.sole_position, start.foot_orientation, robot.sole_half_size)[0, 0]
    along = corners[..., 0] * np.cos(0.5) + corners[..., 1] * np.sin(0.5)
    # Put down 1 um deep.
    assert (corners[..., 2] - np.tan(0.14) * along).min() == pytest.approx(height - 1e-6, abs=1e-12)
    assert start.foot_contact.any() == (height == 0.0)


def test_the_floor_rises_uphill(robot: Robot) -> None:
    model = robot.model(DomainParameters(slope=np.radians(10.0), uphill=0.5 * np.pi))
    w, x, y, z = model.geom(FLOOR).quat
    # Its normal leans backwards from uphill (+y): (0, -sin 10, cos 10).
    normal = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    np.testing.assert_allclose(normal, [0.0, -np.sin(np.radians(10.0)), np.cos(np.radians(10.0))], atol=1e-12)


# Finer physics.


def test_at_1000_hz_the_same_ticks_are_recorded(robot: Robot) -> None:
    fine = MujocoEngine(robot, 2, num_threads=1, domain=DomainParameters(physics_hz=1000))
    assert fine.model.opt.timestep == 0.001
    fine.reset(np.arange(2), np.tile(robot.pose("bent"), (2, 1)), height=5.0)
    for step in range(2):
        ticks = step_to(fine, hold(robot, 2))
        assert len(ticks) == TICKS_PER_STEP
        expected = -robot.gravity * CONTROL_DT * (step * TICKS_PER_STEP + np.arange(TICKS_PER_STEP))
        np.testing.assert_allclose(ticks.com_velocity[:, :, 2], np.tile(expected, (2, 1)), atol=2e-5)


def test_at_1000_hz_each_tick_has_its_own_wrench_and_target(robot: Robot) -> None:
    engine = MujocoEngine(robot, 2, num_threads=1, domain=DomainParameters(physics_hz=1000))
    engine.reset(np.arange(2), np.tile(robot.pose("bent"), (2, 1)), height=5.0)
    engine.wrench[1, 5, robot.body_id("root"), 1] = 1000.0  # one tick of 2 ms: 2 Ns
    targets = hold(robot, 2)
    targets[1, 10:, 0] += 0.01
    ticks = step_to(engine, targets)
    velocity = ticks.com_velocity[..., 1]
    np.testing.assert_allclose(velocity[1, :6], 0.0, atol=1e-6)
    np.testing.assert_allclose(velocity[1, 6:], 2.0 / 137.2875, rtol=2e-3)
    change = ticks.joint_torque[1, :, 0] - ticks.joint_torque[0, :, 0]
    assert np.abs(change[:10]).max() < 2.0
    assert change[10] == pytest.approx(3000 * 0.01, abs=2.0)
    # Some robots alone, as all together.
    engine.wrench[:] = 0.0
    reference = MujocoEngine(robot, 2, num_threads=1, domain=DomainParameters(physics_hz=1000))
    reference.copy_state(engine)
    alone = step_to(engine, targets[1:], np.array([1])).record[0].copy()
    np.testing.assert_array_equal(alone, step_to(reference, targets).record[1])


def test_at_1000_hz_a_robot_stands_as_it_does_at_500(robot: Robot) -> None:
    plain, fine = (standing_in(robot, DomainParameters(physics_hz=hz)) for hz in (500, 1000))
    np.testing.assert_allclose(fine.com_position[0, -1], plain.com_position[0, -1], atol=0.003)
    np.testing.assert_allclose(fine.foot_force[0, -1].sum(), plain.foot_force[0, -1].sum(), rtol=0.01)
