"""What a user's robot or policy can get wrong, each answered with one line that names the file and the key."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from conftest import TIPTOE
from test_descriptions import change, refusal
from test_foreign import as_mjlab_writes, weights_for, write_network

from surefoot.agents.load import load_agent
from surefoot.errors import UserError
from surefoot.robots import Robot, load_robot


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """A copy of the second robot's description, to be changed."""
    shutil.copytree(TIPTOE.parent, tmp_path / "tiptoe")
    return tmp_path / "tiptoe" / "tiptoe.toml"


@pytest.fixture(scope="module")
def tiptoe() -> Robot:
    return load_robot(TIPTOE)


def answer(name: str, robot: Robot) -> str:
    """What is answered to a policy that is to drive a robot, in one line."""
    with pytest.raises(UserError) as error:
        load_agent(name, robot)
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("torque = 30", "torque = 0", "tiptoe.toml: motor knee_*: torque must be above 0, not 0; a joint without"),
        ("torque = 30", "torque = -3", "tiptoe.toml: motor knee_*: torque must be a number that is not negative"),
        (
            "torque = 30, speed = 14",
            "torque = 30, speed = 0",
            "tiptoe.toml: motor knee_*: speed must be above 0, not 0",
        ),
        (
            "[held]",
            '[ranges]\n"knee_*" = [1.0, -1.0]\n[held]',
            "tiptoe.toml: ranges: knee_* must be two numbers [rad], the smaller one first, not [1.0, -1.0]",
        ),
        ("[held]", '[ranges]\n"elbow_*" = [-1, 1]\n[held]', "tiptoe.toml: ranges: there is no joint 'elbow_*'; valid:"),
        ("[held]", '[held]\nelbow = 0.1\n"x" = 1', "tiptoe.toml: held: there is no joint 'elbow'; valid: waist_yaw"),
        ('"knee_*" = 0.6', '"shin_*" = 0.6', "tiptoe.toml: pose crouched: there is no joint 'shin_*'; valid: waist_"),
        (
            'left_shank = "shank_l"',
            'left_shank = "shin_l"',
            "tiptoe.toml: left_shank: there is no body 'shin_l'; valid",
        ),
        ('torso = { body = "trunk" }', 'torso = { body = "chest" }', "tiptoe.toml: torso: there is no body 'chest'; "),
        (
            'root = "base"',
            'root = "trunk"',
            "tiptoe.toml: root: the body 'trunk' hangs on 'base' and cannot float; name",
        ),
        ('model = "tiptoe.xml"', "model = 3", "tiptoe.toml: model must be a text, not 3"),
        (
            'root = "base"',
            'root = "base"\ncollision_group = 5',
            "tiptoe.toml: collision_group: no shape is in the group 5; valid: 0",
        ),
        (
            'root = "base"',
            'root = "base"\ncollision_group = true',
            "tiptoe.toml: collision_group must be a whole number",
        ),
    ],
)
def test_a_wrong_description_is_answered_with_its_key(copy: Path, old: str, new: str, what: str) -> None:
    change(copy, old, new)
    assert refusal(copy).startswith(what)


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ('<mesh name="shank" file="shank.stl"/>', '<mesh name="shank" file="shin.stl"/>', "shin.stl"),
        ('<body name="base" pos="0 0 0.5">', '<body name="base" pos="0 0 0.5"', "tiptoe.xml"),
    ],
)
def test_a_wrong_model_is_answered_with_its_file(copy: Path, old: str, new: str, what: str) -> None:
    change(copy.parent / "tiptoe.xml", old, new)
    said = refusal(copy)
    assert said.startswith("tiptoe.toml: cannot read the model tiptoe.xml: ")
    assert what in said


def test_a_joint_without_a_range_is_named_and_the_description_may_give_one(copy: Path) -> None:
    text = 'name="knee_l_joint" axis="0 1 0" range="-3 120"'
    change(copy.parent / "tiptoe.xml", text, text.replace(' range="-3 120"', ""))
    assert refusal(copy) == "tiptoe.toml: ranges: the joint 'knee_l_joint' has no range, neither here nor in the model"
    given = copy.parent / "given.toml"
    given.write_text(copy.read_text() + '[ranges]\nknee_l_joint = [-0.05, 2.09]\n"knee_r*" = [-0.05, 2.09]\n')
    robot = load_robot(given)
    knees = [robot.joint_names.index(f"knee_{side}_joint") for side in "lr"]
    # The model's own are in degrees; those of the description are not.
    np.testing.assert_allclose(robot.joint_lower[knees], -0.05)
    np.testing.assert_allclose(robot.joint_upper[knees], 2.09)
    assert robot.is_symmetric


def test_a_range_that_is_upside_down_is_named(copy: Path) -> None:
    text = 'name="knee_l_joint" axis="0 1 0" range="-3 120"'
    change(copy.parent / "tiptoe.xml", text, text.replace("-3 120", "120 -3"))
    said = refusal(copy)
    assert said == "tiptoe.toml: ranges: the joint 'knee_l_joint' goes from 120 down to -3 in the model"


def test_a_root_without_a_free_joint_gets_one(copy: Path) -> None:
    # The second robot's file has none.
    assert "freejoint" not in (copy.parent / "tiptoe.xml").read_text()
    model = load_robot(copy).model()
    assert (int(model.jnt_type[0]), model.nq - model.nv) == (0, 1)


def test_a_root_that_slides_is_named(copy: Path) -> None:
    body = '<body name="base" pos="0 0 0.5">'
    change(copy.parent / "tiptoe.xml", body, body + '<joint name="lift" type="slide" axis="0 0 1"/>')
    assert refusal(copy) == "tiptoe.toml: root: the body 'base' must have a free joint and no other"


def test_a_policy_of_ours_for_another_robot_is_named_with_both(tiptoe: Robot) -> None:
    said = answer("ddpg", tiptoe)
    assert said == f"ddpg is a policy for valkyrie, not for {tiptoe.name}"


def test_a_foreign_policy_that_knows_other_joints_is_named_with_the_first(tmp_path: Path, tiptoe: Robot) -> None:
    order = np.arange(tiptoe.num_joints)
    names = ",".join(["left_hip_pitch_joint", *tiptoe.joint_names[1:]])
    file = write_network(tmp_path / "p.onnx", weights_for(tiptoe), as_mjlab_writes(tiptoe, order, joint_names=names))
    said = answer(str(file), tiptoe)
    assert said.startswith(f"{file}: joint_names: ")
    assert "'left_hip_pitch_joint'" in said


def test_a_foreign_network_of_other_sizes_is_named_with_both(tmp_path: Path, tiptoe: Robot) -> None:
    # Turning, gravity and the command have 3 numbers each, angles, speeds and actions one for each of 13 joints.
    order = np.arange(tiptoe.num_joints)
    file = write_network(tmp_path / "p.onnx", weights_for(tiptoe, 40), as_mjlab_writes(tiptoe, order))
    said = answer(str(file), tiptoe)
    assert str(file) in said
    assert "40" in said
    assert "48" in said
