"""Result pictures: the trials that a film strip shows."""

from surefoot.agents.load import usual_robot
from surefoot.agents.nominal import NominalAgent
from surefoot.evaluation.scenarios import Scenario
from surefoot.evaluation.threshold_search import Threshold
from surefoot.report.result_pictures import recovered_recording


def test_a_strip_shows_at_a_threshold_the_first_trial_that_recovers() -> None:
    agent, line = NominalAgent(usual_robot(), "straight"), next(iter(Scenario("root_push").lines()))
    # Of the trials at 36 Ns forward the one of seed 0 falls, and that of seed 1 recovers.
    recording = recovered_recording(agent, Threshold(line, 36.0, 40, 39, 0.87, 1.0, "share"))
    assert recording.outcome.recovered
    assert recording.trial == line.trial(6, 1, full_length=True)
    # If none recovers, the first is shown: at 60 Ns this pose falls.
    recording = recovered_recording(agent, Threshold(line, 60.0, 2, 0, 0.0, 1.0, "share"))
    assert not recording.outcome.recovered
    assert recording.trial == line.trial(10, 0, full_length=True)


def test_a_strip_of_a_policy_that_rejects_nothing_shows_it_without_a_push() -> None:
    agent, line = NominalAgent(usual_robot(), "straight"), next(iter(Scenario("root_push").lines()))
    recording = recovered_recording(agent, Threshold(line, 0.0, 0, 0, 0.0, 1.0, "gives way"))
    assert recording.trial == line.trial(0, 0, full_length=True)
    assert recording.trial.push.impulse == 0.0
