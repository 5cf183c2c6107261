"""Divergence: a robot whose numbers blow up is flagged, put back, and changes nothing of the others."""

from pathlib import Path

import numpy as np
import pytest
from conftest import hold, random_targets, stand, step_to

from surefoot.physics.mujoco_engine import MujocoEngine
from surefoot.physics.step_record import StepRecord
from surefoot.robots import Robot


def diverge(robot: Robot, engine: MujocoEngine, who: int) -> StepRecord:
    targets = hold(robot, engine.num_robots)
    targets[who] = np.nan
    return step_to(engine, targets)


@pytest.mark.usefixtures("in_scratch_folder")
def test_a_robot_that_diverges_is_flagged_and_counted_and_its_record_is_finite(robot: Robot) -> None:
    engine = stand(robot, 4)
    assert (engine.diverged.tolist(), engine.num_diverged) == ([False] * 4, 0)
    ticks = diverge(robot, engine, 2)
    assert (engine.diverged.tolist(), engine.num_diverged) == ([False, False, True, False], 1)
    assert np.isfinite(ticks.record).all()
    assert np.isfinite(engine.state[0]).all()
    step_to(engine, hold(robot, 4))
    assert (engine.diverged.tolist(), engine.num_diverged) == ([False] * 4, 1)


def test_robots_that_diverge_leave_no_file_and_write_nothing(
    robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    engine = stand(robot, 4)
    for _ in range(5):
        diverge(robot, engine, 2)
    assert engine.num_diverged == 5
    assert not list(tmp_path.iterdir())
    written = capfd.readouterr()
    assert written.out + written.err == ""


@pytest.mark.usefixtures("in_scratch_folder")
@pytest.mark.parametrize("cause", ["target", "wrench", "velocity"])
def test_whatever_became_non_finite_is_noticed(robot: Robot, cause: str) -> None:
    engine = stand(robot, 3)
    targets = hold(robot, 3)
    if cause == "target":
        targets[1, 7, 3] = np.inf
    elif cause == "wrench":
        engine.wrench[1, 7, 1, 2] = np.nan
    else:
        engine.state[1][1, 8] = np.nan
    ticks = step_to(engine, targets)
    assert engine.diverged.tolist() == [False, True, False]
    assert np.isfinite(ticks.record).all()


@pytest.mark.usefixtures("in_scratch_folder")
def test_a_robot_that_diverges_does_not_change_a_bit_of_the_others(robot: Robot) -> None:
    targets = random_targets(robot, 4)
    engine, reference = stand(robot, 4), stand(robot, 4)
    broken = targets.copy()
    broken[2, 3:] = np.nan
    step_to(engine, broken)
    step_to(reference, targets)
    for _ in range(3):
        records = [step_to(each, targets).record[[0, 1, 3]] for each in (engine, reference)]
        np.testing.assert_array_equal(*records)


@pytest.mark.usefixtures("in_scratch_folder")
def test_a_robot_that_diverges_is_put_back_to_its_default_state(robot: Robot) -> None:
    engine = stand(robot, 2)
    diverge(robot, engine, 1)
    np.testing.assert_allclose(engine.state[0][1], engine.model.qpos0, atol=0.01)
    np.testing.assert_allclose(engine.state[1][1], 0.0, atol=0.1)


@pytest.mark.usefixtures("in_scratch_folder")
def test_a_robot_that_diverges_again_after_a_reset_is_flagged_again(robot: Robot) -> None:
    engine = stand(robot, 2)
    for count in (1, 2, 3):
        diverge(robot, engine, 1)
        assert engine.diverged.tolist() == [False, True]
        assert engine.num_diverged == count
        engine.reset(np.array([1]), robot.pose("bent")[None])


@pytest.mark.usefixtures("in_scratch_folder")
def test_a_robot_that_diverges_in_a_partial_step_is_flagged_by_its_own_number(robot: Robot) -> None:
    engine = stand(robot, 4)
    targets = hold(robot, 2)
    targets[1] = np.nan
    ticks = step_to(engine, targets, np.array([1, 3]))
    assert engine.diverged.tolist() == [False, False, False, True]
    assert np.isfinite(ticks.record).all()


def test_the_world_is_left_silent_by_a_healthy_run(robot: Robot) -> None:
    engine = stand(robot, 2)
    for _ in range(10):
        step_to(engine, random_targets(robot, 2))
    assert engine.num_diverged == 0
    assert not engine.batch.warning[..., 1].any()
