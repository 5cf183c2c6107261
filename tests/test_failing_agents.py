"""Policies and controllers whose code fails: their trials fail with a reason, and nothing but one line is shown."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import make_env, pushed

from surefoot.agents.controllers import load_controller
from surefoot.agents.nominal import NominalAgent
from surefoot.environments.single import PushRecoveryEnv
from surefoot.errors import UserError
from surefoot.evaluation.trials import run_list
from surefoot.robots import Robot
from surefoot.task.agent import Command


class Hostile:
    """An answer that raises an error when it is looked at, and when the error is put into words."""

    def __array__(self, *_: object, **__: object) -> np.ndarray:
        raise type("Mute", (Exception,), {"__str__": lambda self: 1 / 0})

    __iter__ = __repr__ = __array__  # type: ignore[assignment]


class Failing(NominalAgent):
    """Answers what it is told to, or raises it."""

    def __init__(self, robot: Robot, answer: object):
        super().__init__(robot)
        self.answer = answer

    def __call__(self, inputs: np.ndarray, ids: np.ndarray) -> Command:
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer(super().__call__(inputs, ids)) if callable(self.answer) else self.answer  # type: ignore[return-value]


ANSWERS = {
    "an error": (ValueError("no such\nstate"), "raised", "raised (ValueError: no such state)"),
    "an overflow": (
        OverflowError(34, "result too large"),
        "raised",
        "raised (OverflowError: (34, 'result too large'))",
    ),
    "a long error": (KeyError("x" * 10_000), "raised", f"raised (KeyError: '{'x' * 199}...)"),
    "a text": ("bend the knees", "wrong shape", "wrong shape"),
    "nothing": (None, "wrong shape", "wrong shape"),
    "texts of numbers": (lambda command: Command(command.joint_target.astype(str)), "wrong shape", "wrong shape"),
    "objects": (lambda command: Command(command.joint_target.astype(object)), "wrong shape", "wrong shape"),
    "complex numbers": (lambda command: Command(command.joint_target + 0j), "wrong shape", "wrong shape"),
    "a ragged list": (Command([[0.0] * 11, [0.0]]), "wrong shape", "wrong shape"),  # type: ignore[arg-type]
    "a huge number": (Command([[10**400] * 11]), "wrong shape", "wrong shape"),  # type: ignore[arg-type]
    "what raises when it is looked at": (Hostile(), "wrong shape", "wrong shape"),
    "what raises when it is turned into numbers": (Command(Hostile()), "wrong shape", "wrong shape"),  # type: ignore[arg-type]
    "not a number": (lambda command: Command(np.nan * command.joint_target), "not finite", "not finite"),
}


@pytest.mark.parametrize("name", ANSWERS)
def test_a_policy_that_fails_fails_its_trial_with_a_reason(robot: Robot, name: str) -> None:
    answer, reason, words = ANSWERS[name]
    policy = Failing(robot, answer)
    trials = [pushed(12.0, seed) for seed in range(2)]
    outcomes = run_list(policy, trials, num_slots=2, num_threads=1)
    assert [(outcomes[trial].recovered, outcomes[trial].reason) for trial in trials] == [(False, reason)] * 2
    assert policy.failures == {words: 2}


def test_a_policy_that_cannot_get_ready_is_named_in_one_line(robot: Robot) -> None:
    class Unready(NominalAgent):
        def prepare(self, num_robots: int) -> None:
            raise MemoryError(f"no room\nfor {num_robots}")

    with pytest.raises(UserError) as error:
        run_list(Unready(robot), [pushed(12.0, 0)], num_slots=3, num_threads=1)
    assert str(error.value) == "nominal-bent cannot drive 3 robots: MemoryError: no room for 3"


CONTROLLER = """
import numpy as np

class Mine:
    rate_hz = 100

    def __init__(self, robot, num_robots):
        self.pose = robot.pose("bent")
        {beginning}

    def reset(self, ids):
        {reset}

    def __call__(self, state, ids):
        return (np.tile(self.pose, (len(ids), 1)),)
