"""The live session: real physics under the hands of a user, without a page."""

from __future__ import annotations

import time

import numpy as np
import pytest
from conftest import Broken

from surefoot.agents.load import load_policy, usual_robot
from surefoot.agents.nominal import NominalAgent
from surefoot.errors import UserError
from surefoot.physics.pushes import Push, horizontal_push
from surefoot.rates import POLICY_HZ
from surefoot.task.imperfections import Imperfections
from surefoot.viewer import session as session_module
from surefoot.viewer.player import Player
from surefoot.viewer.session import HAND, PUSH, Session
from surefoot.viewer.verdict import State


@pytest.fixture(scope="module")
def trpo():
    return load_policy("trpo")


@pytest.fixture
def session(trpo) -> Session:
    session = Session(trpo, 1, seed=0, num_threads=1)
    live(session, 1.0)
    return session


def live(session: Session, seconds: float) -> None:
    for _ in range(round(seconds * POLICY_HZ)):
        session.step()


def states(session: Session) -> list[State]:
    return [State(state) for state in session.verdicts.state]


def since_push(session: Session, tick: int) -> float:
    return float(session.since(tick)[0, PUSH])


def root(session: Session) -> np.ndarray:
    return session.ticks["root_position"][:, -1].copy()


def test_a_robot_that_is_left_alone_stands(session):
    live(session, 2.0)
    assert states(session) == [State.STANDING]
    assert (session.verdicts.recovered, session.verdicts.fallen) == (0, 0)


def test_a_push_is_recovered_from_told_and_counted(session):
    session.push(horizontal_push("root", 0.0, 120.0))
    session.step()
    assert states(session) == [State.RECOVERING]
    assert session.pushes.force[0, PUSH] == pytest.approx([1000.0, 0.0, 0.0])
    assert since_push(session, 0) == pytest.approx(-0.12)
    live(session, 5.0)
    assert states(session) == [State.RECOVERED]
    assert (session.verdicts.recovered, session.verdicts.fallen) == (1, 0)
    assert "step" in session.strategies(0)


def test_a_hard_push_fells_and_the_robot_stands_up_again_by_itself(session):
    session.push(horizontal_push("root", 0.0, 480.0))
    live(session, 2.0)
    assert states(session) == [State.FELL]
    assert session.verdicts.fallen == 1
    live(session, 2.5)
    assert states(session) == [State.STANDING]


def test_a_fallen_robot_stays_down_if_told_so_until_it_is_reset(session):
    session.stands_up = False
    session.push(horizontal_push("root", 180.0, 900.0))
    live(session, 5.0)
    assert states(session) == [State.FELL]
    session.push(horizontal_push("root", 0.0, 30.0))
    live(session, 0.2)
    assert states(session) == [State.FELL], "who is down does not recover by being pushed"
    session.reset()
    live(session, 1.0)
    assert states(session) == [State.STANDING]
    assert session.verdicts.fallen == 1


def test_a_push_in_the_future_begins_at_its_tick(session):
    session.push(Push("torso", (0.0, 1.0, 0.0), impulse=10.0, start=0.05, duration=0.01))
    session.step()
    assert since_push(session, 19) == np.inf
    session.step()
    # 0.05 s is tick 25: the fifth of the second step; five ticks long.
    wrench = session.loop.engine.wrench[0, :, session.robot.body_id("torso"), 1]
    assert wrench == pytest.approx([0.0] * 5 + [1000.0] * 5 + [0.0] * 10)
    assert since_push(session, 4) == np.inf
    assert since_push(session, 5) == pytest.approx(-0.01)
    assert since_push(session, 12) == pytest.approx(0.004)
    assert session.pushes.body[0, PUSH] == session.robot.body_id("torso")


def test_an_unknown_body_is_refused_when_asked_for(session):
    with pytest.raises(UserError, match=r"unknown body 'nose' of valkyrie; valid: .*pelvis, torso"):
        session.push(Push("nose", impulse=10.0))


def test_a_drop_lands_and_recovers(session):
    session.drop(0.2)
    live(session, 0.12)
    assert not session.ticks.foot_contact[0, -1].any()
    live(session, 4.0)
    assert states(session) == [State.RECOVERED]


def test_lift_and_push_pushes_in_the_air(session):
    height = root(session)[0, 2]
    session.lift_and_push(horizontal_push("root", 0.0, 40.0))
    pushed_in_air = False
    for _ in range(15):
        session.step()
        is_pushed = since_push(session, 10) < 0.0 and session.pushes.force[0, PUSH, 0] > 0.0
        pushed_in_air |= is_pushed and not session.ticks.foot_contact[0, 10].any()
    assert pushed_in_air
    assert root(session)[0, 2] > height
    assert states(session) == [State.RECOVERING]


def test_a_hand_pulls_until_it_lets_go(session):
    body = session.robot.body_id("torso")
    session.pull(0, body, np.array([0.0, 60.0, 0.0]))
    live(session, 0.4)
    assert session.is_held.tolist() == [True]
    assert session.pushes.force[0, HAND] == pytest.approx([0.0, 60.0, 0.0])
    assert session.since(19)[0, HAND] < 0.0
    assert root(session)[0, 1] > 0.005
    session.release(0)
    live(session, 0.08)
    assert session.since(19)[0, HAND] > 0.0
    assert states(session) == [State.RECOVERING]


