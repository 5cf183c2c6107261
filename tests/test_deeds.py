"""What was pushed, and what became of it: the list on the live page, and plots that hold what they show."""

from __future__ import annotations

import numpy as np
import pytest

from surefoot.agents.load import load_policy
from surefoot.physics.pushes import horizontal_push
from surefoot.rates import POLICY_HZ
from surefoot.viewer.live_panel import fitting_limit, verdict_values
from surefoot.viewer.markup import render
from surefoot.viewer.session import Session
from surefoot.viewer.verdict import State


@pytest.fixture
def session() -> Session:
    session = Session(load_policy("trpo"), 1, num_threads=1)
    live(session, 1.0)
    return session


def live(session: Session, seconds: float) -> None:
    for _ in range(round(seconds * POLICY_HZ)):
        session.step()


def told(session: Session) -> list[tuple[str, str]]:
    return [(deed.words, deed.verdict) for deed in session.deeds]


def test_a_push_is_told_with_impulse_force_and_verdict_and_a_fall_stays_readable(session: Session) -> None:
    """120 Ns within 0.12 s are 1000 N, and 900 Ns are 7500 N."""
    session.push(horizontal_push("root", 90.0, 120.0))
    assert told(session) == [("120 Ns left, 1000 N", "")]
    live(session, 8.0)
    assert told(session) == [("120 Ns left, 1000 N", "recovered")]
    session.push(horizontal_push("root", 0.0, 900.0))
    live(session, 6.0)
    assert session.verdicts.state[0] == State.STANDING, "it has stood up again"
    assert told(session) == [("900 Ns forward, 7500 N", "fell"), ("120 Ns left, 1000 N", "recovered")]
    html = render("deeds", deeds=list(session.deeds))
    assert html.index("900 Ns forward, 7500 N") < html.index(">fell<") < html.index("120 Ns left, 1000 N")


def test_a_hand_is_told_with_its_force_while_it_pulls_and_its_largest_after(session: Session) -> None:
    """40, 90 and 60 N for a step of 40 ms each are 7.6 Ns."""
    body = 1
    for force in (40.0, 90.0, 60.0):
        session.pull(0, body, np.array([force, 0.0, 0.0]))
        session.step()
        assert f"held by hand with {force:.0f} N" in str(verdict_values(session, 0)["detail"])
    session.release(0)
    live(session, 5.0)
    assert "held by hand" not in str(verdict_values(session, 0)["detail"])
    assert told(session) == [("by hand, up to 90 N, 8 Ns", "recovered")]


def test_a_drop_and_a_lift_are_told_and_only_the_last_five_deeds_are_kept(session: Session) -> None:
    session.drop(0.05)
    session.lift_and_push(horizontal_push("torso", 180.0, 60.0))
    assert [words for words, _ in told(session)] == [
        "lifted by 500 Ns up, then 60 Ns backward at the torso", "drop from 0.05 m"
    ]  # fmt: skip
    for _ in range(6):
        session.push(horizontal_push("root", 0.0, 6.0))
    assert len(told(session)) == 5


def test_a_crowd_is_counted() -> None:
    session = Session(load_policy("trpo"), 4, num_threads=1)
    session.push(horizontal_push("root", 0.0, 900.0))
    live(session, 1.5)
    assert told(session) == [("900 Ns forward, 7500 N", "4 fell")]


@pytest.mark.parametrize(("largest", "limit"), [(0.0, 40.0), (39.0, 40.0), (41.0, 80.0), (80.0, 80.0), (100.0, 160.0)])
def test_a_plots_range_is_doubled_until_its_curves_fit(largest: float, limit: float) -> None:
    time, curve = np.array([-1.0, 0.0]), np.array([np.nan, -largest])
    assert fitting_limit(40.0, (time * 1000.0, curve)) == limit
