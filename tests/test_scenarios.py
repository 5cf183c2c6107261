"""The suites as data: what their trials hold, that they can be run, and what a scenario file is refused for."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest
from conftest import an_outcome

from surefoot.agents.load import usual_robot
from surefoot.agents.nominal import NominalAgent
from surefoot.errors import UserError
from surefoot.evaluation.outcome import Outcome
from surefoot.evaluation.scenario_file import suite
from surefoot.evaluation.scenarios import Line, Scenario, canonical_name, from_json, readable_name
from surefoot.evaluation.suites import PAPER, ROBUSTNESS, SUITES
from surefoot.evaluation.trials import Trial, run_list
from surefoot.physics.mujoco_engine import MujocoEngine
from surefoot.physics.pushes import Drop, Push
from surefoot.robots import Robot
from surefoot.robots.domain import DomainParameters
from surefoot.task.imperfections import Imperfections

ALL = (*PAPER, *ROBUSTNESS)
BY_NAME = {scenario.name: scenario for scenario in ALL}


def one_trial(line: Line, seed: int = 0) -> Trial:
    """The third cell of a search, or a fixed trial."""
    return line.trial(3, seed, full_length=True) if line.scenario.search else line.fixed_trials()[seed]


def numbers_in(value: object) -> list[float]:
    if dataclasses.is_dataclass(value):
        value = [getattr(value, field.name) for field in dataclasses.fields(value)]
    if isinstance(value, tuple | list):
        return [number for part in value for number in numbers_in(part)]
    return [float(value)] if isinstance(value, int | float) else []


# The suites.


def test_no_two_scenarios_of_a_suite_have_one_name() -> None:
    for scenarios in SUITES.values():
        names = [scenario.name for scenario in scenarios]
        assert len(names) == len(set(names))


@pytest.mark.parametrize("scenario", ALL, ids=lambda scenario: scenario.name)
def test_every_scenario_builds_finite_trials_that_its_seed_decides(robot: Robot, scenario: Scenario) -> None:
    lines = scenario.lines()
    assert len({line.name for line in lines}) == len(lines)
    for line in lines:
        trial = one_trial(line)
        assert trial == one_trial(line)
        assert trial != one_trial(line, seed=1)
        assert np.isfinite(numbers_in(trial)).all()
        for push in trial.pushes:
            assert push.body in robot.pushable
            assert math.hypot(*push.direction) == pytest.approx(1.0, abs=1e-9)
            assert "-0.0" not in repr(push)  # equal to 0.0, but another text in the results table
        assert trial.domain == scenario.domain
        assert 0.0 <= trial.quiet_from < trial.horizon


def test_every_scenario_runs() -> None:
    """Its first direction for the 2 s after the disturbance, all that share a world in one batch."""
    trials: dict[str, Trial] = {}
    for scenario in ALL:
        trial = one_trial(scenario.lines()[0])
        trials[scenario.name] = dataclasses.replace(trial, horizon=2.0, quiet_from=min(trial.quiet_from, 1.0))
    outcomes: dict[Trial, Outcome] = {}
    for domain in {trial.domain for trial in trials.values()}:
        batch = {trial for trial in trials.values() if trial.domain == domain}
        outcomes |= run_list(NominalAgent(usual_robot()), batch, num_slots=len(batch), domain=domain)
    for outcome in outcomes.values():
        assert outcome.seconds <= 2.0
        assert 0.0 < outcome.torque_ratio <= 1.0
        stood = outcome.reason in ("recovered", "restless", "tilted")
        assert math.isnan(outcome.quiet_power) == (not stood)
    reasons = {name: outcomes[trial].reason for name, trial in trials.items()}
    # 18 Ns are little on a plain floor, and 240 Ns are too much for a pose.
    assert reasons["root_push"] == reasons["standing"] == reasons["latency_40ms"] == "recovered"
    assert reasons["sagittal_240"] == "fell"
    assert "diverged" not in reasons.values()


# Directions.


def test_directions_are_names_degrees_or_how_many() -> None:
    assert [line.name for line in Scenario("s", directions=("left", 45.0, -90.0, 360.0)).lines()] == [
        "left", "45", "right", "forward"
    ]  # fmt: skip
    assert [line.name for line in Scenario("s", directions=3).lines()] == ["forward", "120", "240"]
    assert [line.name for line in Scenario("s", directions=1).lines()] == ["forward"]
    push = Scenario("s", directions=(30.0,)).lines()[0].trial(1, 0, True).push
    assert push.direction == pytest.approx((math.sqrt(0.75), 0.5, 0.0), abs=1e-12)


@pytest.mark.parametrize(
    ("direction", "roll", "pitch"),
    [("forward", 0.0, 3.0), ("left", -3.0, 0.0), ("backward", 0.0, -3.0), ("right", 3.0, 0.0)],
)
def test_a_searched_tilt_leans_the_robot_towards_its_direction(
    robot: Robot, direction: str, roll: float, pitch: float
) -> None:
    (line,) = Scenario("landing_tilt", search="tilt", drop=0.4, directions=(direction,)).lines()
    drop = line.trial(3, 0, True).drop
    assert drop == Drop(0.4, pytest.approx(math.radians(roll)), pytest.approx(math.radians(pitch)))
    # In the simulation: the torso is over the side of the root that it leans to.
    engine = MujocoEngine(robot, 1, num_threads=1)
    start = engine.reset(np.array([0]), robot.pose("straight")[None], height=0.4, roll=drop.roll, pitch=drop.pitch)
    offset = start["torso_position"][0, 0] - start["root_position"][0, 0]
    upright = engine.reset(np.array([0]), robot.pose("straight")[None], height=0.4)
    offset -= upright["torso_position"][0, 0] - upright["root_position"][0, 0]
    towards = np.array([math.cos(line.angle), math.sin(line.angle)])
    height = upright["torso_position"][0, 0, 2] - upright["root_position"][0, 0, 2]
    assert offset[:2] @ towards == pytest.approx(height * math.sin(math.radians(3.0)), abs=0.003)
    assert math.degrees(math.acos(start.root_uprightness[0, 0])) == pytest.approx(3.0)


# What is in a trial.


def test_the_papers_levers_are_above_the_com_at_the_torso_and_below_it_at_the_leg() -> None:
    found = {name: (BY_NAME[name].body, BY_NAME[name].lever) for name in ("torso_push", "thigh_push", "shank_push")}
    assert found == {
        "torso_push": ("torso", 0.32),
        "thigh_push": ("left_thigh", -0.50),
        "shank_push": ("left_shank", -0.70),
    }
    for name, (body, lever) in found.items():
        push = BY_NAME[name].lines()[0].trial(1, 0, True).push
        assert (push.body, push.lever, push.impulse) == (body, lever, 6.0)


def test_the_combined_test_lifts_by_500_ns_and_pushes_240_ms_later() -> None:
    trial = BY_NAME["combined"].lines()[1].trial(10, 4, full_length=False)
    assert trial.preceding == Push("root", (0.0, 0.0, 1.0), 500.0)
    assert trial.push == Push("root", (0.0, 1.0, 0.0), 60.0, start=0.24)
    assert trial.pushes == (trial.preceding, trial.push)


def test_the_second_push_comes_when_the_seed_says() -> None:
    line = BY_NAME["while_stepping"].lines()[0]
    starts = [line.trial(1, seed, True).push.start for seed in range(200)]
    assert min(starts) >= 0.3
    assert max(starts) <= 2.0
    # Uniform: mean 1.15, deviation 1.7 / sqrt(12) = 0.49, of the mean of 200 0.035.
    assert np.mean(starts) == pytest.approx(1.15, abs=4 * 0.035)
    assert line.trial(1, 0, True).preceding == Push("root", (1.0, 0.0, 0.0), 120.0)


def test_drops_begin_in_the_air_and_without_a_push() -> None:
    (trial, *_) = BY_NAME["drop_055"].lines()[0].fixed_trials()
    assert (trial.drop, trial.push.impulse) == (Drop(0.55), 0.0)
    height = BY_NAME["landing_height"].lines()[0].trial(11, 0, True)
    assert (height.drop, height.push.impulse) == (Drop(0.55), 0.0)


def test_conditions_are_carried_into_the_trials() -> None:
    assert one_trial(BY_NAME["noise_both"].lines()[0]).imperfections == Imperfections(0.5, 0.1)
    assert one_trial(BY_NAME["latency_20ms"].lines()[0]).imperfections == Imperfections(latency=0.02)
    assert one_trial(BY_NAME["sensor_bias"].lines()[0]).imperfections == Imperfections(sensor_bias=0.1)
    slope = one_trial(BY_NAME["slope_8_side"].lines()[0]).domain
    assert slope == DomainParameters(slope=math.radians(8.0), uphill=math.radians(90.0))
    assert one_trial(BY_NAME["friction_0.3"].lines()[0]).domain == DomainParameters(friction=0.3)
    assert one_trial(BY_NAME["mass_110"].lines()[0]).domain == DomainParameters(mass_scale=1.1)
    assert one_trial(BY_NAME["physics_1000hz"].lines()[0]).domain == DomainParameters(physics_hz=1000)
    assert one_trial(BY_NAME["duration_250ms"].lines()[0]).push.duration == 0.25
    assert one_trial(BY_NAME["quiet"].lines()[0]).horizon == 60.0


def test_without_a_step_a_foot_that_left_its_place_is_a_failure() -> None:
    stepped, stood = an_outcome(foot_shift=0.031), an_outcome(foot_shift=0.029)
    for scenario, expected in ((BY_NAME["root_push"], True), (BY_NAME["root_push_no_step"], False)):
        line = scenario.lines()[0]
        assert (line.succeeded(stepped), line.succeeded(stood)) == (expected, True)
        assert not line.succeeded(an_outcome(recovered=False))


@pytest.mark.parametrize("scenario", ALL, ids=lambda scenario: scenario.name)
def test_a_scenario_comes_back_from_json_as_it_was(scenario: Scenario) -> None:
    assert from_json(json.loads(json.dumps(dataclasses.asdict(scenario)))) == scenario


@pytest.mark.parametrize("name", SUITES)
def test_a_suite_is_what_its_committed_dump_says_so_that_no_change_goes_unseen(name: str) -> None:
    dump = json.loads((Path(__file__).parent / "data" / "suites.json").read_text())
    assert SUITES[name] == tuple(map(from_json, dump[name]))


def test_a_name_with_the_robots_own_word_for_its_root_is_understood(robot: Robot) -> None:
    assert canonical_name(f"{robot.root}_push_no_step", robot.root) == "root_push_no_step"
    assert readable_name("root_push_no_step", robot.root) == f"{robot.root}_push_no_step"
    for name in ("torso_push", "combined", f"{robot.root}"):
        assert canonical_name(name, robot.root) == readable_name(name, robot.root) == name


# Files.


def read(folder: Path, text: str, robot: Robot | None = None) -> tuple[Scenario, ...]:
    file = folder / "mine.toml"
    file.write_text(text)
    return suite(str(file), robot)


def test_old_keys_are_understood_and_the_new_ones_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    old = "calm_from = 1.0\nfirst_impulse = 60.0\nfirst_up = true\ngap = [0.5, 1.0]"
    (found,) = read(tmp_path, f'[[scenario]]\nname = "old"\n{old}')
    assert found == Scenario(
        "old", quiet_from=1.0, preceding_impulse=60.0, preceding_upward=True, push_interval=(0.5, 1.0)
    )
    where = f"surefoot: {tmp_path / 'mine.toml'}, scenario 1: the key"
    assert capsys.readouterr().err.splitlines() == [
        f"{where} calm_from is called quiet_from now",
        f"{where} first_impulse is called preceding_impulse now",
        f"{where} first_up is called preceding_upward now",
        f"{where} gap is called push_interval now",
    ]


def test_the_robots_own_word_for_its_root_is_understood_in_a_file(tmp_path: Path, robot: Robot) -> None:
    (found,) = read(tmp_path, f'[[scenario]]\nname = "own"\nbody = "{robot.root}"', robot)
    assert found == Scenario("own")


def test_a_file_holds_what_it_says(tmp_path: Path) -> None:
    text = """
        [[scenario]]
        name = "shove"
        body = "torso"
        lever = 0.3
        directions = ["left", 30, 200.5]
        duration = 0.5
        preceding_impulse = 50
        push_interval = [0.5, 1]
        friction = 0.6
        without_step = true

        [[scenario]]
        name = "stand"
        search = ""
        directions = 2
        trials = 3
        horizon = 20
        physics_hz = 1000
    """
    shove, stand = read(tmp_path, text)
    assert shove == Scenario(
        "shove", body="torso", lever=0.3, directions=("left", 30.0, 200.5), duration=0.5, preceding_impulse=50.0,
        push_interval=(0.5, 1.0), friction=0.6, without_step=True,
    )  # fmt: skip
    assert stand == Scenario("stand", search="", directions=2, trials=3, horizon=20.0, physics_hz=1000)
    assert isinstance(shove.preceding_impulse, float)
    assert [len(line.fixed_trials()) for line in stand.lines()] == [3, 3]


@pytest.mark.parametrize(
    ("keys", "fault"),
    [
        ('body = "knee"', "unknown body 'knee' of valkyrie; valid: pelvis, "),
        ("duration = -0.1", "duration must be a number from 0.002 to 5, not -0.1"),
        ("duration = 0.0", "duration must be a number from 0.002 to 5, not 0.0"),
        ("impulse = nan", "impulse must be a number from 0 to 2000, not nan"),
        ("preceding_impulse = inf", "preceding_impulse must be a number from 0 to 2000, not inf"),
        ("horizon = inf", "horizon must be a number from 2 to 600, not inf"),
        ("push_interval = [0.0, nan]", "push_interval must be two times [s], not [0.0, nan]"),
        ("push_interval = [2.0, 1.0]", "push_interval must be a range within 0 to 5 s, not [2.0, 1.0]"),
        ("push_interval = 1.0", "push_interval must be two times [s], not 1.0"),
        ('impulse = "72"', "impulse must be a number from 0 to 2000, not 72"),
        ("impulse = true", "impulse must be a number from 0 to 2000, not True"),
        (f"impulse = 1{'0' * 400}", "impulse must be a number from 0 to 2000, not a whole number of more than"),
        ("without_step = 1", "without_step must be true or false, not 1"),
        ("body = 3", "body must be a text, not 3"),
        ("search = false", "search must be a text, not False"),
        ('search = "force"', "unknown search 'force'; valid: impulse, height, tilt, or nothing"),
        ('directions = [90, "left"]', "direction 'left' is given twice"),
        ('search = "tilt"', "a searched tilt needs a drop height"),
        ("directions = 0", "directions must be how many (1 to 360) or a list of degrees and of forward, left, "),
        ("directions = 2.5", "directions must be how many (1 to 360) or a list"),
        ("directions = []", "directions must be how many (1 to 360) or a list"),
        ('directions = ["up"]', "directions must be how many (1 to 360) or a list"),
        ("directions = [nan]", "directions must be how many (1 to 360) or a list"),
        ("directions = [[0.0], 90.0]", "directions must be how many (1 to 360) or a list"),
        ("directions = [{angle = 0.0}]", "directions must be how many (1 to 360) or a list"),
        ("trials = 2.5", "trials must be a whole number from 1 to 10000, not 2.5"),
        ("trials = 0", "trials must be a whole number from 1 to 10000, not 0"),
        ("latency = 0.05", "latency must be a number from 0 to 0.04, not 0.05"),
        ("physics_hz = 750", "physics_hz must be a multiple of 500, not 750"),
        ("quiet_from = 12.0", "quiet_from must be before the horizon, not 12 s"),
        ("horizon = 2.0\nquiet_from = 1.0\nduration = 1.5", "the push may last until 1.5 s, but from 1 s on"),
        (
            "horizon = 5.0\nquiet_from = 1.0\npreceding_impulse = 9\npush_interval = [0, 4]",
            "the push may last until 4.12 s",
        ),
    ],
)
def test_a_wrong_value_is_answered_with_the_file_the_scenario_and_the_fault(
    tmp_path: Path, robot: Robot, keys: str, fault: str
) -> None:
    good = '[[scenario]]\nname = "good"\n'
    with pytest.raises(UserError) as error:
        read(tmp_path, f'{good}[[scenario]]\nname = "bad"\n{keys}', robot)
    message = str(error.value)
    assert message.startswith(f"{tmp_path / 'mine.toml'}, scenario 2 (bad): {fault}")
    assert "\n" not in message


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ('[[scenario]]\nname = "a"\nimpuls = 3', ", scenario 1: unknown key: impuls; valid: name, search, "),
        ("[[scenario]]\nimpulse = 3.0", ", scenario 1: a name is needed"),
        ("[[scenario]]\nname = 7", ", scenario 1: name must be a text of up to 255 printable characters, not 7"),
        ("scenario = [7]", ", scenario 1: must be a [[scenario]] entry, not 7"),
        ('[[scenario]]\nname = "a"\n' * 2, ": two scenarios are named a"),
        ('[scenario]\nname = "a"', " must hold [[scenario]] entries and nothing else"),
        ("", " must hold [[scenario]] entries and nothing else"),
        ('other = 1\n[[scenario]]\nname = "a"', " must hold [[scenario]] entries and nothing else: other"),
    ],
)
def test_a_wrong_file_is_answered_with_the_file_and_the_fault(tmp_path: Path, text: str, fault: str) -> None:
    with pytest.raises(UserError) as error:
        read(tmp_path, text)
    assert str(error.value).startswith(f"{tmp_path / 'mine.toml'}{fault}")


@pytest.mark.parametrize("content", [b"name = ", b"\xff\xfe\x00", f"x = 1{'0' * 5000}".encode()])
def test_what_is_no_toml_is_refused(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "mine.toml"
    file.write_bytes(content)
    with pytest.raises(UserError, match=r"cannot read (scenario file )?.*mine\.toml"):
        suite(str(file))


@pytest.mark.parametrize("name", ["papr", "nowhere/mine.toml", "."])
def test_an_unknown_suite_is_answered_with_the_known_ones(name: str) -> None:
    with pytest.raises(UserError) as error:
        suite(name)
    assert (
        str(error.value) == f"unknown suite '{name}'; valid: push, paper, robustness, ring, or a scenario file (.toml)"
    )
