from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

import numpy as np
import pytest
from conftest import an_outcome

from surefoot.disturbance import Push
from surefoot.errors import UserError
from surefoot.judge import Outcome
from surefoot.policy import NominalPolicy
from surefoot.robot import Robot
from surefoot.simulation import Ticks
from surefoot.trials import Trial, TrialSource, run_list, run_trials

FORWARD, LEFT = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
Motion = Callable[[np.ndarray], dict[str, np.ndarray]]


class MovingPolicy(NominalPolicy):
    """Moves joints by a function of the time [s] since each robot's own start; the other joints hold the pose."""

    def __init__(self, robot: Robot, motion: Motion, pose: str = "bent"):
        super().__init__(robot, pose)
        self.robot = robot
        self.motion = motion
        self.steps = np.zeros(64, np.int64)

    def reset(self, ids: np.ndarray) -> None:
        self.steps[ids] = 0

    def __call__(self, observations: np.ndarray, ids: np.ndarray) -> np.ndarray:
        actions = np.zeros((len(ids), self.robot.num_joints))
        for joint, angle in self.motion(self.steps[ids] * 0.04).items():
            actions[:, self.robot.joint_names.index(joint)] = angle
        self.steps[ids] += 1
        return actions


def squat(amplitude: float) -> Motion:
    """Knees bend up and down once a second, hips and ankles keep torso and soles level."""

    def motion(time: np.ndarray) -> dict[str, np.ndarray]:
        knee = amplitude * np.sin(2 * np.pi * time)
        shares = {"knee_pitch": 1.0, "hip_pitch": -0.45, "ankle_pitch": -0.55}
        return {f"{side}_{joint}": share * knee for side in ("left", "right") for joint, share in shares.items()}

    return motion


def lean(angle: float) -> Motion:
    """The torso leans forward within a second and stays there."""
    return lambda time: {"torso_pitch": angle * np.minimum(time, 1.0)}


class Trace:
    """What one slot did: (num_ticks, ...) per quantity; to be given to `run_trials` as `on_step`."""

    def __init__(self, *quantities: str):
        self.steps: dict[str, list[np.ndarray]] = {quantity: [] for quantity in quantities}

    def __call__(self, running: np.ndarray, ticks: Ticks) -> None:
        for quantity, steps in self.steps.items():
            steps.append(getattr(ticks, quantity)[0].copy())

    def __getitem__(self, quantity: str) -> np.ndarray:
        return np.concatenate(self.steps[quantity])


def run_one(policy: NominalPolicy, trial: Trial, *quantities: str) -> tuple[Outcome, Trace]:
    trace = Trace(*quantities)
    outcomes = run_list(policy, [trial], num_slots=1, num_threads=1, on_step=trace)
    return outcomes[trial], trace


def as_text(outcomes: dict[Trial, Outcome]) -> dict[Trial, str]:
    """Outcomes to the last bit; NaN equals NaN."""
    return {trial: repr(outcome) for trial, outcome in outcomes.items()}


def pushed(impulse: float, seed: int, direction: tuple = FORWARD, whole: bool = True, **push: object) -> Trial:
    return Trial(Push(direction=direction, impulse=impulse, **push), seed, whole)


# Verdicts.


def test_the_nominal_pose_recovers_from_nothing() -> None:
    outcome = run_list(NominalPolicy(pose="straight"), [pushed(0.0, 3)], num_slots=1, num_threads=1)[pushed(0.0, 3)]
    assert (outcome.recovered, outcome.reason) == (True, "recovered")
    assert outcome.com_speed < 0.01
    assert outcome.foot_shift < 0.03
    assert outcome.without_step
    assert 0.1 < outcome.torque_ratio < 1.0
    assert outcome.speed_ratio < 0.5


