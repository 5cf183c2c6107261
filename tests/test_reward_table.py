"""The table of reward terms: ranges, and terms of a user."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import context, still

from surefoot.errors import UserError
from surefoot.physics.mujoco_engine import MujocoEngine
from surefoot.physics.step_record import StepRecord
from surefoot.rates import TICKS_PER_STEP
from surefoot.robots import Robot
from surefoot.task import reward
from surefoot.task.reward import RewardContext, Term

EVERY_PENALTY = {"power": 1e-3, "foot_travel": 2.0, "sway": 1.0, "posture": 3.0}


@pytest.mark.parametrize("name", reward.TERMS)
def test_every_term_is_finite_and_within_its_range_for_a_robot_that_falls(
    name: str, robot: Robot, falling: list[StepRecord]
) -> None:
    term = reward.TERMS[name]
    for record in falling:
        value = term.function(record, replace(context(**EVERY_PENALTY), nominal_pose=robot.pose("bent")))
        assert value.shape in ((2, TICKS_PER_STEP), (2,))
        mean = reward.step_reward(record, context(**EVERY_PENALTY))[1][name]
        # Rewarding terms are exponentials, so from 0 to 1; penalties are costs of values of at least 0.
        if term.alpha is None:
            assert np.isfinite(value).all()
            assert (value >= 0).all()
            assert -np.inf < mean <= 0.0
        else:
            assert 0.0 <= mean <= 1.0
    every = [reward.step_reward(record, context(**EVERY_PENALTY))[1][name] for record in falling]
    assert len(set(every)) > 1  # it is not a constant


@pytest.fixture(scope="module")
def falling(robot: Robot) -> list[StepRecord]:
    """Policy steps of two robots that lean by 0.4 rad 0.1 m above the floor, until they lie there."""
    engine = MujocoEngine(robot, 2, num_threads=1)
    pose = np.tile(robot.pose("bent"), (2, 1))
    engine.reset(np.arange(2), pose, height=0.1, pitch=np.array([0.4, -0.4]))
    engine.joint_targets[:] = pose[:, None]
    steps = [engine.step().copy() for _ in range(40)]
    assert steps[-1].non_foot_contact.all()
    return steps


def knee_bend(record: StepRecord, context: RewardContext) -> np.ndarray:
    """Mean angle of both knees [rad]: (num_robots, num_ticks)."""
    names = record.robot.joint_names
    return record.joint_position[..., [names.index("left_knee_pitch"), names.index("right_knee_pitch")]].mean(axis=-1)


def test_a_term_of_ones_own_counts_as_those_of_the_table_do(robot: Robot, perfect: StepRecord) -> None:
    record = still(perfect)
    bend = float(knee_bend(record, context())[0, 0])
    # A penalty of 2 per rad: 0.1 * 2 * bend.
    terms = reward.with_extra_terms({"knee_bend": Term(knee_bend, weight=2.0)})
    rewards, means = reward.step_reward(record, context(), terms)
    assert rewards[0] == pytest.approx(1.0 - 0.2 * bend)
    assert means["knee_bend"] == pytest.approx(-2.0 * bend)
    # A rewarding term of weight 7, void: 14 of 21 are left of perfect standing.
    void = Term(lambda record, context: np.full((1, len(record)), np.inf), weight=7.0, alpha=1.0)
    rewards, means = reward.step_reward(record, context(), reward.with_extra_terms({"void": void}))
    assert rewards[0] == pytest.approx(14.0 / 21.0)
    assert means["void"] == 0.0
    assert tuple(means) == (*reward.TERMS, "void")
    # A value for the whole policy step, one of each robot.
    once = reward.with_extra_terms({"once": Term(lambda record, context: np.array([0.5]), weight=1.0, alpha=4.0)})
    # exp(-4 * 0.25) = exp(-1) = 0.36788; (14 + 0.36788) / 15
    assert reward.step_reward(record, context(), once)[0][0] == pytest.approx(14.36788 / 15.0, abs=1e-6)


def test_a_term_of_ones_own_that_does_not_fit_is_named(perfect: StepRecord) -> None:
    with pytest.raises(UserError, match="the reward has a term 'power' already; give the extra term another name"):
        reward.with_extra_terms({"power": Term(knee_bend, weight=1.0)})
    with pytest.raises(UserError, match="the extra reward term 'knee_bend' has no weight"):
        reward.with_extra_terms({"knee_bend": Term(knee_bend, weight=None)})
    wrong = reward.with_extra_terms({"scalar": Term(lambda record, context: np.array(1.0), weight=1.0)})
    with pytest.raises(UserError, match=r"the reward term 'scalar' has shape \(\); valid: \(1, 20\), \(1,\)"):
        reward.step_reward(perfect, context(), wrong)
