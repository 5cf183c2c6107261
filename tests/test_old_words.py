"""Words of the last version's command line: they do what they did, and say their new name."""

from __future__ import annotations

import pytest

from surefoot.cli.evaluate import chosen_scenarios
from surefoot.cli.old_words import OPTIONS, renewed
from surefoot.robots import Robot


@pytest.mark.parametrize(
    ("old", "new", "note"),
    [
        (["train", "--after", "ddpg"], ["train", "--warm-start", "ddpg"], "--after is now called --warm-start"),
        (["train", "--after=ddpg"], ["train", "--warm-start=ddpg"], "--after is now called --warm-start"),
    ],
)
def test_an_old_word_becomes_the_new_one_with_a_line_that_names_it(old: list[str], new: list[str], note: str) -> None:
    assert renewed(old) == (new, [note])


def test_the_suite_of_pushes_at_the_root_was_called_by_the_robots_word_for_it(
    robot: Robot, capsys: pytest.CaptureFixture[str]
) -> None:
    assert chosen_scenarios("pelvis", 4, robot) == chosen_scenarios("push", 4, robot)
    assert capsys.readouterr().err == "--suite pelvis is now called --suite push\n"


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["train", "--warm-start", "ddpg"],
        ["evaluate", "best", "--suite", "paper"],
        ["video", "--body", "pelvis"],
        ["evaluate", "pelvis"],
    ],
)
def test_todays_words_stay_as_they_are(arguments: list[str]) -> None:
    assert renewed(arguments) == (arguments, [])


def test_a_new_word_is_no_old_one() -> None:
    """Else a command line would change each time that it is read."""
    assert not {(command, name) for (command, _), name in OPTIONS.items()} & set(OPTIONS)
