from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest
from conftest import MovingPolicy, pushed, run_one, squat

from surefoot.agents.nominal import NominalAgent
from surefoot.errors import UserError
from surefoot.evaluation.outcome import Outcome
from surefoot.evaluation.trials import Trial, TrialSource, draws, run_list, run_trials
from surefoot.physics.pushes import Drop, Push
from surefoot.robots import Robot
from surefoot.task.imperfections import Imperfections

FORWARD, LEFT = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)


def as_text(outcomes: dict[Trial, Outcome]) -> dict[Trial, str]:
    """Outcomes to the last bit; NaN equals NaN."""
    return {trial: repr(outcome) for trial, outcome in outcomes.items()}


# The push.


@pytest.mark.parametrize("seed", range(4))
def test_the_push_begins_1_s_after_the_start_plus_the_seeds_ticks(robot: Robot, seed: int) -> None:
    _, calm = run_one(NominalAgent(robot), pushed(0.0, seed, full_length=False), "com_velocity")
    outcome, trace = run_one(NominalAgent(robot), pushed(400.0, seed), "com_velocity")
    num_ticks = len(trace["com_velocity"])
    differs = (trace["com_velocity"] != calm["com_velocity"][:num_ticks]).any(axis=1)
    # A tick is recorded at its start: the first pushed tick shows in the next one.
    first_pushed = int(differs.argmax()) - 1
    assert num_ticks - first_pushed == outcome.seconds * 500
    assert 500 <= first_pushed < 520
    # And lasts 60 ticks: 400 Ns / 137.29 kg = 2.91 m/s, less the seventh that the legs and soles take meanwhile.
    gain = trace["com_velocity"][first_pushed + 60, 0] - trace["com_velocity"][first_pushed, 0]
    assert 0.8 * 2.91 < gain < 2.91


def test_a_later_push_and_another_body_are_honoured(robot: Robot) -> None:
    policy = NominalAgent(robot)
    _, calm = run_one(policy, pushed(0.0, 2, full_length=False), "com_velocity", "torso_attitude")
    begins = {}
    for start in (0.0, 0.3):
        _, trace = run_one(policy, pushed(300.0, 2, start=start), "com_velocity")
        num_ticks = min(len(trace["com_velocity"]), len(calm["com_velocity"]))
        differs = trace["com_velocity"][:num_ticks] != calm["com_velocity"][:num_ticks]
        begins[start] = int(differs.any(axis=1).argmax())
    assert begins[0.3] - begins[0.0] == 150
    root, _ = run_one(policy, pushed(300.0, 2, body="root"))
    torso, _ = run_one(policy, pushed(300.0, 2, body="torso"))
    assert repr(root) != repr(torso)


def test_an_unknown_body_is_answered_with_the_known_ones(robot: Robot) -> None:
    with pytest.raises(UserError) as error:
        run_list(NominalAgent(robot), [pushed(10.0, 0, body="left_ear")], num_slots=1, num_threads=1)
    valid = "pelvis, torso, left_thigh, right_thigh, left_shank, right_shank"
    assert str(error.value) == f"unknown body 'left_ear' of valkyrie; valid: {valid}"


def test_a_first_push_comes_first_and_the_disturbance_begins_with_it(robot: Robot) -> None:
    policy, seed = NominalAgent(robot), 2
    trial = replace(pushed(12.0, seed, LEFT, start=0.3), preceding=Push(impulse=12.0), horizon=2.0, quiet_from=1.0)
    outcome, trace = run_one(policy, trial, "com_velocity")
    calm = replace(pushed(0.0, seed), horizon=2.0, quiet_from=1.0)
    _, undisturbed = run_one(policy, calm, "com_velocity")
    change = np.abs(trace["com_velocity"] - undisturbed["com_velocity"][: len(trace["com_velocity"])])
    begin = int(change.any(axis=1).argmax()) - 1
    assert 500 <= begin < 520
    assert outcome.seconds == 2.0
    # 12 Ns / 137 kg = 0.087 m/s; to the left only the second one does that, 0.3 s or 150 ticks later.
    assert change[begin + 60, 0] == pytest.approx(0.087, rel=0.3)
    assert change[begin + 148, 1] < 0.02
    assert change[begin + 210, 1] == pytest.approx(0.087, rel=0.3)


