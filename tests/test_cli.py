"""The commands as a user meets them: subprocesses, exit codes, one-line errors, JSON on standard output."""

import csv
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import onnx
import pytest

from surefoot.agents.load import shipped_policies
from surefoot.agents.policy_file import METADATA_KEY, network_bytes
from surefoot.cli.commands import COMMANDS
from surefoot.cli.evaluate import chosen_scenarios
from surefoot.robots import Robot, load_robot
from surefoot.task.contract import Contract

pytestmark = pytest.mark.slow


def surefoot(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "surefoot", *arguments]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=300)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_explains_itself(command: str, tmp_path: Path) -> None:
    done = surefoot(command, "--help", cwd=tmp_path)
    assert done.returncode == 0
    assert COMMANDS[command].__doc__.split(".")[0].split(":")[0] in " ".join(done.stdout.split())


SHIPPED = f"; shipped policies: {', '.join(shipped_policies())}"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["train", "--algorithm", "sac"], "surefoot: unknown algorithm 'sac'; valid: trpo, ppo, ddpg"),
        (
            ["train", "--preset", "slow"],
            "surefoot: unknown preset 'slow'; valid: paper, fast, complete, best, or a .toml file",
        ),
        (["train", "--minutes", "-1"], "surefoot: minutes must be a number above 0 up to 100000, not -1.0"),
        (["train", "--minutes", "nan"], "surefoot: minutes must be a number above 0 up to 100000, not nan"),
        (["train", "--steps", "0"], "surefoot: steps must be a whole number from 1 to 1000000000000, not 0"),
        (["train", "--seed", "-2"], "surefoot: seed must be a whole number from 0 to 4294967295, not -2"),
        (["train", "--resume", "nowhere"], "surefoot: nowhere is not a run folder: cannot read config.json"),
        (
            ["train", "--warm-start", "nowhere"],
            "surefoot: cannot read policy nowhere: No such file or directory" + SHIPPED,
        ),
        (
            ["evaluate", "mine.toml"],
            "surefoot: mine.toml is no policy; a robot's description goes with --robot, scenarios go with --suite",
        ),
        (["evaluate", "no.onnx"], "surefoot: cannot read policy no.onnx: No such file or directory" + SHIPPED),
        (["evaluate", "bad.onnx"], "surefoot: bad.onnx is not a policy file: not a readable ONNX network"),
        (["evaluate", "empty"], "surefoot: cannot read policy empty/best.onnx: No such file or directory" + SHIPPED),
        (["evaluate", "nominal", "--directions", "5"], "surefoot: directions must be a multiple of 4, not 5"),
        (
            ["evaluate", "nominal", "--export", "t.xls"],
            "surefoot: unknown format '.xls' of t.xls; valid: .csv, .parquet",
        ),
        (
            ["evaluate", "other.onnx"],
            "surefoot: unknown robot 'atlas'; valid: g1, g1_arms, h1, valkyrie, or a description (.toml)",
        ),
        (["play", "bad.onnx"], "surefoot: bad.onnx is not a policy file: not a readable ONNX network"),
        (["play", "--robots", "65", "--port", "0"], "surefoot: robots must be a whole number from 1 to 64, not 65"),
        (["video", "--out", "film.avi"], "surefoot: cannot write 'film.avi': unknown suffix '.avi'; valid: .mp4, .gif"),
        (
            ["video", "--out", "film.mp4", "--size", "321", "240"],
            "surefoot: an .mp4 cannot have 321 x 240 pixels; valid: even numbers",
        ),
        (["video", "--impulse", "-3"], "surefoot: impulse must be a number above 0 up to 100000, not -3.0"),
        (
            ["picture", "--direction", "up"],
            "surefoot: unknown direction 'up'; valid: forward, left, backward, right, degrees",
        ),
        (["picture", "--duration", "nan"], "surefoot: duration must be a number above 0 up to 5, not nan"),
        (
            ["picture", "--body", "nose"],
            "surefoot: unknown body 'nose' of valkyrie; "
            "valid: pelvis, torso, left_thigh, right_thigh, left_shank, right_shank",
        ),
        (
            ["evaluate", "nominal", "--suite", "papr"],
            "surefoot: unknown suite 'papr'; valid: push, paper, robustness, ring, or a scenario file (.toml); "
            "did you mean 'paper'?",
        ),
        (
            ["evaluate", "nominal", "--suite", "knee.toml"],
            "surefoot: knee.toml, scenario 1 (kick): unknown body 'knee' of valkyrie; "
            "valid: pelvis, torso, left_thigh, right_thigh, left_shank, right_shank",
        ),
        (["bench", "--seconds", "inf"], "surefoot: seconds must be a number above 0 up to 3600, not inf"),
    ],
)
def test_bad_input_gets_one_clear_line_and_exit_code_2(arguments: list[str], message: str, tmp_path: Path) -> None:
    (tmp_path / "bad.onnx").write_bytes(b"\x08\x07 this is no network")
    (tmp_path / "empty").mkdir()
    (tmp_path / "other.onnx").write_bytes(policy_of_another_robot())
    (tmp_path / "knee.toml").write_text('[[scenario]]\nname = "kick"\nbody = "knee"\n')
    done = surefoot(*arguments, cwd=tmp_path)
    assert (done.returncode, done.stderr.strip(), done.stdout) == (2, message, "")


