"""What a robot did is seen again: the last pushes of a session, and trials of a results table."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from surefoot.agents.load import load_agent, load_policy, usual_robot
from surefoot.agents.nominal import NominalAgent
from surefoot.cli.play import Play
from surefoot.errors import UserError
from surefoot.evaluation.recorded import record_trials
from surefoot.evaluation.results import Results
from surefoot.evaluation.trials import Trial, run_list
from surefoot.physics.pushes import Push, horizontal_push
from surefoot.rates import POLICY_HZ, TICKS_PER_STEP
from surefoot.robots import load_robot
from surefoot.viewer.playback import AFTER_S, BEFORE_S, Kept, Playback, Takes, take_of
from surefoot.viewer.player import Player
from surefoot.viewer.session import PUSH, Session
from surefoot.viewer.source import offered_policies
from surefoot.viewer.verdict import State

ROOT = Path(__file__).parents[1]
OWN = f"{ROOT}/examples/capture_point.py:CapturePoint"
FORWARD = horizontal_push("root", 0.0, 120.0)


def lived(session: Session, takes: Takes, seconds: float) -> list[np.ndarray]:
    """Where the root of the first robot was at the end of each step."""
    places = []
    for _ in range(round(seconds * POLICY_HZ)):
        session.step()
        takes.add(session, 0)
        places.append(session.ticks["root_position"][0, -1].copy())
    return places


def states_of(session: Session) -> list[State]:
    return [State(state) for state in session.verdicts.state]


def seen(playback: Playback) -> list[np.ndarray]:
    places = [playback.ticks["root_position"][0, -1]]
    while not playback.is_over:
        places.append(playback.step()["root_position"][0, -1])
    return places


@pytest.fixture
def session() -> Session:
    return Session(load_policy("trpo"), 1, num_threads=1)


def test_a_push_is_seen_again_as_it_was_from_before_it_until_after_its_verdict(session: Session) -> None:
    takes = Takes()
    before = lived(session, takes, 1.0)
    session.push(FORWARD)
    places = lived(session, takes, 6.0)
    deed = session.deeds.newest
    assert deed
    take = takes.of(deed)
    num_before = round(BEFORE_S * POLICY_HZ)
    judged = next(number for number, kept in enumerate(take) if kept.state == State.RECOVERED)
    assert len(take) == judged + round(AFTER_S * POLICY_HZ)
    playback = Playback(take, session, deed.words)
    expected = [*before[-num_before:], *places][: len(take)]
    assert np.array_equal(seen(playback), expected)
    assert playback.verdicts.state[0] == State.RECOVERED
    assert playback.strategies(0) == session.strategies(0)
    assert "step" in playback.strategies(0)


def test_the_arrow_of_a_push_is_seen_again_while_it_acted(session: Session) -> None:
    """The push lasts 0.12 s: the first three steps after it was asked for, and its first tick is that of the first."""
    takes = Takes()
    lived(session, takes, 1.0)
    session.push(FORWARD)
    lived(session, takes, 1.0)
    take = takes.of(session.deeds.newest)
    playback = Playback(take, session, "")
    times = []
    while not playback.is_over:
        times.append(playback.since(0)[0, PUSH])
        playback.step()
    first = round(BEFORE_S * POLICY_HZ)
    assert np.isinf(times[:first]).all()
    assert times[first : first + 4] == pytest.approx([-0.12, -0.08, -0.04, 0.0])
    assert playback.pushes.force[0, PUSH] == pytest.approx([1000.0, 0.0, 0.0])


def test_a_take_ends_where_the_robot_begins_anew_and_each_of_the_last_five_deeds_has_one(session: Session) -> None:
    takes = Takes()
    session.push(horizontal_push("root", 0.0, 900.0))
    lived(session, takes, 0.4)
    session.reset()
    lived(session, takes, 1.0)
    fall = takes.of(session.deeds.newest)
    assert len(fall) == round(0.4 * POLICY_HZ)
    for impulse in (6.0, 12.0, 18.0, 24.0, 30.0):
        session.push(horizontal_push("root", 0.0, impulse))
        lived(session, takes, 0.2)
    assert [bool(takes.of(deed)) for deed in session.deeds] == [True] * 5


def test_the_player_shows_a_take_and_goes_back_to_the_robots_that_waited(session: Session) -> None:
    takes, shown = Takes(), []
    player = Player(session, lambda now, tick: shown.append(now), lambda: True)
    session.push(FORWARD)
    lived(session, takes, 0.4)
    steps = session.num_steps
    player.playback = Playback(takes.of(session.deeds.newest), session, "")
    for _ in range(16):
        player.frame()
    assert session.num_steps == steps
    for _ in range(10):
        player.frame()
    assert session.num_steps > steps
    assert isinstance(shown[0], Playback)
    assert shown[-1] is session


@pytest.mark.parametrize(
    ("trial", "state"),
    [
        (Trial(Push(impulse=12.0), seed=3, full_length=False), State.RECOVERED),
        (Trial(Push(impulse=300.0), seed=3), State.FELL),
    ],
)
def test_a_trial_of_the_evaluation_is_shown_tick_by_tick(trial: Trial, state: State) -> None:
    recorded = record_trials(NominalAgent(usual_robot()), [trial], num_threads=1)[trial]
    take = take_of(recorded)
    assert take[0].state == State.STANDING
    assert take[-1].state == state
    ends = [kept.end for kept in take[: len(take) - round(AFTER_S * POLICY_HZ) + 1]]
    assert ends[-1] == len(recorded.ticks), "all of it"
    begin = next(kept for kept in take if kept.state == State.RECOVERING)
    assert begin.end - 20 <= recorded.begin < begin.end
    assert begin.pushes.start[0, 0] == recorded.begin


def test_a_stored_trial_is_listed_and_played_first_and_its_policy_goes_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    policy = load_agent(OWN)
    trial = Trial(Push(impulse=12.0), seed=1, horizon=2.0)
    with Results(tmp_path / "r.sqlite") as results:
        results.trials_of(policy).put(trial, run_list(policy, [trial])[trial], "shove")
    page = Play(f"{tmp_path}/r.sqlite:1", port=0, runs=(tmp_path,)).page()
    try:
        page.player.frame()
        playback = page.player.playback
        assert playback
        assert [deed.words for deed in page.player.session.deeds] == ["trial 1: 12 Ns forward"]
        recorded = record_trials(policy, [trial], num_threads=1)[trial]
        num_steps = -(-len(recorded.ticks) // TICKS_PER_STEP)
        places = seen(playback)[:num_steps]
        assert np.array_equal(places[-1], recorded.ticks["root_position"][0, -1])
        page.player.frame()
        page.player.frame()
        assert page.player.playback is None
        assert page.player.session.policy.name == OWN
    finally:
        page.close()
    assert "trial 1 of" in (said := capsys.readouterr().err)
    assert "as stored" in said.replace("\n", " ")


def test_a_stored_trial_that_is_not_there_is_named(tmp_path: Path) -> None:
    with Results(tmp_path / "r.sqlite"):
        pass
    with pytest.raises(UserError, match="row 7"):
        Play(f"{tmp_path}/r.sqlite:7").page()


def test_a_page_offers_an_own_robot_no_policies_of_another() -> None:
    strider = load_robot(str(ROOT / "examples" / "strider" / "strider.toml"))
    assert offered_policies(strider, [], OWN) == ("nominal", OWN)
    assert "ppo" in offered_policies(usual_robot(), [])


def test_an_own_controller_and_an_own_robot_live_on_the_page() -> None:
    strider = ROOT / "examples" / "strider" / "strider.toml"
    for play in (Play(OWN, port=0), Play(robot=str(strider), port=0)):
        page = play.page()
        try:
            page.push(lambda session: session.push(horizontal_push("root", 0.0, 6.0)))
            for _ in range(10):
                page.player.single_step()
            page.player.frame()
            session = page.player.session
            assert session.num_steps == 10
            assert states_of(session) == [State.RECOVERING]
            assert session.robot.name == ("valkyrie" if play.policy else str(strider))
        finally:
            page.close()


def test_kept_is_a_copy(session: Session) -> None:
    session.step()
    kept = Kept.of(session, 0)
    before = kept.ticks.record.copy()
    session.step()
    assert np.array_equal(kept.ticks.record, before)