def test_a_dropped_robot_begins_in_the_air_without_time_to_settle(robot: Robot) -> None:
    trial = replace(pushed(0.0, 3), drop=Drop(0.3, roll=0.05, pitch=-0.03), horizon=2.0, quiet_from=1.0)
    outcome, trace = run_one(NominalAgent(robot), trial, "foot_contact", "root_uprightness", "com_velocity")
    # All of the trial counts, from the release on.
    assert round(outcome.seconds * 500) == len(trace["com_velocity"])
    assert trace["root_uprightness"][0] == pytest.approx(np.cos(0.05) * np.cos(0.03), abs=1e-9)
    # 0.3 m take sqrt(2 * 0.3 / 9.81) = 0.247 s = 124 ticks.
    assert int(trace["foot_contact"].any(axis=1).argmax()) == pytest.approx(124, abs=2)
    np.testing.assert_allclose(trace["com_velocity"][100], [0.0, 0.0, -9.806651 * 0.2], atol=2e-3)


# Seeds, slots, the order of work.


def mixed_trials() -> list[Trial]:
    trials = [pushed(300.0, seed, direction) for seed in (0, 1) for direction in (FORWARD, LEFT)]
    return [
        *trials,
        pushed(20.0, 2, full_length=False),
        pushed(150.0, 3, LEFT, body="torso", lever=0.3),
        pushed(30.0, 4, full_length=False),
        replace(pushed(24.0, 5, full_length=False), imperfections=Imperfections(0.5, 0.02, 0.1, 0.01)),
        replace(pushed(0.0, 6, full_length=False), drop=Drop(0.1, pitch=0.02)),
        replace(pushed(60.0, 7, LEFT, full_length=False, start=0.3), preceding=Push(impulse=60.0)),
    ]


def test_the_same_trials_give_the_same_bits_whatever_the_slots_and_threads(robot: Robot) -> None:
    policy = NominalAgent(robot, "straight")
    reference = as_text(run_list(policy, mixed_trials(), num_slots=10, num_threads=1))
    assert {outcome.split("reason=")[1].split(",")[0] for outcome in reference.values()} >= {"'fell'", "'recovered'"}
    for num_slots, num_threads in ((1, 1), (2, 2), (3, 1), (20, 2)):
        assert as_text(run_list(policy, mixed_trials(), num_slots=num_slots, num_threads=num_threads)) == reference
    backwards = run_list(policy, mixed_trials()[::-1], num_slots=2, num_threads=1)
    assert as_text(backwards) == reference


def test_seeds_draw_different_starts_and_different_ticks_of_the_push(robot: Robot) -> None:
    starts, ticks, drawn = [], [], []
    for seed in range(8):
        outcome, trace = run_one(NominalAgent(robot, "bent"), pushed(400.0, seed), "joint_position", "joint_torque")
        # At rest the torque is the stiffness times the distance to what the motors hold.
        held = trace["joint_position"][0] + trace["joint_torque"][0] / robot.stiffness
        drawn.append(draws(pushed(400.0, seed), robot.num_joints)[0])
        starts.append(held - robot.pose("bent"))
        ticks.append(len(trace["joint_position"]) - round(outcome.seconds * 500) - 500)
    noise = np.array(drawn)
    np.testing.assert_allclose(starts, noise, atol=1e-3)
    assert len(np.unique(noise, axis=0)) == 8
    assert np.abs(noise).max() <= 0.02
    assert noise.std() == pytest.approx(0.02 / np.sqrt(3), rel=0.15)
    # 8 draws of 0 .. 19 ticks.
    assert len(set(ticks)) > 4
    assert (min(ticks) >= 0, max(ticks) <= 19) == (True, True)


def test_a_policy_forgets_a_slots_last_trial_when_the_next_begins(robot: Robot) -> None:
    # This policy counts the time of each slot: its second trial in a slot must be like a first one.
    trials = [pushed(300.0, seed) for seed in (0, 1, 2)]
    alone = run_list(MovingPolicy(robot, squat(0.3)), trials, num_slots=3, num_threads=1)
    in_turn = run_list(MovingPolicy(robot, squat(0.3)), trials, num_slots=1, num_threads=1)
    assert as_text(in_turn) == as_text(alone)


