"""A small selection of what `make fuzz` does: damaged files of every format end in one line, and run no code."""

import random
from pathlib import Path

import pytest
from fuzzing import formats, mutations, policy_formats
from fuzzing.formats import FORMATS
from fuzzing.run import ACCEPTED, CLEAN, Tally, cases, run_case, run_guarded

NUMBERS = {
    "robot.toml": 25,
    "robot.xml": 25,
    "results.sqlite": 60,
    "command line": 30,
    "beginning.json": 30,
    "config.json, run": 12,
    "foreign.onnx, bytes": 60,
    "foreign.onnx, metadata": 60,
    "deploy.yaml": 60,
}
"""Cases of the formats that take long to read; 200 of each other one."""

FOUND = [
    ("policy.onnx, bytes", 40_028),  # the name of a size that is not UTF-8
    ("checkpoint.npz", 76_782),  # a zip file of version 13.6
]
"""Cases that `make fuzz` has ended in a traceback."""


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.filterwarnings("ignore")
def test_a_damaged_file_is_accepted_or_refused_in_one_line(name: str) -> None:
    found = {number: run_case((name, number)) for number in range(NUMBERS.get(name, 200))}
    assert {number: each for number, each in found.items() if each[0] not in (ACCEPTED, CLEAN)} == {}


@pytest.mark.parametrize("case", FOUND)
@pytest.mark.filterwarnings("ignore")
def test_a_case_that_once_ended_in_a_traceback_is_refused_in_one_line(case: tuple[str, int]) -> None:
    assert run_case(case)[0] == CLEAN


@pytest.mark.parametrize("name", [name for name in FORMATS if name not in ("command line", "checkpoint.npz")])
@pytest.mark.filterwarnings("ignore")
def test_a_whole_file_is_accepted_so_that_it_is_the_damage_that_is_refused(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in (formats, policy_formats):
        for damage in ("damaged_bytes", "damaged_text", "damaged_value"):
            monkeypatch.setattr(module, damage, lambda rng, whole: whole)
    monkeypatch.setattr(formats, "damage_database", lambda rng, file: None)
    FORMATS[name].attempt(random.Random(0), tmp_path)


def test_a_case_is_the_same_whatever_was_run_before() -> None:
    def damaged(seed: int) -> str:
        return repr(mutations.damaged_value(random.Random(seed), {"a": [1, {"b": "c"}], "d": {"e": 2.5}}))

    first = [damaged(seed) for seed in range(300)]
    assert [damaged(seed) for seed in range(300)] == first
    assert len(set(first)) > 200


def test_a_campaign_that_was_stopped_goes_on_with_its_next_case(tmp_path: Path) -> None:
    kept = tmp_path / "fuzz.json"
    run_guarded(5, 0.0, Tally(kept))  # stopped after the first case
    assert Tally(kept).next == 1
    run_guarded(5, 1.0, Tally(kept))
    tally = Tally(kept)
    assert tally.next == sum(counts.total() for counts in tally.found.values()) == 5
    assert list(tally.found) == list(dict.fromkeys(name for name, _ in cases(5)))