"""
WRONG = {
    "raises": ("1 / 0", "cannot be made for valkyrie: ZeroDivisionError: division by zero"),
    "raises for more robots": ("1 / (num_robots == 1)", "cannot drive 2 robots: ZeroDivisionError: division by zero"),
    "texts for gains": ("self.stiffness = ['soft'] * 11", "does not say what it wants: ValueError: could not convert"),
    "ragged gains": ("self.damping = [[1.0], []]", "does not say what it wants: ValueError: setting an array element"),
    "a rate of a list": ("self.rate_hz = [100]", "must have a rate_hz of 25, 50, 100, 125, 250, 500, not [100]"),
    "a path that is none": ("self.path = ('hold',)", "'s path must be cubic or line or hold, not ('hold',)"),
    "a file that is not there": ("self.files = ['gone']", "does not say what it wants: FileNotFoundError"),
    "an unknown pose": ("self.pose = 'lying'", "lying"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_controller_that_cannot_be_made_is_named_in_one_line(robot: Robot, tmp_path: Path, name: str) -> None:
    beginning, message = WRONG[name]
    (tmp_path / "mine.py").write_text(CONTROLLER.format(beginning=beginning, reset="pass"))
    with pytest.raises(UserError) as error:
        run_list(load_controller(f"{tmp_path}/mine.py:Mine", robot), [pushed(12.0, 0)], num_slots=2, num_threads=1)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_a_controller_that_cannot_forget_fails_its_trials(robot: Robot, tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(CONTROLLER.format(beginning="pass", reset="raise RuntimeError('I remember')"))
    agent, trial = load_controller(f"{tmp_path}/mine.py:Mine", robot), pushed(12.0, 0)
    assert run_list(agent, [trial], num_slots=1, num_threads=1)[trial].reason == "raised"
    assert agent.failures["raised (RuntimeError: I remember)"] == 1


@pytest.mark.parametrize(
    ("text", "name", "message"),
    [
        ("raise SystemExit(0)", "Mine", "it ends the program"),
        ("def", "Mine", "SyntaxError"),
        ("Mine = 3", "Mine", "has no class 'Mine'"),
        ("", "", "has no class ''"),
        ("x = '\0'", "Mine", "null bytes"),
        (b"\xff\xfe", "Mine", "it is not UTF-8 text"),
    ],
)
def test_a_file_that_holds_no_controller_is_named_in_one_line(
    robot: Robot, tmp_path: Path, text: str | bytes, name: str, message: str
) -> None:
    (tmp_path / "mine.py").write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(UserError, match=message) as error:
        load_controller(f"{tmp_path}/mine.py:{name}", robot)
    assert "\n" not in str(error.value)


ACTIONS = {
    "a text": "bend the knees",
    "texts of numbers": np.full((2, 11), "0.1"),
    "a ragged list": [[0.0] * 11, [0.0]],
    "a huge number": [[10**400] * 11] * 2,
    "one action too few": np.zeros((1, 11)),
    "nothing": None,
}


@pytest.mark.parametrize("name", ACTIONS)
def test_actions_that_are_none_are_refused_by_the_environment_in_one_line(name: str) -> None:
    env = make_env(2)
    env.reset(seed=0)
    with pytest.raises(UserError, match=r"^actions must have shape \(2, 11\)[:,] [^\n]*$"):
        env.step(ACTIONS[name])  # type: ignore[arg-type]
    env.step(np.zeros((2, 11)))


@pytest.mark.parametrize("action", ["bend", [[0.0], [0.0, 1.0]], None, [0.0] * 10, [10**400] * 11])
def test_an_action_that_is_none_is_refused_by_the_single_environment(action: object) -> None:
    env = PushRecoveryEnv()
    env.reset(seed=0)
    with pytest.raises(UserError) as error:
        env.step(action)
    assert "\n" not in str(error.value)
