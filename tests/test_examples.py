"""The example scenario file and the page about scenarios say what the code does."""

import dataclasses
import math
import re
from pathlib import Path

import pytest

from surefoot.evaluation import scenario_file
from surefoot.evaluation.scenario_file import suite
from surefoot.evaluation.scenarios import Scenario
from surefoot.evaluation.suites import PAPER, ROBUSTNESS

ROOT = Path(__file__).parent.parent
EXAMPLE = ROOT / "examples" / "scenarios.toml"
PAGE = (ROOT / "docs" / "scenarios.md").read_text()


def test_the_example_is_read_as_it_says() -> None:
    found = {scenario.name: scenario for scenario in suite(str(EXAMPLE))}
    assert len(found) == 6
    angles = [math.degrees(line.angle) for line in found["diagonal_push"].lines()]
    assert angles == pytest.approx([45.0, 135.0, 225.0, 315.0])
    assert (found["shoulder_height"].body, found["shoulder_height"].lever) == ("torso", 0.45)
    assert found["icy_slope"].domain.slope == pytest.approx(math.radians(4.0))
    assert [line.name for line in found["icy_slope"].lines()] == ["backward"]
    starts = [found["one_two"].lines()[0].trial(10, seed, full_length=True).push.start for seed in range(20)]
    assert all(0.5 <= start <= 1.0 for start in starts)
    assert found["one_two"].without_step
    assert len(found["tired_motors"].lines()[0].fixed_trials()) == 8
    leaning = found["from_a_step"].lines()[0].trial(7, 0, full_length=True).drop
    assert leaning is not None
    assert (leaning.height, leaning.pitch) == (0.3, pytest.approx(math.radians(7.0)))


def test_every_key_is_on_the_page_with_its_default() -> None:
    keys = re.findall(r"^\| `(\w+)` \| (?:`(.*?)`|none)? ?\|", PAGE, re.MULTILINE)
    fields = {field.name: field.default for field in dataclasses.fields(Scenario)}
    assert [key for key, _ in keys] == list(fields)
    for key, default in keys:
        if default:
            said = default.strip('"') if default.startswith('"') else default
            expected = fields[key]
            if isinstance(expected, bool):
                assert said == str(expected).lower(), key
            elif isinstance(expected, tuple):
                assert said == f"[{expected[0]:g}, {expected[1]:g}]", key
            elif isinstance(expected, str):
                assert said == expected, key
            else:
                assert float(said) == expected, key


def test_the_ranges_on_the_page_are_those_of_the_code() -> None:
    for key, (low, high) in scenario_file._RANGES.items():
        *_, row = re.findall(rf"^\| `{key}` \|.*$", PAGE, re.MULTILINE)
        assert f"up to {high:g} " in row if key == "physics_hz" else f"{low:g} to {high:g}" in row, key


def test_every_scenario_of_the_suites_is_on_the_page() -> None:
    # "`friction_0.3`, `_0.5`" stands for friction_0.3 and friction_0.5.
    for name in (scenario.name for scenario in (*PAPER, *ROBUSTNESS)):
        ends = [name[place:] for place, letter in enumerate(name) if letter == "_"]
        assert any(f"`{words}`" in PAGE for words in (name, *ends)), name
