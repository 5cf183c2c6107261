"""The policies that come with the package do what their training records say."""

from __future__ import annotations

import pytest

from surefoot.agents.load import load_policy, shipped_policies
from surefoot.evaluation.evaluate import push_lines
from surefoot.learning.selection import FIRST_ROUND
from surefoot.learning.standing import share_held
from surefoot.learning.validation import validate

pytestmark = pytest.mark.slow

ROUNDING = 0.05
"""The records are of protocol 1, whose trials begin otherwise, and another processor rounds otherwise: 6 of 120."""


@pytest.mark.parametrize("name", shipped_policies())
def test_a_shipped_policy_recovers_as_often_as_its_record_says(name: str) -> None:
    policy = load_policy(name)
    record = policy.contract.training["selection"][0]
    found = validate(policy, round=FIRST_ROUND)
    assert found.recovered >= record["recovered"] - ROUNDING
    assert found.within_limits >= record.get("within_limits", 0.0) - ROUNDING
    assert found.quiet >= record["calm"] - 0.25


WITHOUT_STEP = {"trpo": 24.0, "ppo": 30.0, "best": 48.0}
"""Pushes at the pelvis that a policy is to answer without a step in any direction [Ns]: a cell less than it does."""


@pytest.mark.parametrize("name", WITHOUT_STEP)
def test_a_shipped_policy_answers_small_pushes_without_a_step(name: str) -> None:
    policy = load_policy(name)
    lines = push_lines(8, policy.robot)
    cells = range(1, round(WITHOUT_STEP[name] / lines[0].grid) + 1)
    share = share_held(policy, lines, cells, num_trials=2)
    # 8 directions times 2 trials a cell: one of them may fail.
    assert (share.mean(axis=0) >= 15 / 16).all(), share


@pytest.mark.parametrize("name", shipped_policies())
def test_a_shipped_policy_says_where_it_comes_from(name: str) -> None:
    training = load_policy(name).contract.training
    assert {"algorithm", "preset", "seed", "policy_steps", "minutes", "cores", "machine", "commit"} <= set(training)
