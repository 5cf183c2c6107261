"""A small selection of what `make fuzz` does: damaged files of every format end in one line, and run no code."""

import pytest
from fuzzing.formats import FORMATS
from fuzzing.run import ACCEPTED, CLEAN, run_case

NUMBERS = {"robot.toml": 25, "robot.xml": 15, "results.sqlite": 60, "command line": 30, "beginning.json": 30}
"""Cases of the formats that take long to read; 200 of each other one."""


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.filterwarnings("ignore")
def test_a_damaged_file_is_accepted_or_refused_in_one_line(name: str) -> None:
    found = {number: run_case((name, number)) for number in range(NUMBERS.get(name, 200))}
    assert {number: each for number, each in found.items() if each[0] not in (ACCEPTED, CLEAN)} == {}
