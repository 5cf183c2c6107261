"""Training configurations of files: each value has its type and range, or the file is refused in one line."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import tiny

from surefoot.errors import UserError
from surefoot.learning.config import DAGGER, TrainConfig
from surefoot.learning.config_check import HYPER_LIMITS, LIMITS
from surefoot.learning.learner import Learner
from surefoot.learning.preset_file import ALGORITHMS, preset
from surefoot.learning.run_folder import RunFolder
from surefoot.task.environment import EnvConfig
from surefoot.task.random_pushes import DisturbanceConfig

WRONG = (None, True, "x", -1, 2.5, 1e308, float("nan"), float("inf"), 10**30, 10**400, [], {}, [[]], [None], {"a": 1})
TEXTS_OF_ANY_KIND = ("preset", "robot", "pose")


def places(value: Any, path: str = "") -> Iterator[tuple[Any, Any, str]]:
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in list(items):
        yield value, key, f"{path}{key}"
        yield from places(item, f"{path}{key}/")


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_an_edited_configuration_is_refused_or_still_one(algorithm: str, tmp_path: Path) -> None:
    values, folder, accepted, tried = json.loads(preset("fast", algorithm).to_json()), RunFolder(tmp_path), [], 0
    for holder, key, path in list(places(values)):
        before = holder[key]
        for wrong in WRONG:
            holder[key] = wrong
            (tmp_path / "config.json").write_text(json.dumps(values))
            tried += 1
            try:
                config = folder.config()
            except UserError:  # which is one line by its class
                pass
            else:
                accepted.append((path, wrong))
                assert TrainConfig.from_json(config.to_json()) == config
        holder[key] = before
    assert tried > 1000
    for path, wrong in accepted:  # a number within its range, what may be missing, or a text
        name = [part for part in path.split("/") if not part.isdigit()][-1]
        low, high = (LIMITS | HYPER_LIMITS).get(name, (-1e9, 1e9))
        is_text = isinstance(wrong, str) and name in (*TEXTS_OF_ANY_KIND, "bodies", "begin_with", "policy")
        is_number = isinstance(wrong, int | float) and not isinstance(wrong, bool) and low <= wrong <= high
        is_empty = wrong is None or wrong in ([], {})
        assert is_text or is_number or is_empty or isinstance(wrong, bool), (path, wrong)


def test_every_number_of_a_configuration_has_a_range() -> None:
    numbers = {
        field.name
        for kind in (TrainConfig, EnvConfig, DisturbanceConfig)
        for field in dataclasses.fields(kind)
        if "int" in str(field.type) or "float" in str(field.type)
    }
    assert numbers - set(LIMITS) == set()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"algorithm": "sac"}, "unknown algorithm 'sac'; valid: trpo, ppo, ddpg, dagger"),
        ({"num_envs": 0}, "num_envs must be a number from 1 to 16384, not 0"),
        ({"mirror": "yes"}, "mirror must be true or false, not yes"),
        ({"actor": []}, "actor must not be empty"),
        ({"noise": [0.5, 0.1]}, r"noise must be a range from low to high, not \[0.5, 0.1\]"),
        ({"hyper": {}}, "hyper: learning_rate is needed"),
        ({"hyper": {"learning_rate": "fast"}}, "hyper: learning_rate must be a number from 1e-12 to 10, not fast"),
        ({"env": 3}, "env must be a table, not 3"),
        ({"more": 3}, "unexpected keyword argument 'more'"),
    ],
)
def test_what_is_wrong_is_named_with_what_is_valid(change: dict[str, Any], message: str, tmp_path: Path) -> None:
    values = json.loads(preset("fast", "ddpg").to_json()) | change
    (tmp_path / "config.json").write_text(json.dumps(values))
    with pytest.raises(UserError, match=message):
        RunFolder(tmp_path).config()


@pytest.mark.parametrize(
    ("algorithm", "change", "message"),
    [
        ("ppo", {"no_such": 1}, "unexpected keyword argument 'no_such'"),
        (
            "ppo",
            {"batch_size": 1},
            "ppo cannot be made with the arguments of hyper: `batch_size` must be greater than 1",
        ),
        ("ddpg", {"clip_range": 0.2}, "unexpected keyword argument 'clip_range'"),
    ],
)
def test_arguments_that_an_algorithm_does_not_take_are_named(
    algorithm: str, change: dict[str, Any], message: str
) -> None:
    config = tiny(algorithm)
    with pytest.raises(UserError, match=message):
        Learner(dataclasses.replace(config, hyper={**config.hyper, **change}), lambda _: 1e-3)


def test_the_student_of_the_preset_best_needs_no_critic_and_has_arguments_of_its_own() -> None:
    student = preset("best/student", "ppo")
    assert (student.algorithm, student.critic) == (DAGGER, ())
    assert TrainConfig.from_json(student.to_json()) == student
    assert np.isfinite(student.hyper["recovering_weight"])
