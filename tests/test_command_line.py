"""The command line before a command runs: words that are wrong, valid values, settings of a training."""

from __future__ import annotations

import inspect
import re
from pathlib import Path

import pytest
from conftest import tiny

from surefoot.agents.policy_file import ACTIVATIONS
from surefoot.cli.choices import VALID, option_texts
from surefoot.cli.commands import COMMANDS, parsed
from surefoot.cli.docs import Docs, pages
from surefoot.cli.main import with_guess
from surefoot.cli.settings import with_settings
from surefoot.cli.train import Train
from surefoot.errors import UserError
from surefoot.evaluation.scenario_file import SUITE_NAMES
from surefoot.learning.exchange import LAYOUTS
from surefoot.learning.preset_file import ALGORITHMS, PRESETS, preset
from surefoot.learning.train import train
from surefoot.physics.engines import ENGINES
from surefoot.robots import shipped_robots
from surefoot.version import __version__


def told(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    """What a command line prints that only explains."""
    with pytest.raises(SystemExit) as end:
        parsed(words)
    assert end.value.code == 0
    return capsys.readouterr().out


def test_the_version_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert told(capsys, "--version") == f"surefoot {__version__}\n"


def test_without_a_command_all_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    lines = told(capsys).splitlines()
    assert {line.split()[0] for line in lines if line.startswith("  ") and line[2] != " "} == set(COMMANDS)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["trian"], "unknown command 'trian'; valid: train, evaluate, "),
        (["--seed", "3"], "unknown option '--seed'; a command comes first; valid: train, "),
        (["train", "--sed", "3"], "unknown option '--sed'; did you mean '--seed'?"),
        (
            ["train", "--env.power-wieght", "1"],
            "unknown option '--env.power-wieght'; did you mean '--env.power-weight'?",
        ),
        (["video", "--directon", "left"], "unknown option '--directon'; did you mean '--direction'?"),
        (["bench", "--zzz"], "unknown option '--zzz'; --help lists the valid ones"),
        (["play", "best", "ppo"], "unexpected argument 'ppo'"),
    ],
)
def test_a_wrong_word_is_named_with_the_right_one(words: list[str], message: str) -> None:
    def understood() -> None:
        with_settings(preset("fast", "ddpg"), parsed(words).settings)

    with pytest.raises(UserError) as error:
        understood()
    assert str(error.value).startswith(message)


@pytest.mark.parametrize(
    ("message", "guess"),
    [
        ("unknown suite 'papr'; valid: push, paper, or a scenario file (.toml)", "paper"),
        ("unknown command 'trian'; valid: train, evaluate", "train"),
        ("unknown body 'tors' of valkyrie; valid: pelvis, torso", "torso"),
        ("cannot read policy dppg: No such file or directory; shipped policies: ddpg, ppo, trpo", "ddpg"),
    ],
)
def test_a_word_that_is_nearly_right_is_answered_with_the_right_one(message: str, guess: str) -> None:
    assert with_guess(message) == f"{message}; did you mean '{guess}'?"


def test_a_word_that_is_like_none_is_answered_with_all() -> None:
    for message in ("unknown suite 'everything'; valid: push, paper", "minutes must be a number above 0, not -1"):
        assert with_guess(message) == message


def test_help_lists_the_values_that_are_valid(capsys: pytest.CaptureFixture[str]) -> None:
    assert VALID["algorithm"] == f"{{{','.join(ALGORITHMS)}}}"
    assert set(VALID["preset"].partition("}")[0][1:].split(",")) == set(PRESETS)
    assert VALID["suite"].partition("}")[0][1:].split(",") == list(SUITE_NAMES)
    assert VALID["robot"].partition("}")[0][1:].split(",") == list(shipped_robots())
    assert VALID["engine"].strip("{}").split(",") == list(ENGINES)
    assert set(VALID["layout"].strip("{}").split(",")) == set(LAYOUTS)
    assert VALID["activation"].strip("{}").split(",") == list(ACTIVATIONS)
    for command, shown in (("train", "algorithm"), ("evaluate", "suite"), ("play", "robot")):
        assert VALID[shown] in told(capsys, command, "--help")


