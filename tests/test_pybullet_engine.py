"""PyBullet as an engine, against closed forms and against MuJoCo."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pybullet
import pytest
from conftest import hold, step_to

from surefoot.agents.load import load_agent
from surefoot.errors import UserError
from surefoot.evaluation.evaluate import push_lines
from surefoot.evaluation.trials import run_list
from surefoot.physics import pybullet_world
from surefoot.physics.engine import Engine
from surefoot.physics.engines import ENGINES, make_engine
from surefoot.physics.motors import Motors
from surefoot.physics.pybullet_engine import PybulletEngine
from surefoot.physics.pybullet_world import BulletWorld
from surefoot.physics.step_record import StepRecord
from surefoot.rates import CONTROL_DT, TICKS_PER_STEP
from surefoot.robots import Robot
from surefoot.robots.domain import NOMINAL_DOMAIN, DomainParameters
from surefoot.task.environment import EnvConfig, PushRecoveryVectorEnv

BOTH = pytest.mark.parametrize("name", list(ENGINES))


@pytest.fixture(scope="module")
def engine(robot: Robot) -> PybulletEngine:
    return PybulletEngine(robot, 3, num_threads=2)


@pytest.fixture(scope="module")
def world(robot: Robot) -> BulletWorld:
    """A world in this process, into which a test can look."""
    return BulletWorld(robot, NOMINAL_DOMAIN)


def placed(engine: Engine, robot: Robot, pose: str = "bent", **where: object) -> StepRecord:
    engine.wrench[:] = 0.0
    return engine.reset(np.arange(engine.num_robots), np.tile(robot.pose(pose), (engine.num_robots, 1)), **where)


# Flight.


def test_a_force_for_120_ms_in_flight_changes_the_velocity_by_its_impulse_over_the_mass(
    engine: PybulletEngine, robot: Robot
) -> None:
    placed(engine, robot, height=5.0, yaw=0.7, roll=0.1, pitch=-0.2)
    for each, body in enumerate(("root", "torso", "left_shank")):
        engine.wrench[each, :, robot.body_id(body), :3] = [300.0, -150.0, 80.0]
    velocity = [step_to(engine, hold(robot, 3)).com_velocity[:, 0].copy() for _ in range(3)]
    engine.wrench[:] = 0.0
    velocity.append(step_to(engine, hold(robot, 3)).com_velocity[:, 0].copy())
    # J = 60 * 2 ms * (300, -150, 80) N = (36, -18, 9.6) Ns, less 137.287 kg * 9.80665 m/s^2 * 0.12 s = 161.56 Ns
    expected = np.array([36.0, -18.0, 9.6 - 161.56]) / robot.mass
    for change in velocity[3] - velocity[0]:
        np.testing.assert_allclose(change, expected, rtol=1e-3)


def test_a_torque_in_flight_turns_the_robot_about_the_worlds_axis(engine: PybulletEngine, robot: Robot) -> None:
    """Of the root and of a link, both turned against the world."""
    placed(engine, robot, height=5.0, yaw=0.9, roll=0.3, pitch=-0.2)
    engine.wrench[0, :, robot.body_id("root"), 3:] = [20.0, -10.0, 15.0]
    engine.wrench[1, :, robot.body_id("torso"), 3:] = [20.0, -10.0, 15.0]
    momentum = step_to(engine, hold(robot, 3))["angular_momentum"]
    # 19 ticks of 2 ms lie between the first tick's start and the last one's: 0.038 s * 20 Nm = 0.76 kg m^2/s.
    change = momentum[:, -1] - momentum[:, 0]
    np.testing.assert_allclose(change[0], [0.76, -0.38, 0.57], atol=0.02)
    np.testing.assert_allclose(change[1], [0.76, -0.38, 0.57], atol=0.02)
    np.testing.assert_allclose(change[2], 0.0, atol=0.01)


@BOTH
def test_a_dropped_robot_falls_freely_until_it_lands(name: str, robot: Robot) -> None:
    engine = make_engine(name, robot, 1, num_threads=1)
    placed(engine, robot, height=0.2)
    record = StepRecord.join([step_to(engine, hold(robot, 1)).copy() for _ in range(6)])
    landed = int(np.argmax(record.foot_contact[0].any(axis=-1)))
    expected = -robot.gravity * CONTROL_DT * np.arange(landed)
    np.testing.assert_allclose(record.com_velocity[0, :landed, 2], expected, rtol=1e-3, atol=2e-4)
    # sqrt(2 * 0.2 / 9.807) = 0.202 s = 101 ticks
    assert 100 <= landed <= 102


# On the floor.


def test_a_robot_on_the_floor_starts_at_rest_with_its_weight_on_its_feet_and_stands_on(
    engine: PybulletEngine, robot: Robot
) -> None:
    start = placed(engine, robot)
    np.testing.assert_array_equal(start.joint_velocity, 0.0)
    np.testing.assert_allclose(start.foot_force[:, 0].sum(axis=-1), robot.weight, rtol=0.01)
    assert start.foot_contact.all()
    sag = robot.pose("bent") - start.joint_position[:, 0]
    np.testing.assert_allclose(start.joint_torque[:, 0], robot.stiffness * sag, atol=0.5)
    assert 0.005 < np.abs(sag).max() < 0.08
    for _ in range(25):
        ticks = step_to(engine, hold(robot, 3))
    np.testing.assert_allclose(ticks.foot_force[:, -1].sum(axis=-1), robot.weight, rtol=0.01)
    np.testing.assert_allclose(ticks.foot_force[:, -1].mean(axis=-1), 0.5 * robot.weight, rtol=0.01)
    assert not ticks.non_foot_contact.any()


def test_it_stands_where_it_stands_in_mujoco(engine: PybulletEngine, robot: Robot) -> None:
    starts = [placed(each, robot) for each in (engine, make_engine("mujoco", robot, 3))]
    for quantity in ("com_position", "foot_pressure_point", "joint_position"):
        values = [getattr(start, quantity)[0, 0] for start in starts]
        np.testing.assert_allclose(*values, atol=0.003, err_msg=quantity)


@BOTH
@pytest.mark.parametrize("uphill_deg", [0.0, 35.0])
def test_feet_that_slide_are_braked_by_friction_times_load_in_any_direction(
    name: str, uphill_deg: float, robot: Robot
) -> None:
    friction, slope, uphill = 0.05, 0.1, np.radians(uphill_deg)
    engine = make_engine(name, robot, 1, 1, DomainParameters(friction=friction, slope=slope, uphill=uphill))
    # Perpendicular to the floor: z axis of Ry(pitch) Rx(roll) = (sin p cos r, -sin r, cos p cos r) = the normal.
    roll = np.arcsin(np.sin(uphill) * np.sin(slope))
    placed(engine, robot, "straight", roll=roll, pitch=np.arctan2(-np.cos(uphill) * np.sin(slope), np.cos(slope)))
    record = StepRecord.join([step_to(engine, hold(robot, 1, "straight")).copy() for _ in range(12)][6:])
    downhill = np.array([-np.cos(uphill) * np.cos(slope), -np.sin(uphill) * np.cos(slope), -np.sin(slope)])
    normal = np.array([-np.cos(uphill) * np.sin(slope), -np.sin(uphill) * np.sin(slope), np.cos(slope)])
    force = np.stack([record[f"{side}_foot_contact"][0, :, 1:4] for side in ("left", "right")])
    load = force @ normal
    tangential = np.linalg.norm(force - load[..., None] * normal, axis=-1)
    assert load.min() > 100.0
    # Points of a foot that also turns slide in different directions: all of it is no more than the cone, and that much.
    assert (tangential / load).max() == pytest.approx(friction, rel=1e-3)
    # Newton: m a = m g sin s + the forces on the feet; the slope alone would give 9.807 * 0.0998 = 0.979 m/s^2.
    speed = record.com_velocity[0] @ downhill
    acceleration = (speed[-1] - speed[0]) / ((len(speed) - 1) * CONTROL_DT)
    expected = robot.gravity * np.sin(slope) + (force.sum(axis=0) @ downhill).mean() / robot.mass
    assert acceleration == pytest.approx(expected, rel=0.02)
    assert 0.4 < acceleration < 0.7


@BOTH
def test_a_robot_holds_on_a_slope_that_is_not_too_slippery(name: str, robot: Robot) -> None:
    domain = DomainParameters(friction=0.3, slope=0.05)
    engine = make_engine(name, robot, 1, num_threads=1, domain=domain)
    start = placed(engine, robot, "straight").sole_position[0, 0].copy()
    for _ in range(12):
        ticks = step_to(engine, hold(robot, 1, "straight"))
    assert np.abs(ticks.sole_position[0, -1] - start).max() < 0.003


def test_friction_can_be_set(engine: PybulletEngine, robot: Robot) -> None:
    ratios = []
    for friction in (0.02, 1.0):
        engine.set_friction(friction)
        placed(engine, robot)
        engine.wrench[:, :, robot.body_id("root"), 0] = 150.0
        ticks = step_to(engine, hold(robot, 3))
        force = ticks["left_foot_contact"][0, 10:, 1:4]
        ratios.append((np.hypot(force[:, 0], force[:, 1]) / force[:, 2]).max())
    assert ratios[0] == pytest.approx(0.02, rel=0.01)
    assert ratios[1] > 0.03


# Motors.


def test_the_motor_law_is_that_of_the_compiled_model(robot: Robot) -> None:
    import mujoco

    rng = np.random.default_rng(0)
    for strength in (1.0, 0.8):
        model = robot.model(DomainParameters(motor_strength=strength))
        data, law = mujoco.MjData(model), Motors(robot, strength)
        for _ in range(300):
            data.qpos[2], data.qpos[7:] = 5.0, rng.uniform(-0.1, 0.5, robot.num_joints)
            data.qvel[6:] = robot.velocity_limit * rng.normal(size=robot.num_joints)
            data.ctrl[:] = data.qpos[7:] + rng.normal(size=robot.num_joints) * rng.choice([0.01, 0.3, 3.0])
            mujoco.mj_forward(model, data)
            found = law(data.ctrl, data.qpos[7:], data.qvel[6:])
            np.testing.assert_allclose(found, data.actuator_force, rtol=1e-9, atol=1e-9)


def test_a_far_target_gives_the_torque_limit_and_a_free_joint_keeps_its_speed_limit(
    engine: PybulletEngine, robot: Robot
) -> None:
    placed(engine, robot, height=5.0)
    targets = hold(robot, 3)
    knee = robot.joint_names.index("left_knee_pitch")
    targets[0, :, knee] += 100.0
    ticks = step_to(engine, targets)
    assert ticks.joint_torque[0, 0, knee] == robot.torque_limit[knee]
    assert np.abs(ticks.joint_torque).max(axis=(0, 1)) == pytest.approx(np.minimum(
        np.abs(ticks.joint_torque).max(axis=(0, 1)), robot.torque_limit
    ))  # fmt: skip
    assert 0.5 < ticks.joint_velocity[0, :, knee].max() / robot.velocity_limit[knee] < 1.05


def test_the_explicit_joint_law_rings_at_500_hz_and_not_at_1000(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """Feet in the air: Kd dt / I = 120 Nms/rad * 2 ms / (0.1 + 0.02) kg m^2 = 2 is the limit of an explicit law."""
    fastest = []
    for substeps in (1, 2):
        monkeypatch.setattr(pybullet_world, "SUBSTEPS", substeps)
        world = BulletWorld(robot, NOMINAL_DOMAIN)
        world.reset(robot.pose("bent"), 0.0, 1.0, 0.0, 0.0)
        for _ in range(5):
            rows, _ = world.advance(hold(robot, 1)[0], None)
        fastest.append(np.abs(StepRecord(robot, rows[None]).joint_velocity).max())
        world.close()
    assert fastest[0] > 1.0
    assert fastest[1] < 0.1


def test_gains_can_be_set(engine: PybulletEngine, robot: Robot) -> None:
    engine.set_gains(0.5 * robot.stiffness, robot.damping)
    placed(engine, robot, height=5.0)
    torque = step_to(engine, hold(robot, 3) + 0.01).joint_torque[0, 0]
    np.testing.assert_allclose(torque, 0.5 * 0.01 * robot.stiffness, rtol=1e-6)
    engine.set_gains(robot.stiffness, robot.damping)


# The record.


def test_the_records_com_is_bullets_own(world: BulletWorld, robot: Robot) -> None:
    """Positions and velocities of all links, as Bullet tells them, weighed by its masses."""
    world.reset(robot.pose("bent"), 0.4, 0.3, 0.05, -0.1)
    targets = hold(robot, 1)[0] + np.linspace(0.0, 0.2, TICKS_PER_STEP)[:, None]
    wrench = np.zeros((TICKS_PER_STEP, len(robot.body_names), 6))
    wrench[:, 1, 1] = 500.0
    world.advance(targets, wrench)
    row, _ = world.advance(targets[:1], None)  # the row of the state that is there now is read before its step
    world.reset(robot.pose("bent"), 0.4, 0.3, 0.05, -0.1)
    world.advance(targets, wrench)
    body, client = world._body, world._client
    places = [pybullet.getBasePositionAndOrientation(body, physicsClientId=client)[0]]
    speeds = [pybullet.getBaseVelocity(body, physicsClientId=client)[0]]
    for link in range(11):
        state = pybullet.getLinkState(body, link, 1, 1, physicsClientId=client)
        places.append(state[0])
        speeds.append(state[6])
    masses = np.array([pybullet.getDynamicsInfo(body, link, physicsClientId=client)[0] for link in range(-1, 11)])
    record = StepRecord(robot, row[None])
    assert np.abs(record.com_velocity).max() > 0.1
    np.testing.assert_allclose(record.com_position[0, 0], masses @ places / masses.sum(), atol=1e-9)
    np.testing.assert_allclose(record.com_velocity[0, 0], masses @ speeds / masses.sum(), atol=1e-6)


def test_a_trial_is_the_same_bits_whatever_was_before_and_whoever_has_it(engine: PybulletEngine, robot: Robot) -> None:
    rng = np.random.default_rng(2)
    targets = hold(robot, 3) + 0.1 * rng.standard_normal((3, 1, robot.num_joints))
    targets[2] = targets[0]
    other = PybulletEngine(robot, 1, num_threads=1)
    placed(other, robot)
    alone = step_to(other, targets[:1]).record.copy()
    placed(engine, robot)
    first = step_to(engine, targets).record.copy()
    np.testing.assert_array_equal(first[[0]], alone)
    np.testing.assert_array_equal(first[2], first[0])  # robots 0 and 1 are in different processes
    placed(engine, robot)
    np.testing.assert_array_equal(step_to(engine, targets).record, first)
    # In parts, and some of them only.
    placed(engine, robot)
    engine.joint_targets[:] = targets
    parts = [engine.step(np.array([1]), part).copy() for part in (slice(0, 4), slice(4, TICKS_PER_STEP))]
    np.testing.assert_array_equal(StepRecord.join(parts).record, first[[1]])


def test_a_restart_is_the_reset_that_it_was_kept_from(engine: PybulletEngine, robot: Robot) -> None:
    start = placed(engine, robot).record.copy()
    kept, moved = engine.rest_states(np.arange(3)), step_to(engine, hold(robot, 3)).record.copy()
    np.testing.assert_array_equal(engine.restart(np.array([0, 2]), kept[[0, 2]]).record, start[[0, 2]])
    np.testing.assert_array_equal(step_to(engine, hold(robot, 2), np.array([0, 2])).record, moved[[0, 2]])


def test_a_robot_that_diverges_is_flagged_counted_put_back_and_changes_no_other(
    engine: PybulletEngine, robot: Robot
) -> None:
    placed(engine, robot)
    fine = step_to(engine, hold(robot, 3)).record[[0, 2]].copy()
    placed(engine, robot)
    targets, before = hold(robot, 3), engine.num_diverged
    targets[1, 7, 3] = np.nan
    record = step_to(engine, targets).record
    assert engine.diverged.tolist() == [False, True, False]
    assert engine.num_diverged == before + 1
    assert np.isfinite(record).all()
    np.testing.assert_array_equal(record[[0, 2]], fine)
    placed(engine, robot)
    np.testing.assert_array_equal(step_to(engine, hold(robot, 3)).record[[0, 2]], fine)
    assert not engine.diverged.any()
    engine.wrench[2, 3, 0, 1] = np.inf
    step_to(engine, hold(robot, 3))
    assert engine.diverged.tolist() == [False, False, True]
    engine.wrench[:] = 0.0


def test_the_engine_writes_nothing_and_ends_its_processes() -> None:
    """Bullet talks a lot; a command's standard output is for its figures."""
    script = (
        "import numpy as np\nfrom surefoot.physics.pybullet_engine import PybulletEngine\n"
        "from surefoot.robots import load_robot\nrobot = load_robot('valkyrie')\n"
        "engine = PybulletEngine(robot, 1)\nengine.reset(np.arange(1), robot.pose()[None])\n"
        "process = engine._workers[0]._process\ndel engine\nprint(process.poll())\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (0, "0\n", "")


# Policies.


def test_a_policy_that_never_met_this_engine_recovers_in_it(robot: Robot) -> None:
    lines = {line.name: line for line in push_lines(4, robot)}
    trial = lines["left"].trial(20, 0, full_length=False)  # 120 Ns
    for policy, recovers in (("ddpg", True), ("nominal", False)):
        outcomes = run_list(load_agent(policy), [trial], num_slots=1, num_threads=1, engine="pybullet")
        assert [outcome.recovered for outcome in outcomes.values()] == [recovers]


def test_the_environment_runs_in_it_and_robots_that_fall_begin_anew() -> None:
    env = PushRecoveryVectorEnv(2, EnvConfig("valkyrie", pose="bent", engine="pybullet"), num_threads=1)
    start, _ = env.reset(seed=0)
    limp = np.zeros((2, env.robot.num_joints), np.float32)
    limp[0] = -1.0  # one robot bends all joints and falls
    ended = np.zeros(2, bool)
    for _ in range(40):
        observation, reward, terminated, _, _ = env.step(limp)
        ended |= terminated
        assert np.isfinite(observation).all()
        assert np.isfinite(reward).all()
    assert ended.tolist() == [True, False]
    assert np.abs(start - env.reset(seed=0)[0]).max() < 1e-6


def test_an_unknown_engine_is_named() -> None:
    with pytest.raises(UserError, match=r"^unknown engine 'bullet'; valid: mujoco, pybullet$"):
        make_engine("bullet", load_agent("ddpg").robot, 1)
