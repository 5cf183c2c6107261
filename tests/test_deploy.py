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
POLICIES = ("ddpg", str(ROOT / "results" / "least-motion" / "student-memory.onnx"))
"""Without a past, and with one."""


@pytest.fixture(scope="module", params=POLICIES, ids=["ddpg", "student-memory"])
def exported(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("export")
    Export(request.param, onnx=folder / "policy.onnx", vectors=folder / "vectors.csv").main()
    return folder


def run(*command: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=120)


def spoilt(folder: Path, column: str) -> Path:
    """The vectors with one number of a column off by 0.1 in the middle of the run."""
    with (folder / "vectors.csv").open(newline="") as stream:
        header, *rows = csv.reader(stream)
    place = next(i for i, name in enumerate(header) if name.startswith(column))
    rows[250][place] = repr(float(rows[250][place]) + 0.1)
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
    assert f"{column}: largest difference 1.0e-01" in done.stdout


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


def test_the_vectors_are_those_of_a_robot_that_is_pushed_and_stands(exported: Path) -> None:
    with (exported / "vectors.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [int(float(row["tick"])) for row in rows] == list(range(-1, 500))
    assert np.isnan(float(rows[0]["action.left_knee_pitch"]))
    speed = [float(row["com_velocity.y"]) for row in rows]
    # 90 Ns at 60 degrees from tick 100 to 160: 137.3 kg get at most 90 sin 60 / 137.3 = 0.57 m/s to the left.
    assert max(map(abs, speed[:101])) < 0.1
    assert 0.3 < speed[161] < 0.6
    assert min(float(row["com_position.z"]) for row in rows) > 0.9


# The terms.


@pytest.fixture(scope="module", params=["valkyrie", "g1"])
def told(request: pytest.FixtureRequest) -> tuple[Robot, dict]:
    robot = load_robot(request.param)
    return robot, json.loads(json.dumps(terms(robot, Contract.of(robot, robot.default_pose, 0.5))))


def test_points_axes_and_ranges_of_the_terms_are_the_models(told: tuple[Robot, dict]) -> None:
    """By kinematics from the terms alone, for points and axes with turned joints."""
    robot, found = told
    model = robot.model()
    data = mujoco.MjData(model)
    data.qpos[7:] = 0.5 * (robot.joint_lower + robot.joint_upper)
    mujoco.mj_kinematics(model, data)
    for place, name in ((found["torso"], TORSO), *zip(found["soles"], SOLES, strict=True)):
        body = model.body(place["body"]).id
        point = data.xpos[body] + data.xmat[body].reshape(3, 3) @ place["place"]
        np.testing.assert_allclose(point, data.site(name).xpos, atol=1e-9)
    for joint, number in zip(found["joints"], range(robot.num_joints), strict=True):
        body = model.body(joint["body"]).id
        axis = data.xmat[body].reshape(3, 3) @ joint["axis"]
        np.testing.assert_allclose(axis, data.xaxis[model.joint(joint["name"]).id], atol=1e-9)
        assert (joint["lower"], joint["upper"]) == (robot.joint_lower[number], robot.joint_upper[number])
        assert joint["parent"] == model.body(int(model.body_parentid[body])).name
    armatures = [joint["armature"] for joint in found["joints"]]
    np.testing.assert_array_equal(armatures, model.dof_armature[6:])
    assert found["held_joints"] == robot.held_joints
    assert (len(found["held_joints"]) > 0) == (robot.name == "g1")


def test_every_term_and_every_clause_is_on_the_page(told: tuple[Robot, dict]) -> None:
    _, found = told
    named = set(re.findall(r"`([\w.]+)`", PAGE))
    assert "version" in named
    for key, value in found.items():
        assert key in named or {f"{key}.{part}" for part in value} <= named, key
    assert set(found["joints"][0]) | set(found["torso"]) <= named
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
    with pytest.raises(UserError, match=r"^nothing to export; name a file by --onnx or --vectors$"):
        Export("ddpg").main()
    with pytest.raises(UserError, match=r"^--vectors must be a \.csv file, not run\.json$"):
        Export("ddpg", vectors=Path("run.json")).main()
    with pytest.raises(UserError, match=r"cannot write .*none.*: No such file or directory; what"):
        Export("ddpg", vectors=tmp_path / "none" / "run.csv").main()
    with pytest.raises(UserError, match="shipped policies: best, ddpg"):
        Export("nobody", onnx=tmp_path / "x.onnx").main()