@pytest.mark.parametrize("name", COMMANDS)
def test_no_option_is_shown_by_a_type_of_python_and_each_has_its_words(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    text = told(capsys, name, "--help")
    assert "STR " not in text.replace("[STR [STR ...]]", "")
    assert "{None}" not in text
    assert "(default: None)" not in text
    assert all(len(words) > 3 for words in option_texts(COMMANDS[name]).values())


def test_every_field_of_a_training_can_be_set() -> None:
    words = "--env.power-weight 0 1e-3 1 5e-3 --env.disturbance.impulse 40 200 --hyper.gamma 0.98"
    words += " --actor 64 64 --no-mirror"
    before = preset("fast", "ddpg")
    command = parsed(["train", "--minutes", "2", *words.split()])
    assert command.minutes == 2.0
    after = with_settings(before, command.settings)
    assert after.env.power_weight == ((0.0, 1e-3), (1.0, 5e-3))
    assert after.env.disturbance.impulse == (40.0, 200.0)
    assert after.hyper == {**before.hyper, "gamma": 0.98}
    assert (after.actor, after.mirror) == ((64, 64), False)
    assert (after.env.episode_s, after.critic, after.num_envs) == (before.env.episode_s, before.critic, before.num_envs)


def test_settings_of_a_staged_preset_are_for_a_stage_that_is_named(tmp_path: Path) -> None:
    command = parsed(["train", "--preset", "complete", "--run", str(tmp_path / "run"), "--env.drop-share", "0.5"])
    with pytest.raises(UserError, match=r"--env\.drop-share is for one stage; name it by --stage; valid: pushes, "):
        command.main()
    assert not (tmp_path / "run").exists()


def test_the_settings_of_a_preset_are_listed_with_their_values(capsys: pytest.CaptureFixture[str]) -> None:
    Train(list_settings=True, settings=("--hyper.gamma", "0.98")).main()
    text = " ".join(capsys.readouterr().out.split())
    for shown in ("--env.disturbance.impulse FLOAT FLOAT", "(default: 30.0 300.0)", "--hyper.gamma", "(default: 0.98)"):
        assert shown in text


@pytest.mark.slow
def test_resuming_a_finished_run_says_that_its_budget_is_spent(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    train(tiny("ddpg"), tmp_path / "run")
    Train(resume=tmp_path / "run").main()
    said = " ".join(capsys.readouterr().err.split())
    assert f"{tmp_path}/run has spent its budget of 512 policy steps; --minutes or --steps with more goes on" in said


def test_every_setting_says_what_it_means(capsys: pytest.CaptureFixture[str]) -> None:
    Train(list_settings=True).main()
    entries = re.split(r"\n│ (?=--)", capsys.readouterr().out)
    silent = [entry.split()[0] for entry in entries[1:] if entry.split("│")[1].strip().startswith("(default")]
    assert [option for option in silent if not option.startswith("--hyper.")] == []


def test_every_page_that_help_points_to_is_one_of_the_documentation(capsys: pytest.CaptureFixture[str]) -> None:
    texts = [inspect.getdoc(command) or "" for command in COMMANDS.values()]
    texts += [words for command in COMMANDS.values() for words in option_texts(command).values()]
    named = set(re.findall(r"surefoot docs ([a-z-]+)", " ".join(texts)))
    assert {"method", "scenarios", "exchange"} <= named <= set(pages())
    Docs("method").main()
    assert capsys.readouterr().out == (Path(__file__).parents[1] / "docs" / "method.md").read_text()
    Docs().main()
    assert "How we test" in capsys.readouterr().out
    with pytest.raises(UserError, match=r"unknown page 'metod'; valid: api, controllers, .*method"):
        Docs("metod").main()
