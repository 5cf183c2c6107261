"""Golden vectors and the terms of a policy file: a stranger's runtimes compute what surefoot does."""

from __future__ import annotations

import csv
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import onnx
import pytest
from scipy.spatial.transform import Rotation

from surefoot.agents.load import load_policy
from surefoot.agents.network import NetworkAgent
from surefoot.agents.policy_file import TERMS_KEY, mean_bytes, with_record, with_terms
from surefoot.cli.export import Export
from surefoot.errors import UserError
from surefoot.robots import Robot, load_robot
from surefoot.robots.model import SOLES, TORSO
from surefoot.task.contract import Contract
from surefoot.task.terms import terms

ROOT = Path(__file__).parent.parent
DEPLOY = ROOT / "examples" / "deploy"
PAGE = (ROOT / "docs" / "policy-file.md").read_text()
POLICIES = ("ppo", "best")
"""Without a past, and a mixture with one. Actions of both leave [-1, 1] in the run."""


@pytest.fixture(scope="module", params=POLICIES, ids=["ppo", "mixture"])
def exported(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("export")
    Export(request.param, onnx=folder / "policy.onnx", vectors=folder / "vectors.csv").main()
    return folder


def run(*command: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=120)


def spoilt(folder: Path, column: str) -> Path:
    """The vectors with one number of a column off by 0.5 in the middle of the run."""
    with (folder / "vectors.csv").open(newline="") as stream:
        header, *rows = csv.reader(stream)
    place = next(i for i, name in enumerate(header) if name.startswith(column))
    rows[250][place] = repr(float(rows[250][place]) + 0.5)
    path = folder / f"spoilt-{column}.csv"
    with path.open("w", newline="") as stream:
        csv.writer(stream, lineterminator="\n").writerows([header, *rows])
    return path


# The runtimes.


def test_the_python_runtime_finds_every_golden_number(exported: Path) -> None:
    done = run(sys.executable, DEPLOY / "runtime.py", exported / "policy.onnx", exported / "vectors.csv")
    assert done.returncode == 0, done.stdout + done.stderr
    assert re.search(r"^latency of a tick: median \d+ us, 99 % \d+ us, largest \d+ us$", done.stdout, re.MULTILINE)
    assert "jitter" in done.stdout


@pytest.mark.parametrize("column", ["observation", "filtered", "action", "target", "torque"])
def test_a_number_that_is_off_is_noticed(exported: Path, column: str) -> None:
    done = run(
        sys.executable, DEPLOY / "runtime.py", exported / "policy.onnx", spoilt(exported, f"{column}."), "--fast"
    )
    assert done.returncode == 1
    assert f"{column}: largest difference 5.0e-01" in done.stdout


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    compiler = shutil.which("g++") or shutil.which("clang++")
    if not compiler:
        pytest.skip("there is no C++ compiler")
    program = tmp_path_factory.mktemp("cpp") / "runtime"
    built = run(compiler, "-O1", "-std=c++17", "-Wall", "-Wextra", "-Werror", DEPLOY / "runtime.cpp", "-o", program)
    assert built.returncode == 0, built.stderr
    return program


def test_the_cpp_runtime_finds_every_golden_number(exported: Path, program: Path) -> None:
    flat = exported / "policy.txt"
    assert run(sys.executable, DEPLOY / "flatten.py", exported / "policy.onnx", flat).returncode == 0
    done = run(program, flat, exported / "vectors.csv")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "latency of a tick" in done.stdout
    for column in ("observation", "action", "torque"):
        assert run(program, flat, spoilt(exported, f"{column}."), "--fast").returncode == 1


def test_the_runtimes_import_nothing_of_surefoot() -> None:
    for name, allowed in (("runtime.py", {"numpy", "onnxruntime"}), ("flatten.py", {"onnx"})):
        imports = re.findall(r"^(?:import|from) (\w+)", (DEPLOY / name).read_text(), re.MULTILINE)
        assert set(imports) - set(sys.stdlib_module_names) == allowed


def test_every_column_is_on_the_page(exported: Path) -> None:
    with (exported / "vectors.csv").open(newline="") as stream:
        words = {name.partition(".")[0] for name in next(csv.reader(stream))}
    page = set(re.findall(r"`(\w+)(?:\.\*|\.left)?`", PAGE.split("## Golden vectors")[1]))
    assert words <= page


def test_the_vectors_are_those_of_a_robot_that_is_pushed_twice(exported: Path) -> None:
    with (exported / "vectors.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [int(float(row["tick"])) for row in rows] == list(range(-1, 1000))
    assert np.isnan(float(rows[0]["action.left_knee_pitch"]))
    speed = [float(row["com_velocity.y"]) for row in rows]
    # 90 Ns at 60 degrees from tick 100 to 160: 137.3 kg get at most 90 sin 60 / 137.3 = 0.57 m/s to the left.
    assert max(map(abs, speed[:101])) < 0.1
    assert 0.3 < speed[161] < 0.6
    assert min(float(row["com_position.z"]) for row in rows[:600]) > 0.9
    # 700 Ns at 200 degrees from tick 600 to 660: 700 cos 20 / 137.3 = 4.8 m/s backward, less what the feet hold.
    assert float(rows[661]["com_velocity.x"]) < -3.0


def test_the_vectors_reach_every_limit_of_the_loop(exported: Path) -> None:
    """Actions beyond [-1, 1], joints beyond their speed limit, and torques at theirs."""
    policy = load_policy(exported / "policy.onnx")
    header, *rows = (exported / "vectors.csv").read_text().splitlines()
    values = np.array([row.split(",") for row in rows[1:]], float)
    parts = {word: [name.startswith(word) for name in header.split(",")] for word in ("action", "joint_vel", "torque")}
    assert np.abs(values[:, parts["action"]]).max() > 1.2
    assert (np.abs(values[:, parts["joint_vel"]]) / policy.contract.velocity_limit).max() > 1.2
    assert (np.abs(values[:, parts["torque"]]) / policy.contract.torque_limit).max() == pytest.approx(1.0)


# The terms.


@pytest.fixture(scope="module", params=["valkyrie", "g1"])
def told(request: pytest.FixtureRequest) -> tuple[Robot, dict]:
    robot = load_robot(request.param)
    return robot, json.loads(json.dumps(terms(robot, Contract.of(robot, robot.default_pose, 0.5))))


def test_points_masses_axes_and_ranges_of_the_terms_are_the_models(told: tuple[Robot, dict]) -> None:
    """By forward kinematics from the terms alone, with turned joints."""
    robot, found = told
    model = robot.model()
    data = mujoco.MjData(model)
    angles = robot.joint_lower + 0.3 * (robot.joint_upper - robot.joint_lower)
    data.qpos[7:] = angles
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    joints = {joint["body"]: (joint, angle) for joint, angle in zip(found["joints"], angles, strict=True)}
    turns, places = {}, {}
    for body in found["bodies"]:
        turn = Rotation.from_quat(body["quaternion"], scalar_first=True)
        place = np.array(body["place"])
        if body["name"] == found["root"]:
            turn, place = Rotation.identity(), data.xpos[1]
        elif parent := turns.get(body["parent"]):
            place, turn = places[body["parent"]] + parent.apply(place), parent * turn
        if body["name"] in joints:
            joint, angle = joints[body["name"]]
            own = Rotation.from_rotvec(angle * np.array(joint["axis"]))
            place = place + turn.apply(np.array(joint["anchor"]) - own.apply(joint["anchor"]))
            np.testing.assert_allclose(turn.apply(joint["axis"]), data.xaxis[model.joint(joint["name"]).id], atol=1e-9)
            assert joint["parent"] == body["parent"]
            turn = turn * own
        turns[body["name"]], places[body["name"]] = turn, place
    for point, name in ((found["torso"], TORSO), *zip(found["soles"], SOLES, strict=True)):
        reached = places[point["body"]] + turns[point["body"]].apply(point["place"])
        np.testing.assert_allclose(reached, data.site(name).xpos, atol=1e-9)
    centres = [places[body["name"]] + turns[body["name"]].apply(body["centre_of_mass"]) for body in found["bodies"]]
    masses = [body["mass"] for body in found["bodies"]]
    np.testing.assert_allclose(np.average(centres, axis=0, weights=masses), data.subtree_com[1], atol=1e-9)
    assert sum(masses) == pytest.approx(found["mass"], abs=1e-9)
    limits = [(joint["lower"], joint["upper"]) for joint in found["joints"]]
    np.testing.assert_array_equal(limits, np.column_stack([robot.joint_lower, robot.joint_upper]))
    np.testing.assert_array_equal([joint["armature"] for joint in found["joints"]], model.dof_armature[6:])
    assert found["held_joints"] == robot.held_joints
    assert (len(found["held_joints"]) > 0) == (robot.name == "g1")


def test_every_term_and_every_clause_is_on_the_page(told: tuple[Robot, dict]) -> None:
    _, found = told
    named = set(re.findall(r"`([\w.]+)`", PAGE))
    assert "version" in named
    for key, value in found.items():
        assert key in named or {f"{key}.{part}" for part in value} <= named, key
    assert set(found["bodies"][0]) | set(found["joints"][0]) | set(found["torso"]) | set(found["soles"][0]) <= named
    assert set(Contract.__dataclass_fields__) <= named


def test_every_file_that_is_written_has_its_terms_and_the_same_network() -> None:
    policy = load_policy("ddpg")
    old = onnx.load_model_from_string(policy.data)
    assert TERMS_KEY not in {pair.key for pair in old.metadata_props}
    observations = np.random.default_rng(0).normal(size=(4, 47))
    for data in (with_terms(policy.data), with_record(policy.data, note="x"), mean_bytes([policy.data] * 2)):
        model = onnx.load_model_from_string(data)
        found = {pair.key: pair.value for pair in model.metadata_props}
        assert json.loads(found[TERMS_KEY]) == json.loads(json.dumps(terms(policy.robot, policy.contract)))
        renewed = NetworkAgent(data, "again")
        assert renewed.contract.joints == policy.contract.joints
        np.testing.assert_array_equal(renewed.actions(observations), policy.actions(observations))


# The command.


def test_the_command_names_what_is_wrong(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"^nothing to export; name a file by --onnx, --vectors or --weights$"):
        Export("ddpg").main()
    with pytest.raises(UserError, match=r"^--vectors must be a \.csv file, not run\.json$"):
        Export("ddpg", vectors=Path("run.json")).main()
    with pytest.raises(UserError, match=r"cannot write .*none.*: No such file or directory; what"):
        Export("ddpg", vectors=tmp_path / "none" / "run.csv").main()
    with pytest.raises(UserError, match="shipped policies: best, ddpg"):
        Export("nobody", onnx=tmp_path / "x.onnx").main()
