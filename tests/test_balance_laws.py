"""The models behind the shipped controllers against hand calculations, and what the controllers hold."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from conftest import driven_loop, pushed

from surefoot.agents.controllers import load_controller, shipped_controllers
from surefoot.agents.controllers.body import Body
from surefoot.agents.controllers.controller import State
from surefoot.agents.controllers.inverse_dynamics import InverseDynamics, Motion, clip_to_support, share_pressure
from surefoot.agents.controllers.linear_mpc import CartTable, Pendulum, QuadraticPrograms
from surefoot.agents.controllers.stepping import Situation
from surefoot.agents.controllers.urata2011 import FootPlacement
from surefoot.agents.load import load_agent
from surefoot.evaluation.outcome import Outcome
from surefoot.evaluation.trials import Trial, run_list
from surefoot.physics.pushes import Push
from surefoot.robots import Robot
from surefoot.task.control_loop import ControlLoop

WAYS = {"forward": (1.0, 0.0, 0.0), "left": (0.0, 1.0, 0.0), "backward": (-1.0, 0.0, 0.0), "right": (0.0, -1.0, 0.0)}


@pytest.fixture(scope="module")
def moving(robot: Robot) -> tuple[ControlLoop, State]:
    """Two robots in the air in different poses, leaning, with joints on the move."""
    loop, ids = driven_loop(load_controller("controllers/stand", robot), 2), np.arange(2)
    noise = np.random.default_rng(0).uniform(-0.3, 0.3, (2, robot.num_joints))
    loop.reset(ids, robot.pose("bent") + noise, height=1.0, roll=0.2, pitch=-0.1)
    loop.drive()
    return loop, loop.inputs(ids)


def test_the_body_is_the_measured_robot(robot: Robot, moving: tuple[ControlLoop, State]) -> None:
    _, state = moving
    body = Body(robot, 2)
    body.update(state)
    np.testing.assert_allclose(body.com, state.com_position, atol=1e-9)
    np.testing.assert_allclose(body.soles, state.sole_position, atol=1e-9)
    velocity = np.matmul(body.com_jacobian, body.velocity[..., None])[..., 0]
    np.testing.assert_allclose(velocity, state.com_velocity, atol=1e-9)
    # Each leg moves its own sole only: hip roll and pitch, knee, ankle pitch and roll, after the root's six.
    moves = np.abs(body.sole_jacobian[0]).max(axis=1) > 1e-6
    assert [np.flatnonzero(moves[foot, 6:]).tolist() for foot in (0, 1)] == [[1, 2, 3, 4, 5], [6, 7, 8, 9, 10]]


def test_the_equations_of_motion_are_mujocos(robot: Robot, moving: tuple[ControlLoop, State]) -> None:
    _, state = moving
    body = Body(robot, 2)
    body.update(state)
    model = robot.model()
    for part in (mujoco.mjtDisableBit.mjDSBL_CONTACT, mujoco.mjtDisableBit.mjDSBL_ACTUATION):
        model.opt.disableflags |= int(part)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
    model.dof_damping[:] = 0.0
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = body._qpos[1], body._qvel[1]
    data.qfrc_applied[6:] = torque = np.linspace(-20.0, 20.0, robot.num_joints)
    mujoco.mj_forward(model, data)
    free = data.qacc.copy()
    needed = body.mass_matrix[1] @ free + body.bias[1]
    np.testing.assert_allclose(needed[:6], 0.0, atol=1e-6)  # in free fall nothing holds the root
    np.testing.assert_allclose(needed[6:], torque, atol=1e-6)


def test_two_feet_share_a_pressure_centre_as_a_lever_does() -> None:
    soles = np.array([[[0.0, 0.14], [0.0, -0.14]]] * 4)
    half = np.array([0.13, 0.08])
    both = np.ones((4, 2), bool)
    # In the middle; 7 cm left of it, 3/4 on the left foot; forward; and beyond everything.
    wanted = np.array([[0.0, 0.0], [0.0, 0.07], [0.05, 0.0], [0.5, 0.5]])
    share, points = share_pressure(wanted, soles, both, half)
    np.testing.assert_allclose(share, [[0.5, 0.5], [0.75, 0.25], [0.5, 0.5], [1.0, 0.0]])
    np.testing.assert_allclose(points[2], [[0.05, 0.14], [0.05, -0.14]])
    clipped = clip_to_support(wanted, soles, both, half)
    np.testing.assert_allclose(clipped[:3], wanted[:3], atol=1e-12)
    np.testing.assert_allclose(clipped[3], [0.13, 0.22])  # the left foot's front left corner
    right = np.array([[False, True]] * 4)
    np.testing.assert_allclose(clip_to_support(wanted, soles, right, half)[:, 1], -0.06)


def test_standing_torques_carry_the_weight_at_the_pressure_centre(robot: Robot) -> None:
    loop = driven_loop(load_controller("controllers/ankle", robot))
    for _ in range(25):
        ticks = loop.drive()
    state = loop.inputs(np.array([0]))
    dynamics = InverseDynamics(robot, 1)
    dynamics.body.update(state)
    center = state.sole_position[..., :2].mean(axis=1)
    forward = center + [0.05, 0.0]
    ankles = [robot.joint_names.index(f"{side}_ankle_pitch") for side in ("left", "right")]
    torques = [dynamics(state, Motion.standing(p, float(state.com_height[0])))[1][0, ankles] for p in (center, forward)]
    # 5 cm forward under 1346 N: 67.3 Nm, half of it in each ankle.
    np.testing.assert_allclose(torques[1] - torques[0], 0.5 * robot.weight * 0.05, rtol=0.1)
    # And at rest that is what the ground gives back.
    np.testing.assert_allclose(ticks.foot_force[0, -1].sum(), robot.weight, rtol=0.01)


def test_the_pendulum_falls_as_its_closed_form() -> None:
    pendulum = Pendulum(num_steps=10, step=0.02, height=0.980665, gravity=9.80665)
    w = np.sqrt(10.0)
    assert pendulum.frequency == pytest.approx(w)
    # From 3 cm ahead of the pressure centre, at 0.2 m/s: c = 0.03 + 0.2 / w, times exp(w T) after T = 0.2 s.
    state = np.array([0.03, 0.2])
    expected = (0.03 + 0.2 / w) * np.exp(w * 0.2)
    assert pendulum.capture_of_state[-1] @ state == pytest.approx(expected)
    assert pendulum.capture_point(state[None], np.zeros((1, 10)))[0] == pytest.approx(expected)
    # A pressure centre held at the capture point keeps it there.
    point = state[0] + state[1] / w
    held = pendulum.capture_of_state[-1] @ state + pendulum.capture_of_pressure[-1].sum() * point
    assert held == pytest.approx(point)


def test_the_cart_tables_pressure_centre_is_the_position_less_the_acceleration() -> None:
    table = CartTable(num_steps=2, step=0.1, height=0.980665, gravity=9.80665)  # h / g = 0.1 s^2
    state, jerk = np.array([0.01, 0.2, 0.5]), np.array([3.0, -1.0])
    # After 0.1 s: x = 0.01 + 0.02 + 0.0025 + 0.0005 = 0.033, a = 0.8; p = 0.033 - 0.08.
    found = table.pressure_of_state @ state + table.pressure_of_jerk @ jerk
    assert found[0] == pytest.approx(-0.047)
    assert table.pressure_after(state, 3.0, 0.1) == pytest.approx(-0.047)
    # v = 0.2 + 0.05 + 0.015 = 0.265, then x = 0.033 + 0.0265 + 0.004 - 0.000167, a = 0.7.
    assert found[1] == pytest.approx(0.063333 - 0.07, abs=1e-6)


def test_a_quadratic_program_stops_at_its_bounds_and_breaks_only_what_it_must() -> None:
    programs = QuadraticPrograms(np.diag([1.0, 2.0]), np.eye(2))
    # Minimum of x^2 / 2 - 3 x + y^2 - 2 y: (3, 1); with x below 2: (2, 1).
    gradient, low = np.array([[-3.0, -2.0]] * 2), np.full((2, 2), -5.0)
    found = programs.solve(gradient, low, np.array([[5.0, 5.0], [2.0, 5.0]]))
    np.testing.assert_allclose(found, [[3.0, 1.0], [2.0, 1.0]], atol=1e-5)
    # x at least 1 and at most 1, which nothing contradicts, then both bounds on one unknown that do.
    twice = QuadraticPrograms(np.eye(1), np.array([[1.0], [1.0]]))
    torn = twice.solve(np.zeros((1, 1)), np.array([[1.0, -5.0]]), np.array([[5.0, 0.0]]))
    assert 0.0 <= torn[0, 0] <= 1.0


def test_a_foothold_in_closed_form_stops_the_capture_point_there(robot: Robot) -> None:
    planner = FootPlacement(robot, 1)
    # The right foot bears at the origin; the capture point is 20 cm ahead, 13 cm to the left, the left foot beside.
    plan = planner.plan(
        Situation(
            ids=np.array([0]),
            frequency=np.array([3.0]),
            capture_point=np.array([[0.20, 0.13]]),
            com=np.array([[0.1, 0.13]]),
            com_velocity=np.array([[0.3, 0.0]]),
            stance=np.zeros((1, 2)),
            swing=np.array([[0.0, 0.27]]),
            side=np.array([1.0]),
            clock=np.zeros(1),
            committed=np.array([np.nan]),
        )
    )
    reached = plan.pressure + (np.array([[0.20, 0.13]]) - plan.pressure) * np.exp(3.0 * plan.remaining[:, None])
    # The pressure centre is as far forward as it may, 2 cm from the toe; the landing is 4 cm beyond the capture point.
    assert plan.pressure[0, 0] == pytest.approx(0.135 - 0.02)
    away = np.linalg.norm(plan.landing - reached)
    assert away == pytest.approx(0.04, abs=1e-9)
    assert plan.remaining[0] > 0.19


# What they hold.


def pushes(name: str, impulses: dict[str, float], seeds: range) -> dict[Trial, Outcome]:
    trials = [
        Trial(Push(direction=WAYS[way], impulse=impulse), seed, full_length=False)
        for way, impulse in impulses.items()
        for seed in seeds
    ]
    return run_list(load_agent(name), trials, num_slots=len(trials), num_threads=1)


@pytest.mark.parametrize("name", shipped_controllers())
def test_every_controller_stands_and_takes_a_small_push(name: str) -> None:
    outcomes = pushes(name, {"forward": 0.0, "left": 36.0, "backward": 36.0}, range(1))
    assert all(outcome.recovered for outcome in outcomes.values())
    # And quietly: the mean speed of the CoM decides a trial, here nothing steps.
    assert all(outcome.steps == 0 for outcome in outcomes.values())


@pytest.mark.parametrize(
    ("name", "sagittal", "lateral"),
    [
        # 80 % of equation (6) in the bent pose, 52.6 Ns forward and 59.2 Ns backward, 90 Ns to the sides, and more.
        ("controllers/ankle", 60.0, 84.0),
        ("controllers/hip", 60.0, 90.0),
        ("controllers/wieber2006a", 48.0, 72.0),
        ("controllers/wieber2006b", 48.0, 72.0),
    ],
)
def test_those_that_stand_hold_what_their_feet_allow(name: str, sagittal: float, lateral: float) -> None:
    impulses = {"forward": sagittal, "backward": sagittal, "left": lateral, "right": lateral}
    outcomes = pushes(name, impulses, range(2))
    assert all(outcome.recovered for outcome in outcomes.values())
    assert not any(outcome.steps for outcome in outcomes.values())


@pytest.mark.parametrize("name", ["controllers/stephens2010", "controllers/urata2011"])
def test_those_that_step_hold_more_and_end_up_standing(name: str) -> None:
    outcomes = pushes(name, {"forward": 144.0, "backward": 120.0, "left": 108.0, "right": 108.0}, range(2))
    assert all(outcome.recovered for outcome in outcomes.values())
    assert all(outcome.steps >= 1 for outcome in outcomes.values())
    assert not any(
        o.recovered for o in pushes("controllers/ankle", {"forward": 144.0, "left": 108.0}, range(2)).values()
    )


@pytest.mark.parametrize("name", ["controllers/urata2011", "controllers/stephens2010", "controllers/wieber2006a"])
def test_a_robots_bits_do_not_depend_on_its_neighbours(name: str) -> None:
    trials = [pushed(66.0, 0, way, full_length=False) for way in (WAYS["forward"], WAYS["left"])]

    def run(num_slots: int) -> dict[Trial, str]:
        found = run_list(load_agent(name), trials, num_slots=num_slots, num_threads=1)
        return {trial: repr(outcome) for trial, outcome in found.items()}

    assert run(2) == run(1)