@pytest.mark.parametrize("direction", [FORWARD, LEFT, (-1.0, 0.0, 0.0)])
def test_the_nominal_pose_falls_from_400_newton_seconds(direction: tuple) -> None:
    trial = pushed(400.0, 0, direction)
    outcome, trace = run_one(NominalPolicy(pose="straight"), trial, "non_foot_contact", "com_height")
    assert (outcome.recovered, outcome.reason, outcome.without_step) == (False, "fell", False)
    # 400 Ns / 137 kg = 2.9 m/s over a height of 1.1 m: down within about a second, and judged at once.
    assert 0.3 < outcome.seconds < 1.2
    assert np.isnan(outcome.com_speed)
    on_the_ground = np.flatnonzero(trace["non_foot_contact"])
    assert on_the_ground[0] >= len(trace["non_foot_contact"]) - 20
    assert outcome.torque_ratio == 1.0


def test_a_policy_that_never_comes_to_rest_is_restless(robot: Robot) -> None:
    # The CoM goes up and down by a few cm once a second; its mean speed grows with the amplitude.
    calm, _ = run_one(MovingPolicy(robot, squat(0.2)), pushed(0.0, 1))
    restless, _ = run_one(MovingPolicy(robot, squat(0.4)), pushed(0.0, 1))
    assert (calm.recovered, calm.reason) == (True, "recovered")
    assert calm.com_speed < 0.15
    assert (restless.recovered, restless.reason) == (False, "restless")
    assert 0.15 <= restless.com_speed < 0.25
    assert restless.seconds >= 10.0


def test_a_policy_that_ends_up_leaning_is_tilted(robot: Robot) -> None:
    outcome, trace = run_one(MovingPolicy(robot, lean(0.3), "straight"), pushed(0.0, 1), "torso_uprightness")
    assert np.degrees(np.arccos(trace["torso_uprightness"][-500:])).max() > 20.0
    assert (outcome.recovered, outcome.reason) == (False, "tilted")
    assert outcome.com_speed < 0.15
    upright, trace = run_one(MovingPolicy(robot, lean(0.15), "straight"), pushed(0.0, 1), "torso_uprightness")
    assert 8.0 < np.degrees(np.arccos(trace["torso_uprightness"][-500:])).max() < 20.0
    assert (upright.recovered, upright.reason) == (True, "recovered")


class NanPolicy(NominalPolicy):
    """Gives NaN to the robot in one slot, or to all."""

    def __init__(self, robot: Robot, slot: int | None):
        super().__init__(robot, "straight")
        self.slot = slot

    def __call__(self, observations: np.ndarray, ids: np.ndarray) -> np.ndarray:
        actions = super().__call__(observations, ids)
        actions[ids == self.slot if self.slot is not None else slice(None)] = np.nan
        return actions


@pytest.mark.usefixtures("in_scratch_folder")
def test_a_policy_that_gives_nan_to_one_robot_diverges_there_and_nowhere_else(robot: Robot) -> None:
    trials = [pushed(200.0, seed) for seed in range(3)]
    broken = run_list(NanPolicy(robot, slot=1), trials, num_slots=3, num_threads=1)
    whole = run_list(NominalPolicy(robot, "straight"), trials, num_slots=3, num_threads=1)
    assert (broken[trials[1]].recovered, broken[trials[1]].reason) == (False, "diverged")
    for trial in (trials[0], trials[2]):
        assert repr(broken[trial]) == repr(whole[trial])


@pytest.mark.usefixtures("in_scratch_folder")
def test_every_trial_in_a_slot_that_diverges_again_is_diverged(robot: Robot) -> None:
    trials = [pushed(200.0, seed, whole=False) for seed in range(3)]
    outcomes = run_list(NanPolicy(robot, slot=None), trials, num_slots=1, num_threads=1)
    assert [outcomes[trial].reason for trial in trials] == ["diverged"] * 3
    # In their first policy step: 20 ticks after the start, which is 500 to 519 ticks before the push.
    assert all(-1.0 < outcomes[trial].seconds <= -0.96 for trial in trials)


# The numbers of an outcome against the trial's own ticks.


