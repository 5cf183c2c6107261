"""The policies that come with the package do what their training records say."""

from __future__ import annotations

import pytest

from surefoot.agents.load import load_policy, shipped_policies
from surefoot.learning.selection import FIRST_ROUND
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
    assert found.quiet >= record["calm"] - 0.25


@pytest.mark.parametrize("name", shipped_policies())
def test_a_shipped_policy_says_where_it_comes_from(name: str) -> None:
    training = load_policy(name).contract.training
    assert {"algorithm", "preset", "seed", "policy_steps", "minutes", "cores", "machine", "commit"} <= set(training)
