"""Presets: the paper's figures in `paper`, every value as before version 0.2, and files that are wrong."""

from __future__ import annotations

import dataclasses
import json
import tomllib
from importlib.resources.abc import Traversable
from pathlib import Path

import pytest

from surefoot.cli.train import Train
from surefoot.errors import UserError
from surefoot.learning.config import DAGGER, HALF_LIFE_GAMMA, TakeoverConfig, TrainConfig
from surefoot.learning.preset_file import ALGORITHMS, old_stage, preset, stage_files
from surefoot.task.environment import EnvConfig
from surefoot.task.random_pushes import DisturbanceConfig

SHIPPED = Path(__file__).parent.parent / "src" / "surefoot" / "learning" / "presets"
BEFORE = json.loads((Path(__file__).parent / "data" / "presets-0.1.json").read_text())
"""What every preset of version 0.1 was, under the keys that a run folder had then."""
NAMES = [
    *((name, algorithm) for name in ("paper", "fast") for algorithm in ALGORITHMS),
    *((f"complete/{stage}", algorithm) for algorithm in ALGORITHMS for stage in stage_files("complete", algorithm)),
    *((f"best/{stage}", "ddpg") for stage in stage_files("best", "ddpg")),
]


def test_the_paper_preset_has_the_papers_hyperparameters() -> None:
    ppo, trpo = preset("paper", "ppo"), preset("paper", "trpo")
    for config in (ppo, trpo):
        assert config.num_envs * config.hyper["n_steps"] == 4096
        assert config.hyper["gamma"] == config.hyper["gae_lambda"] == HALF_LIFE_GAMMA == 0.95
        assert config.hyper["learning_rate"] == 3e-4
        assert config.hyper["batch_size"] == 256
        assert config.env == EnvConfig("valkyrie")
    assert ppo.hyper["clip_range"] == 0.2
    assert ppo.hyper["n_epochs"] == 10
    assert trpo.hyper["target_kl"] == 0.01
    assert trpo.hyper["cg_max_steps"] == 10
    # Section III-B: the discount halves a reward's weight after 0.5 s, 13 steps at 25 Hz, rounded to 0.95.
    assert pytest.approx(HALF_LIFE_GAMMA, abs=0.005) == 0.5 ** (1 / 13)


@pytest.mark.parametrize("key", BEFORE)
def test_every_preset_is_to_the_last_digit_what_it_was_in_version_0_1(key: str) -> None:
    """That also reads the configuration of a run folder of version 0.1."""
    name, algorithm = key.split("/")
    now = preset(str(old_stage(name, algorithm)) if name == "complete" else name, algorithm)
    before = TrainConfig.from_json(json.dumps(BEFORE[key]))
    assert dataclasses.replace(now, preset=name) == before
    assert BEFORE[key]["env"]["power_knee"] == now.env.power_log_scale
    assert BEFORE[key]["foresight"] == now.privileged_critic


def test_the_first_stage_of_trpo_and_ppo_is_the_beginning_of_fast() -> None:
    for algorithm, budget in (("trpo", {}), ("ppo", {"schedule_minutes": 60.0})):
        begun = dataclasses.replace(preset("fast", algorithm), minutes=27.0, **budget)
        assert dataclasses.replace(preset("complete/pushes", algorithm), preset="fast") == begun


def test_the_stages_are_in_order() -> None:
    assert list(stage_files("complete", "trpo")) == ["pushes", "standing"]
    assert list(stage_files("complete", "ppo")) == ["pushes", "standing", "harder-pushes"]
    assert list(stage_files("complete", "ddpg")) == ["pushes", "standing", "everything"]
    assert stage_files("fast", "ddpg") == {}
    # The stages of `best` have their own algorithms.
    for algorithm in ALGORITHMS:
        assert list(stage_files("best", algorithm)) == ["no-step", "student"]
        assert preset("best/no-step", algorithm).algorithm == "trpo"
        assert preset("best/student", algorithm).algorithm == DAGGER


def test_the_folder_of_a_run_names_the_algorithm_unless_every_stage_has_its_own() -> None:
    assert Train(preset="complete", algorithm="ppo", seed=2)._folder("complete") == Path("runs/complete-ppo-2")
    assert Train(preset="complete", algorithm="ppo")._folder("complete/pushes") == Path("runs/complete-pushes-ppo-0")
    assert Train(preset="best")._folder("best") == Path("runs/best-0")