def test_a_trial_that_is_not_whole_ends_after_2_s_of_quiet(robot: Robot) -> None:
    policy = NominalAgent(robot, "bent")
    whole, _ = run_one(policy, pushed(20.0, 1))
    sampled, trace = run_one(policy, pushed(20.0, 1, full_length=False), "com_velocity")
    assert (whole.reason, sampled.reason) == ("recovered", "recovered")
    assert np.isnan(sampled.com_speed)
    # The push takes 0.12 s, the sway some more, then 2 s of quiet: 50 policy steps with a mean speed below 0.15 m/s.
    assert 2.12 <= sampled.seconds < 4.0
    speed = np.linalg.norm(trace["com_velocity"], axis=1).reshape(-1, 20).mean(axis=1)
    assert (speed[-50:] < 0.15).all()
    assert whole.seconds >= 10.0


def test_quiet_begins_only_after_the_push(robot: Robot) -> None:
    sampled, _ = run_one(NominalAgent(robot, "bent"), pushed(10.0, 1, full_length=False, duration=1.0))
    assert sampled.reason == "recovered"
    # 1 s of a gentle push and 2 s of quiet, whatever the policy steps' borders: at most one step more.
    assert 3.0 <= sampled.seconds <= 3.08


def test_a_restless_policy_is_not_let_off_early(robot: Robot) -> None:
    outcome, _ = run_one(MovingPolicy(robot, squat(0.4)), pushed(0.0, 1, full_length=False))
    assert outcome.reason == "restless"
    assert outcome.seconds >= 10.0


class Queue(TrialSource):
    """A source that notes who asks and reports when."""

    def __init__(self, trials: list[Trial]):
        self.todo = trials[::-1]
        self.log: list[tuple[str, int]] = []

    def next(self) -> Trial | None:
        if not self.todo:
            return None
        trial = self.todo.pop()
        self.log.append(("begin", trial.seed))
        return trial

    def report(self, trial: Trial, outcome: Outcome) -> None:
        self.log.append(("end", trial.seed))


def test_a_finished_slot_takes_the_next_trial_at_once(robot: Robot) -> None:
    # One that stays up for long, and five that fall soon, in two slots.
    queue = Queue([pushed(0.0, 0), *(pushed(400.0, seed) for seed in range(1, 6))])
    busy = []
    run_trials(NominalAgent(robot, "straight"), queue, 2, 1, on_step=lambda running, _: busy.append(len(running)))
    falls = [(what, seed) for seed in range(1, 6) for what in ("begin", "end")]
    assert queue.log == [("begin", 0), *falls, ("end", 0)]
    # Five falls of 1.5 to 1.8 s each are through before the long trial's 11 s are over.
    assert busy[:150] == [2] * 150
    assert busy[-20:] == [1] * 20
    assert len(busy) == pytest.approx(11 * 25, abs=2)


def test_a_trial_that_is_not_wanted_any_more_is_dropped_unreported(robot: Robot) -> None:
    class NoneAfterTheFirst(Queue):
        dropped: ClassVar[list[int]] = []

        def wants(self, trial: Trial) -> bool:
            return False

        def drop(self, trial: Trial) -> None:
            self.dropped.append(trial.seed)

    # The first falls within 3 s, the second would stand for 10.
    queue = NoneAfterTheFirst([pushed(400.0, 0), pushed(0.0, 1)])
    num_steps = []
    run_trials(NominalAgent(robot, "straight"), queue, 2, 1, on_step=lambda *_: num_steps.append(1))
    assert queue.dropped == [1]
    assert [seed for what, seed in queue.log if what == "end"] == [0]
    assert len(num_steps) < 4 * 25


def test_a_source_may_have_no_work_until_an_outcome_is_reported(robot: Robot) -> None:
    class OneByOne(Queue):
        def next(self) -> Trial | None:
            waiting = len(self.log) % 2 == 1
            return None if waiting else super().next()

    source = OneByOne([pushed(400.0, seed) for seed in range(3)])
    run_trials(NominalAgent(robot, "straight"), source, num_slots=4, num_threads=1)
    assert source.log == [(what, seed) for seed in range(3) for what in ("begin", "end")]


def test_no_trials_give_no_outcomes(robot: Robot) -> None:
    assert run_list(NominalAgent(robot), [], num_slots=2, num_threads=1) == {}
