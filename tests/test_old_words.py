"""Words of the last version's command line: they do what they did, and say their new name."""

from __future__ import annotations

import pytest

from surefoot.cli.old_words import OPTIONS, VALUES, renewed


@pytest.mark.parametrize(
    ("old", "new", "note"),
    [
        (["train", "--after", "ddpg"], ["train", "--warm-start", "ddpg"], "--after is now called --warm-start"),
        (["train", "--after=ddpg"], ["train", "--warm-start=ddpg"], "--after is now called --warm-start"),
        (
            ["evaluate", "best", "--suite", "pelvis"],
            ["evaluate", "best", "--suite", "push"],
            "--suite pelvis is now called --suite push",
        ),
        (
            ["evaluate", "best", "--suite=pelvis"],
            ["evaluate", "best", "--suite=push"],
            "--suite pelvis is now called --suite push",
        ),
    ],
)
def test_an_old_word_becomes_the_new_one_with_a_line_that_names_it(old: list[str], new: list[str], note: str) -> None:
    assert renewed(old) == (new, [note])


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
    assert not {(command, option, name) for (command, option, _), name in VALUES.items()} & set(VALUES)