def test_all_robots_of_a_crowd_get_the_same_push(robot):
    crowd = Session(NominalAgent(robot), 9, seed=1)
    live(crowd, 0.4)
    before = root(crowd)
    crowd.push(horizontal_push("root", 90.0, 60.0))
    live(crowd, 0.4)
    assert (root(crowd) - before)[:, 1].min() > 0.03
    assert np.ptp(root(crowd)[:, 1]) > 1e-6, "they started from different angles"


def test_only_the_robot_that_is_held_is_disturbed(trpo):
    pair = Session(trpo, 2)
    live(pair, 0.4)
    pair.pull(1, pair.robot.body_id("torso"), np.array([50.0, 0.0, 0.0]))
    pair.step()
    assert states(pair) == [State.STANDING, State.RECOVERING]


def test_ice_lets_feet_slide(robot):
    slid = {}
    for friction in (1.0, 0.02):
        session = Session(NominalAgent(robot), 1)
        session.set_friction(friction)
        live(session, 0.4)
        session.push(horizontal_push("root", 0.0, 30.0))
        before = session.ticks.sole_position[0, -1, :, 0].copy()
        live(session, 0.4)
        slid[friction] = float((session.ticks.sole_position[0, -1, :, 0] - before).max())
    assert slid[1.0] < 0.01
    assert slid[0.02] > 0.03


def test_noise_on_the_observation_is_what_the_filter_lets_pass_and_can_be_switched_off(robot, monkeypatch):
    monkeypatch.setattr(session_module, "PAPER_NOISE", Imperfections(observation_noise=0.5))
    # The nominal pose looks at nothing: both robots do the same.
    exact, noisy = Session(NominalAgent(robot), 1), Session(NominalAgent(robot), 1)
    noisy.set_noise(1.0)
    added = []
    for _ in range(100):
        exact.step()
        noisy.step()
        added.append(noisy.loop.observation - exact.loop.observation)
    # White noise of 0.5 before a first-order Butterworth of 10 Hz at 500 Hz: the share t / (1 + t) of its variance
    # passes, t = tan(pi 10 / 500).
    t = np.tan(np.pi * 10 / 500)
    assert np.std(added) == pytest.approx(0.5 * np.sqrt(t / (1.0 + t)), rel=0.1)
    noisy.set_noise(0.0)
    live(noisy, 1.0)
    live(exact, 1.0)
    assert noisy.loop.observation == pytest.approx(exact.loop.observation, abs=1e-9)


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (None, "returned numbers that are not finite"),
        (RuntimeError("a wheel came off"), "raised an error (RuntimeError: a wheel came off)"),
    ],
)
def test_a_policy_that_fails_is_named_once_and_the_robot_holds_its_pose(robot, error, words):
    session = Session(Broken(robot, error=error), 1)
    live(session, 0.4)
    assert session.message == f"policy nominal-straight {words}; the joints hold their last targets"
    assert np.isfinite(session.ticks.record).all()
    assert states(session) == [State.STANDING]
    session.message = ""
    live(session, 0.2)
    assert session.message == ""
    session.reset()
    session.step()
    assert words in session.message


def test_a_simulation_that_explodes_starts_anew(session, in_scratch_folder):
    session.loop.engine.state[1][0, 0] = 1e13
    session.step()
    assert "became unstable" in session.message
    live(session, 1.0)
    assert states(session) == [State.STANDING]
    assert session.verdicts.fallen == 1


def test_another_policy_takes_over_in_the_middle(session):
    session.push(horizontal_push("root", 0.0, 24.0))
    live(session, 0.2)
    before = root(session)
    session.set_policy(NominalAgent(usual_robot()))
    session.step()
    assert np.abs(root(session) - before).max() < 0.05
    assert (session.loop.nominal == session.robot.pose("bent")).all()


@pytest.mark.parametrize("number", [0, 65])
def test_a_crowd_has_its_limits(trpo, number):
    with pytest.raises(UserError, match=f"the number of robots must be 1 to 64, not {number}"):
        Session(trpo, number)


# The player.


def played(session: Session, watched: bool = True) -> tuple[Player, list[int]]:
    shown: list[int] = []
    return Player(session, lambda _, tick: shown.append(tick), lambda: watched), shown


def test_real_time_is_two_frames_a_policy_step_and_slow_motion_shows_every_tick(session):
    player, shown = played(session)
    before = session.num_steps
    for _ in range(50):
        player.frame()
    assert session.num_steps - before == 25
    player.speed = 0.1
    shown.clear()
    for _ in range(20):
        player.frame()
    assert session.num_steps - before == 26
    assert len(set(shown)) >= 19


def test_a_pause_holds_and_a_single_step_is_one_policy_step(session):
    player, shown = played(session)
    player.paused = True
    before = session.num_steps
    for _ in range(10):
        player.frame()
    assert session.num_steps == before
    player.single_step()
    player.frame()
    player.frame()
    assert session.num_steps == before + 1
    assert shown[-1] == 19


def test_what_is_asked_for_wrongly_becomes_a_message(session):
    player, _ = played(session)
    player.do(lambda session: session.push(Push("nose", impulse=10.0)))
    player.frame()
    assert session.message.startswith("unknown body 'nose'")


def test_nothing_is_computed_while_nobody_watches(session):
    player, shown = played(session, watched=False)
    before = session.num_steps
    player.start()
    time.sleep(0.2)
    player.stop()
    assert session.num_steps == before
    assert not shown