@pytest.mark.parametrize("file", [*SHIPPED.glob("*.toml"), *SHIPPED.glob("*/*.toml")], ids=lambda file: file.stem)
def test_every_value_of_a_preset_is_written_out(file: Traversable) -> None:
    # A table cannot hold None: only what is None may be missing, and what the algorithm has no use for. The engine is
    # no matter of the task.
    told_by_python = {"algorithm", "preset", "seed", "extra_terms", "engine"}
    of_ddpg, of_others = {"noise", "noise_correlation"}, {"log_std"}
    tables = tomllib.loads(file.read_text())
    assert list(tables) == [algorithm for algorithm in (*ALGORITHMS, DAGGER) if algorithm in tables]
    for algorithm, table in tables.items():
        config = TrainConfig.from_values({**table, "algorithm": algorithm})
        unused = of_others if algorithm in ("ddpg", DAGGER) else of_ddpg
        for values, known in ((table, config), (table["env"], config.env)):
            fields = {field.name for field in dataclasses.fields(known)} - told_by_python - unused
            assert set(values) == {name for name in fields if getattr(known, name) not in (None, "", TakeoverConfig())}
        pushes = config.env.disturbance
        assert {name for name, value in dataclasses.asdict(pushes).items() if value is not None} == set(
            table["env"]["disturbance"]
        )


def test_unknown_names_are_named_with_the_valid_ones() -> None:
    with pytest.raises(UserError, match="unknown algorithm 'sac'; valid: trpo, ppo, ddpg"):
        preset("fast", "sac")
    with pytest.raises(UserError, match=r"unknown preset 'slow'; valid: paper, fast, complete, best, or a \.toml file"):
        preset("slow", "ppo")
    stages = "valid for trpo: complete/pushes, complete/standing"
    for name in ("complete", "complete/everything"):
        with pytest.raises(UserError, match=f"'{name}' is not one stage of a preset; {stages}"):
            preset(name, "trpo")
    with pytest.raises(UserError, match="valid for ppo: none, 'fast' is a preset without stages"):
        preset("fast/pushes", "ppo")


def test_a_preset_of_ones_own_is_a_file(tmp_path: Path) -> None:
    own = tmp_path / "gentle.toml"
    own.write_text((SHIPPED / "fast.toml").read_text().replace("action_scale = 0.6", "action_scale = 0.5"))
    fast = preset("fast", "ppo")
    gentle = dataclasses.replace(fast, preset="gentle", env=dataclasses.replace(fast.env, action_scale=0.5))
    assert preset(str(own), "ppo") == gentle


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "[ppo]\nminuts = 3.0\n[ppo.hyper]\n[ppo.env]\n",
            r"unknown key 'minuts' in \[ppo\] of .*own\.toml; valid: minutes",
        ),
        ("[ppo]\n[ppo.hyper]\n[ppo.env]\nrobt = 1\n", r"unknown key 'robt' in \[ppo\.env\] of .*; valid: robot, pose"),
        (
            "[ppo]\n[ppo.hyper]\n[ppo.env]\nrobot = 'x'\n[ppo.env.disturbance]\nknee = 1\n",
            r"unknown key 'knee' in \[ppo\.env\.disturbance\] of .*; valid: bodies, impulse",
        ),
        ("[ppo]\n[ppo.hyper]\n[ppo.env]\n", r"own\.toml: .*missing 1 required positional argument: 'robot'"),
        ("[ppo]\n[ppo.env]\n", r"own\.toml has no table \[ppo\.hyper\]"),
        ("[trpo]\n", "the preset 'own' has no table for 'ppo'; it has: trpo"),
        ("[ppo\n", r"own\.toml is not a TOML file"),
        (None, r"cannot read preset .*own\.toml: No such file"),
    ],
    ids=["run", "task", "pushes", "no robot", "no hyper", "no algorithm", "no TOML", "no file"],
)
def test_a_wrong_preset_gets_one_line(text: str | None, message: str, tmp_path: Path) -> None:
    if text is not None:
        (tmp_path / "own.toml").write_text(text)
    with pytest.raises(UserError, match=message) as error:
        preset(str(tmp_path / "own.toml"), "ppo")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(("name", "algorithm"), NAMES)
def test_every_preset_survives_its_json(name: str, algorithm: str) -> None:
    config = preset(name, algorithm)
    assert TrainConfig.from_json(config.to_json()) == config


def test_the_defaults_of_the_pushes_are_the_papers() -> None:
    assert preset("paper", "ddpg").env.disturbance == DisturbanceConfig()
