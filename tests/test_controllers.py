"""What a controller is given, what becomes of its answers, and how one that fails ends its trial."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable

import numpy as np
import pytest
from conftest import driven_loop, pushed

from surefoot.agents.controllers.controller import Command, ControllerAgent, State
from surefoot.agents.load import usual_robot
from surefoot.evaluation.trials import Trial, run_list
from surefoot.physics.step_record import StepRecord
from surefoot.robots import Robot
from surefoot.task.control_loop import ControlLoop
from surefoot.task.imperfections import Imperfections

Answer = Callable[[State, np.ndarray, np.ndarray], Command]


def contestant(answer: Answer, rate_hz: int = 100, path: str = "hold") -> ControllerAgent:
    """A controller that answers by a function of state, robots and the pose."""

    class Answering:
        def __init__(self, robot: Robot, num_robots: int):
            self.pose = robot.pose("bent")

        def reset(self, ids: np.ndarray) -> None:
            pass

        def __call__(self, state: State, ids: np.ndarray) -> Command:
            return answer(state, ids, np.tile(self.pose, (len(ids), 1)))

    Answering.rate_hz, Answering.path = rate_hz, path  # type: ignore[attr-defined]
    return ControllerAgent("answering", Answering, "0" * 64, usual_robot())


def stand(state: State, ids: np.ndarray, pose: np.ndarray) -> Command:
    return Command(pose)


def driven(
    entrant: ControllerAgent, robot: Robot, num_steps: int = 1, **start: float
) -> tuple[ControlLoop, list[StepRecord]]:
    """A loop of one robot after some policy steps, and their ticks."""
    loop = driven_loop(entrant)
    loop.reset(np.array([0]), robot.pose("bent")[None], **start)
    return loop, [loop.drive().copy() for _ in range(num_steps)]


def short(trial: Trial, horizon: float = 1.5) -> Trial:
    return dataclasses.replace(trial, horizon=horizon, quiet_from=0.5)


def test_a_feed_forward_torque_is_added_to_the_impedance(robot: Robot) -> None:
    joint = robot.joint_names.index("torso_pitch")

    def push_torso(state: State, ids: np.ndarray, pose: np.ndarray) -> Command:
        torque = np.zeros_like(pose)
        torque[:, joint] = 20.0
        return Command(pose, torque)

    _, (ticks,) = driven(contestant(push_torso), robot, height=1.0)
    q, v = ticks.joint_position[0, :, joint], ticks.joint_velocity[0, :, joint]
    # u = 3000 (q_target - q) - 300 dq/dt + 20, in the first tick from rest at the target: 20 Nm.
    assert ticks.joint_torque[0, 0, joint] == pytest.approx(20.0, abs=1e-6)
    np.testing.assert_allclose(ticks.joint_torque[0, :, joint], -3000.0 * q - 300.0 * v + 20.0, atol=1e-6)


def test_no_torque_exceeds_its_limit_whatever_is_asked_for(robot: Robot) -> None:
    far = contestant(lambda state, ids, pose: Command(pose, np.full_like(pose, 1e5)))
    _, steps = driven(far, robot, 3, height=1.0)
    share = np.abs(np.concatenate([ticks.joint_torque[0] for ticks in steps])) / robot.torque_limit
    assert share.max() == pytest.approx(1.0, abs=1e-9)


def test_targets_are_clipped_to_the_joint_ranges_and_feed_forward_is_not(robot: Robot) -> None:
    beyond = contestant(lambda state, ids, pose: Command(np.full_like(pose, 10.0), np.full_like(pose, 50.0)))
    loop, _ = driven(beyond, robot, height=1.0)
    expected = robot.joint_upper + 50.0 / robot.stiffness
    np.testing.assert_allclose(loop.engine.joint_targets[0, -1], expected)


def test_targets_are_held_or_go_along_a_line_between_control_steps(robot: Robot) -> None:
    for path, expected in (("hold", [0.1] * 10), ("line", np.linspace(0.01, 0.1, 10))):
        moved = contestant(lambda state, ids, pose: Command(pose + 0.1), 50, path)
        loop, _ = driven(moved, robot, height=1.0)
        bent = np.clip(robot.pose("bent") + 0.1, robot.joint_lower, robot.joint_upper) - robot.pose("bent")
        # 50 Hz are 10 ticks; the first control step begins at the pose.
        found = loop.engine.joint_targets[0, :10] - robot.pose("bent")
        np.testing.assert_allclose(found, np.outer(np.array(expected) / 0.1, bent), atol=1e-12)


@pytest.mark.parametrize("rate_hz", [25, 50, 100, 125, 250, 500])
def test_it_is_called_at_its_rate(robot: Robot, rate_hz: int) -> None:
    times: list[float] = []

    def watch(state: State, ids: np.ndarray, pose: np.ndarray) -> Command:
        times.append(float(state.time[0]))
        return Command(pose)

    driven(contestant(watch, rate_hz), robot, 3)
    np.testing.assert_allclose(times, np.arange(3 * rate_hz // 25) / rate_hz, atol=1e-12)


def test_the_state_is_the_robots_in_its_heading_frame(robot: Robot) -> None:
    seen: list[State] = []
    entrant = contestant(lambda state, ids, pose: seen.append(state) or Command(pose))  # type: ignore[func-returns-value]
    _, steps = driven(entrant, robot, 2, yaw=np.pi / 2)
    state, ticks = seen[-1], steps[-1]
    # 100 Hz: the last call saw the tick before its own, the fifteenth.
    np.testing.assert_array_equal(state.joint_position[0], ticks.joint_position[0, 14])
    com, root = ticks.com_position[0, 14], ticks["root_position"][0, 14]
    # Turned by 90 degrees: the robot's forward is the world's y, its left the world's -x.
    away = com - root
    np.testing.assert_allclose(state.com_position[0], [away[1], -away[0], away[2]], atol=5e-4)
    assert state.com_height[0] == pytest.approx(float(ticks.com_height[0, 14]))
    # Standing still: the capture point is under the CoM, and the feet bear the weight.
    np.testing.assert_allclose(state.capture_point[0], state.com_position[0, :2], atol=0.02)
    assert state.foot_force.sum() == pytest.approx(robot.weight, rel=0.1)
    assert np.abs(state.pressure_point[0] - state.sole_position[0, :, :2]).max() < robot.sole_half_size[0]


def test_nothing_of_a_push_is_seen_before_it_moves_the_robot() -> None:
    def states(impulse: float) -> list[State]:
        seen: list[State] = []

        def watch(state: State, ids: np.ndarray, pose: np.ndarray) -> Command:
            seen.append(state)
            return Command(pose)

        run_list(contestant(watch, 500), [short(pushed(impulse, 0))], num_slots=1, num_threads=1)
        return seen

    def first_change(field: str) -> int:
        pairs = enumerate(zip(calm, hit, strict=False))
        return next(i for i, (a, b) in pairs if not np.array_equal(getattr(a, field), getattr(b, field)))

    calm, hit = states(0.0), states(60.0)
    begin = 500 + _offset(seed=0)
    # What the push's first tick did to the motion shows at the next tick's start, and is told one tick later; the feet
    # feel it in the tick itself.
    assert {first_change(field) for field in ("joint_velocity", "com_velocity", "capture_point")} == {begin + 2}
    assert first_change("foot_force") == begin + 1


def _offset(seed: int) -> int:
    rng = np.random.default_rng(seed)
    rng.uniform(-1.0, 1.0, 11)  # the start angles
    return int(rng.integers(20))


def test_sensor_bias_is_in_the_state_as_in_a_policys_observation(robot: Robot) -> None:
    seen: list[State] = []
    entrant = contestant(lambda state, ids, pose: seen.append(state) or Command(pose))  # type: ignore[func-returns-value]
    loop = driven_loop(entrant)
    loop.set_imperfections(0, Imperfections(sensor_bias=0.1), seed=3)
    start = loop.engine.read(np.array([0])).joint_position[0, 0]
    loop.drive()
    error = seen[0].joint_position[0] - start
    # 0.1 of a joint angle's typical deviation of 0.3 rad, as the seed draws it.
    expected = 0.03 * np.random.default_rng(3).spawn(3)[0].standard_normal(47)[:11]
    np.testing.assert_allclose(error, expected, atol=1e-9)


def test_latency_holds_targets_back_by_its_ticks(robot: Robot) -> None:
    moved = contestant(lambda state, ids, pose: Command(pose + 0.05 * (state.time[:, None] >= 0.04)))
    loop = driven_loop(moved)
    loop.set_imperfections(0, Imperfections(latency=0.012), seed=0)
    loop.drive()
    loop.drive()
    knee = robot.joint_names.index("left_knee_pitch")
    late = loop.engine.joint_targets[0, :, knee] - robot.pose("bent")[knee]
    # 12 ms are six ticks, although a control step has only five.
    np.testing.assert_allclose(late, [0.0] * 6 + [0.05] * 14, atol=1e-12)


def broken(how: str) -> ControllerAgent:
    def answer(state: State, ids: np.ndarray, pose: np.ndarray) -> Command:
        sick = (ids == 1) & (state.time > 0.5)
        if how == "raised" and sick.any():
            raise ZeroDivisionError("no feet")
        if how == "not finite":
            pose[sick] = np.nan
        if how == "wrong shape" and sick.any():
            return Command(pose[:, :-1])
        return Command(pose)

    return contestant(answer)


@pytest.mark.parametrize("how", ["raised", "not finite"])
def test_a_robot_whose_controller_fails_ends_its_trial_alone(how: str) -> None:
    entrant = broken(how)
    trials = [short(pushed(12.0, seed)) for seed in range(3)]
    outcomes = run_list(entrant, trials, num_slots=3, num_threads=1)
    healthy = run_list(contestant(stand), trials, num_slots=3, num_threads=1)
    sick = outcomes.pop(trials[1])
    assert (sick.reason, sick.recovered) == (how, False)
    # It fails at the first control step after 0.5 s, within the 13th policy step: before the push at 1 s.
    assert -0.54 < sick.seconds < -0.44
    assert {trial: repr(outcome) for trial, outcome in outcomes.items()} == {
        trial: repr(outcome) for trial, outcome in healthy.items() if trial != trials[1]
    }
    assert entrant.failures == {"raised (ZeroDivisionError: no feet)" if how == "raised" else how: 1}


def test_a_wrong_shape_fails_all_the_trials_of_the_call() -> None:
    entrant = broken("wrong shape")
    trials = [short(pushed(12.0, seed)) for seed in range(3)]
    outcomes = run_list(entrant, trials, num_slots=3, num_threads=1)
    assert [outcome.reason for outcome in outcomes.values()] == ["wrong shape"] * 3


def test_a_controller_that_never_answers_is_broken_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("surefoot.task.guard.PATIENCE_S", 0.005)  # 0.1 s a call

    def hang(state: State, ids: np.ndarray, pose: np.ndarray) -> Command:
        while True:
            time.sleep(0.001)

    (outcome,) = run_list(contestant(hang), [short(pushed(12.0, 0))], num_slots=1, num_threads=1).values()
    assert outcome.reason == "too late"


def test_a_controller_that_fails_in_the_air_leaves_the_joints_where_they_were(robot: Robot) -> None:
    def once(state: State, ids: np.ndarray, pose: np.ndarray) -> Command:
        if state.time[0] > 0.0:
            raise RuntimeError
        return Command(pose + 0.05)

    loop, _ = driven(contestant(once), robot, 2, height=1.0)
    assert loop.failed == {0: "raised"}
    expected = np.clip(robot.pose("bent") + 0.05, robot.joint_lower, robot.joint_upper)
    np.testing.assert_allclose(loop.engine.joint_targets[0, -1], expected)