def test_the_numbers_of_a_whole_trial_are_those_of_its_ticks(robot: Robot) -> None:
    trial = pushed(40.0, 11)
    outcome, trace = run_one(
        NominalPolicy(robot, "bent"), trial, "com_velocity", "sole_position", "joint_torque", "joint_velocity"
    )
    assert outcome.reason == "recovered"
    num_ticks = len(trace["com_velocity"])
    # 1 s to settle, and the push's start within the policy step, which the seed draws after the 11 start angles.
    rng = np.random.default_rng(trial.seed)
    rng.uniform(-0.02, 0.02, robot.num_joints)
    start = 500 + int(rng.integers(20))
    end = start + 10 * 500
    assert outcome.seconds == 10.0
    assert end <= num_ticks < end + 20
    judged = slice(end - 500, end)
    assert outcome.com_speed == pytest.approx(np.linalg.norm(trace["com_velocity"][judged], axis=1).mean(), rel=1e-12)
    # From the last policy step that ended before the push.
    place = trace["sole_position"][start // 20 * 20 - 1, :, :2]
    shift = np.linalg.norm(trace["sole_position"][start:, :, :2] - place, axis=-1).max()
    assert outcome.foot_shift == pytest.approx(shift, rel=1e-12)
    torque = np.abs(trace["joint_torque"]) / [150, *[350, 350, 350, 205, 205] * 2]
    assert outcome.torque_ratio == pytest.approx(torque.max(), rel=1e-12)
    speed = np.abs(trace["joint_velocity"]) / [9.0, *[6.11, 6.11, 11.0, 11.0, 11.0] * 2]
    assert outcome.speed_ratio == pytest.approx(speed.max(), rel=1e-9)


def test_a_foot_that_moves_more_than_3_cm_has_stepped(robot: Robot) -> None:
    def march(time: np.ndarray) -> dict[str, np.ndarray]:
        """After 1.5 s the left knee comes up and the foot is put down again further ahead."""
        up = np.clip((time - 1.5) / 0.2, 0, 1) - np.clip((time - 1.9) / 0.2, 0, 1)
        return {"left_hip_pitch": -0.4 * up, "left_knee_pitch": 0.6 * up, "left_ankle_pitch": -0.2 * up}

    trial = pushed(0.0, 5, whole=False)
    standing, _ = run_one(NominalPolicy(robot, "straight"), trial)
    stepping, trace = run_one(MovingPolicy(robot, march, "straight"), trial, "foot_contact")
    assert standing.foot_shift < 0.03
    assert standing.without_step
    assert not trace["foot_contact"][750:, 0].all()
    assert stepping.foot_shift > 0.03
    assert not stepping.without_step


@pytest.mark.parametrize(
    ("recovered", "foot_shift", "without_step"),
    [(True, 0.03, True), (True, 0.0301, False), (False, 0.0, False)],
)
def test_without_step_is_a_recovery_with_both_feet_in_place(
    recovered: bool, foot_shift: float, without_step: bool
) -> None:
    outcome = an_outcome(recovered=recovered, foot_shift=foot_shift)
    assert outcome.without_step is without_step


# The push.


@pytest.mark.parametrize("seed", range(4))
def test_the_push_begins_1_s_after_the_start_plus_the_seeds_ticks(robot: Robot, seed: int) -> None:
    _, calm = run_one(NominalPolicy(robot), pushed(0.0, seed, whole=False), "com_velocity")
    outcome, trace = run_one(NominalPolicy(robot), pushed(400.0, seed), "com_velocity")
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
    policy = NominalPolicy(robot)
    _, calm = run_one(policy, pushed(0.0, 2, whole=False), "com_velocity", "torso_attitude")
    begins = {}
    for start in (0.0, 0.3):
        _, trace = run_one(policy, pushed(300.0, 2, start=start), "com_velocity")
        num_ticks = min(len(trace["com_velocity"]), len(calm["com_velocity"]))
        differs = trace["com_velocity"][:num_ticks] != calm["com_velocity"][:num_ticks]
        begins[start] = int(differs.any(axis=1).argmax())
    assert begins[0.3] - begins[0.0] == 150
    pelvis, _ = run_one(policy, pushed(300.0, 2, body="pelvis"))
    torso, _ = run_one(policy, pushed(300.0, 2, body="torso"))
    assert repr(pelvis) != repr(torso)


def test_an_unknown_body_is_answered_with_the_known_ones(robot: Robot) -> None:
    with pytest.raises(UserError) as error:
        run_list(NominalPolicy(robot), [pushed(10.0, 0, body="left_ear")], num_slots=1, num_threads=1)
    valid = "pelvis, torso, left_thigh, right_thigh, left_shank, right_shank"
    assert str(error.value) == f"unknown body 'left_ear' of valkyrie; valid: {valid}"


# Seeds, slots, the order of work.


def mixed_trials() -> list[Trial]:
    trials = [pushed(300.0, seed, direction) for seed in (0, 1) for direction in (FORWARD, LEFT)]
    return [*trials, pushed(20.0, 2, whole=False), pushed(150.0, 3, LEFT, body="torso"), pushed(30.0, 4, whole=False)]


def test_the_same_trials_give_the_same_bits_whatever_the_slots_and_threads(robot: Robot) -> None:
    policy = NominalPolicy(robot, "straight")
    reference = as_text(run_list(policy, mixed_trials(), num_slots=7, num_threads=1))
    assert {outcome.split("reason=")[1].split(",")[0] for outcome in reference.values()} >= {"'fell'", "'recovered'"}
    for num_slots, num_threads in ((1, 1), (2, 2), (3, 1), (20, 2)):
        assert as_text(run_list(policy, mixed_trials(), num_slots=num_slots, num_threads=num_threads)) == reference
    backwards = run_list(policy, mixed_trials()[::-1], num_slots=2, num_threads=1)
    assert as_text(backwards) == reference


def test_seeds_draw_different_starts_and_different_ticks_of_the_push(robot: Robot) -> None:
    starts, ticks = [], []
    for seed in range(8):
        outcome, trace = run_one(NominalPolicy(robot, "bent"), pushed(400.0, seed), "joint_position")
        starts.append(trace["joint_position"][0] - robot.pose("bent"))
        ticks.append(len(trace["joint_position"]) - round(outcome.seconds * 500) - 500)
    noise = np.array(starts)
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
    policy = NominalPolicy(robot, "bent")
    whole, _ = run_one(policy, pushed(20.0, 1))
    sampled, trace = run_one(policy, pushed(20.0, 1, whole=False), "com_velocity")
    assert (whole.reason, sampled.reason) == ("recovered", "recovered")
    assert np.isnan(sampled.com_speed)
    # The push takes 0.12 s, the sway some more, then 2 s of quiet: 50 policy steps with a mean speed below 0.15 m/s.
    assert 2.12 <= sampled.seconds < 4.0
    speed = np.linalg.norm(trace["com_velocity"], axis=1).reshape(-1, 20).mean(axis=1)
    assert (speed[-50:] < 0.15).all()
    assert whole.seconds >= 10.0


def test_quiet_begins_only_after_the_push(robot: Robot) -> None:
    sampled, _ = run_one(NominalPolicy(robot, "bent"), pushed(10.0, 1, whole=False, duration=1.0))
    assert sampled.reason == "recovered"
    # 1 s of a gentle push and 2 s of quiet, whatever the policy steps' borders: at most one step more.
    assert 3.0 <= sampled.seconds <= 3.08


def test_a_restless_policy_is_not_let_off_early(robot: Robot) -> None:
    outcome, _ = run_one(MovingPolicy(robot, squat(0.4)), pushed(0.0, 1, whole=False))
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
    run_trials(NominalPolicy(robot, "straight"), queue, 2, 1, on_step=lambda running, _: busy.append(len(running)))
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
    run_trials(NominalPolicy(robot, "straight"), queue, 2, 1, on_step=lambda *_: num_steps.append(1))
    assert queue.dropped == [1]
    assert [seed for what, seed in queue.log if what == "end"] == [0]
    assert len(num_steps) < 4 * 25


def test_a_source_may_have_no_work_until_an_outcome_is_reported(robot: Robot) -> None:
    class OneByOne(Queue):
        def next(self) -> Trial | None:
            waiting = len(self.log) % 2 == 1
            return None if waiting else super().next()

    source = OneByOne([pushed(400.0, seed) for seed in range(3)])
    run_trials(NominalPolicy(robot, "straight"), source, num_slots=4, num_threads=1)
    assert source.log == [(what, seed) for seed in range(3) for what in ("begin", "end")]


def test_no_trials_give_no_outcomes(robot: Robot) -> None:
    assert run_list(NominalPolicy(robot), [], num_slots=2, num_threads=1) == {}
