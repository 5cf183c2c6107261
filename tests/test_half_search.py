"""J50: the impulse that half of the trials survive."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from conftest import an_outcome

from surefoot.agents.load import load_agent
from surefoot.evaluation.evaluate import find_thresholds
from surefoot.evaluation.half_search import HalfSearch
from surefoot.evaluation.scenarios import Line, Scenario
from surefoot.evaluation.trials import Trial

LINE = Scenario("mine", directions=1, half=True).lines()[0]


def survives(trial: Trial, half: float) -> bool:
    """Seed s of 0 to 7 survives up to `half` + 6 (s - 3.5) Ns: a fall from 8 to 0 of 8 over eight cells."""
    return trial.push.impulse <= half + 6.0 * (trial.seed - 3.5)


def search(half: float, order: int = 1) -> HalfSearch:
    found = HalfSearch(LINE, lambda trial: None)
    running = []
    while not found.done:
        while len(running) < 40 and (request := found.next(ahead=False)):
            running.append(request)
        for request in running[::order]:
            found.report(request, an_outcome(recovered=survives(request.trial, half)))
        running = []
    return found


def test_j50_is_where_half_of_the_trials_survive_whatever_the_order_in_which_they_end() -> None:
    # 300 Ns: cells 48, 49, 50, 51, 52 have seeds 2, 3, 4, 5 and 6 as their first survivor. Of 49 to 52, 5 + 4 + 3 + 2
    # of 32 trials survive, of 48 to 51 6 + 5 + 4 + 3 = 18, more than half; so 49 to 52 are the first with at most 16.
    found = search(300.0)
    result = found.result()
    assert (result.size, result.trials, result.recovered, result.limited_by) == (306.0, 32, 14, "half")
    assert search(300.0, order=-1).result() == result


def test_a_robot_that_always_survives_has_the_largest_cell() -> None:
    line = dataclasses.replace(LINE, protocol=dataclasses.replace(LINE.protocol, impulse_end=60.0))
    found = HalfSearch(line, lambda trial: an_outcome())
    assert found.next(ahead=False) is None
    assert found.done
    assert (found.result().size, found.result().limited_by) == (60.0, "search")


def test_trials_that_are_known_are_not_asked_for_again() -> None:
    asked: list[Trial] = []

    def recall(trial: Trial) -> object:
        return an_outcome(recovered=survives(trial, 60.0)) if trial.push.impulse < 48.0 else None

    found = HalfSearch(LINE, recall)  # type: ignore[arg-type]
    while request := found.next(ahead=False):
        asked.append(request.trial)
        found.report(request, an_outcome(recovered=survives(request.trial, 60.0)))
    assert min(trial.push.impulse for trial in asked) == 48.0
    assert found.result() == search(60.0).result()


@pytest.mark.parametrize("robot", ["valkyrie"])
def test_half_of_real_trials_survive_at_j50_and_both_searches_share_their_trials(robot: str) -> None:
    agent = load_agent("nominal")
    scenario = Scenario("pushed", directions=("left",), horizon=3.0, quiet_from=1.0)
    both = [scenario, dataclasses.replace(scenario, name="pushed_half", half=True)]
    lines: list[Line] = [line for each in both for line in each.lines()]
    holds, half = find_thresholds(agent, lines)
    assert holds.size <= half.size
    share = half.recovered / half.trials
    assert 0.0 <= share <= 0.5
    assert np.isclose(half.size % 6.0, 0.0)