def policy_of_another_robot() -> bytes:
    robot = load_robot("valkyrie")
    contract = Contract.of(robot, "bent", 0.6)
    data = network_bytes([(np.zeros((11, 47)), np.zeros(11))], np.zeros(47), np.ones(47), False, contract)
    model = onnx.load_model_from_string(data)
    onnx.helper.set_model_props(model, {METADATA_KEY: contract.to_json().replace('"valkyrie"', '"atlas"')})
    return model.SerializeToString()


def test_evaluate_writes_its_figures_to_standard_output_and_the_rest_to_standard_error(tmp_path: Path) -> None:
    done = surefoot("evaluate", "nominal", "--json", "-", "--export", "trials.csv", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    figures = json.loads(done.stdout)
    four = [figures[f"root_push.{name}"] for name in ("forward", "left", "backward", "right")]
    assert figures["root_push.worst"] == min(four)
    assert figures["root_push.best"] == max(four)
    assert figures["root_push.directions"] == 4
    assert figures["root_push.worst_Ns_per_kg"] == pytest.approx(min(four) / 137.2875, abs=1e-4)
    assert all(impulse % 6.0 == 0.0 for impulse in four)
    assert "Table I" in done.stderr
    assert "Traceback" not in done.stderr
    # The four-direction table has whole trials at each threshold and the trials of every smaller cell.
    num_rows = len((tmp_path / "trials.csv").read_text().splitlines()) - 1
    assert num_rows >= sum(8 * (impulse / 6.0 - 1) + 40 for impulse in four)


def test_directions_are_those_of_the_root_pushes_and_a_files_own_stay_as_they_stand(
    robot: Robot, tmp_path: Path
) -> None:
    paper = {scenario.name: scenario.directions for scenario in chosen_scenarios("paper", 16, robot)}
    turned = ("root_push", "root_push_no_step")
    assert [paper[name] for name in turned] == [paper[f"{name}_within_limits"] for name in turned] == [16, 16]
    assert paper["torso_push"] == 4
    for number, expected in ((None, 16), (8, 8)):
        ring = {scenario.name: scenario.directions for scenario in chosen_scenarios("ring", number, robot)}
        assert ring.pop("quiet") == 1
        assert set(ring.values()) == {expected}
    both = [(scenario.name, scenario.directions) for scenario in chosen_scenarios("push", 8, robot)]
    assert both == [("root_push", 8), ("root_push_within_limits", 8)]
    (tmp_path / "s.toml").write_text('[[scenario]]\nname = "root_push"\nlatency = 0.02\n')
    own, _ = chosen_scenarios(str(tmp_path / "s.toml"), 16, robot)
    assert (own.latency, own.directions) == (0.02, 4)


def test_a_scenario_file_is_evaluated(tmp_path: Path) -> None:
    text = """
        [[scenario]]
        name = "shove"
        search = ""
        directions = ["left", 30]
        impulse = 300
        trials = 2
        horizon = 3
        quiet_from = 1
    """
    (tmp_path / "mine.toml").write_text(text)
    arguments = ("evaluate", "nominal", "--suite", "mine.toml", "--json", "figures.json", "--export", "trials.csv")
    done = surefoot(*arguments, cwd=tmp_path)
    assert (done.returncode, done.stderr.count("Traceback")) == (0, 0)
    with (tmp_path / "trials.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert {(row["scenario"], row["impulse_Ns"], row["reason"]) for row in rows} == {("shove", "300", "fell")}
    assert sorted(float(row["angle_deg"]) for row in rows) == pytest.approx([30, 30, 90, 90])
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert (figures["shove.trials"], figures["shove.recovered"], figures["audit.worst_torque_ratio"]) == (4, 0, 1.0)
    assert "Fixed disturbances" in done.stdout
    assert [line.split() for line in done.stdout.splitlines() if "shove" in line] == [
        ["shove", direction, "0/2", "0/2", "0/2", "0"] for direction in ("left", "30")
    ]


def test_a_results_file_that_is_something_else_is_refused(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("my notes, which no program should overwrite\n" * 50)
    done = surefoot("evaluate", "nominal", "--results", "notes.txt", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith("surefoot: cannot use notes.txt as a results table")
    assert (tmp_path / "notes.txt").read_text().startswith("my notes")
