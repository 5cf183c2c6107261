"""Descriptions of robots: what is understood of one outside the package, and what is answered to a wrong one."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from conftest import TIPTOE

from surefoot.errors import UserError
from surefoot.evaluation.protocol import PROTOCOL, protocol_for
from surefoot.physics.mujoco_engine import MujocoEngine
from surefoot.physics.step_record import StepRecord
from surefoot.robots import Robot, load_robot
from surefoot.task import observation

SIDES = ("hip_yaw", "hip_roll", "hip_pitch", "knee", "ankle_pitch", "ankle_roll")


@pytest.fixture(scope="module")
def tiptoe() -> Robot:
    return load_robot(TIPTOE)


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """A copy of the second robot's description, to be changed."""
    shutil.copytree(TIPTOE.parent, tmp_path / "tiptoe")
    return tmp_path / "tiptoe" / "tiptoe.toml"


def change(file: Path, old: str, new: str) -> None:
    """Replace a text that the file has just once."""
    text = file.read_text()
    assert text.count(old) == 1, old
    file.write_text(text.replace(old, new))


def refusal(file: Path) -> str:
    """What is answered to a description, in one line and without its path."""
    with pytest.raises(UserError) as error:
        load_robot(file)
    assert "\n" not in str(error.value)
    return str(error.value).replace(f"{file.parent}/", "")


def pushed(robot: Robot, impulse: np.ndarray, body: str = "root", num_steps: int = 30) -> StepRecord:
    """The robot holds its default pose and gets a push of 0.12 s after 0.2 s: all its ticks."""
    engine = MujocoEngine(robot, 1, num_threads=1)
    engine.reset(np.array([0]), robot.pose()[None])
    engine.joint_targets[:] = robot.pose()
    records = []
    for step in range(num_steps):
        engine.wrench[0, :, robot.body_id(body), :3] = impulse / 0.12 if 5 <= step < 8 else 0.0
        records.append(engine.step().copy())
    return StepRecord.join(records)


# What is understood.


def test_joints_with_a_motor_are_controlled_and_all_others_are_welded(tiptoe: Robot) -> None:
    assert list(tiptoe.joint_names) == ["waist_yaw_joint", *(f"{joint}_{s}_joint" for s in "lr" for joint in SIDES)]
    model = tiptoe.model()
    assert model.nu == 13
    assert model.nq == 7 + 13
    assert model.nsensor == 0  # the engine adds its own, those of the file are gone


def test_a_welded_joint_stands_at_its_angle(tiptoe: Robot) -> None:
    model = tiptoe.model()
    # A turn of 0.2 rad about y: (cos 0.1, 0, sin 0.1, 0).
    for arm in ("arm_l", "arm_r"):
        np.testing.assert_allclose(model.body(arm).quat, [np.cos(0.1), 0.0, np.sin(0.1), 0.0], atol=1e-12)


def test_the_mirror_comes_from_the_axes_and_not_from_the_names(tiptoe: Robot) -> None:
    names = tiptoe.joint_names
    image = {
        name: (names[s], sign) for name, s, sign in zip(names, tiptoe.mirror_source, tiptoe.mirror_sign, strict=True)
    }
    assert image["waist_yaw_joint"] == ("waist_yaw_joint", -1.0)
    assert image["hip_yaw_l_joint"] == ("hip_yaw_r_joint", -1.0)
    # Its axis is -x on the left and +x on the right: the same angle on both sides is a mirror image.
    assert image["hip_roll_l_joint"] == ("hip_roll_r_joint", 1.0)
    assert image["ankle_roll_r_joint"] == ("ankle_roll_l_joint", -1.0)
    assert image["knee_l_joint"] == ("knee_r_joint", 1.0)
    assert tiptoe.joint_groups[1] == tiptoe.joint_groups[7] == "hip_yaw_joint"
    assert tiptoe.mirror_body("left_shank") == "right_shank"
    assert tiptoe.mirror_body("trunk") == "trunk"
    assert [tiptoe.side(word) for word in ("left_shank", "right_shank", "trunk")] == [1, -1, 0]


def test_soles_masses_and_scales_are_measured_on_the_model(tiptoe: Robot) -> None:
    # Spheres at x = 0.09 and capsules from -0.04, both at y = +-0.03: half sizes 0.065 and 0.03.
    np.testing.assert_allclose(tiptoe.sole_half_size, [0.065, 0.03], atol=1e-9)
    # Base 2.2, trunk 2.4, arms 2 x 0.25, legs 2 x (0.2 + 0.2 + 0.5 + 0.3 + 0.25) kg.
    assert tiptoe.mass == pytest.approx(8.0)
    # From the yaw joint down: 0.02 + 0.2 + 0.2 + 0.035 m.
    assert tiptoe.leg_length == pytest.approx(0.455)


def test_forces_and_impulses_are_scaled_by_the_mass_and_lengths_by_the_legs(tiptoe: Robot) -> None:
    protocol = protocol_for(tiptoe)
    # 50 N x 8 / 137.29 = 2.9 N, so 3 N for 0.12 s; 150 cells as for the paper's robot.
    assert (protocol.impulse_step, protocol.impulse_end) == (0.36, 54.0)
    # 3 cm of 0.986 m scaled to 0.455 m are 14 mm; 100 N x 8 / 137.29 = 5.83 N.
    assert protocol.step_length == 0.014
    assert protocol.loaded_force == pytest.approx(5.827, abs=1e-3)


def test_the_protocol_of_the_papers_robot_is_the_protocol_itself(robot: Robot) -> None:
    assert protocol_for(robot) == PROTOCOL


def test_the_floor_is_ours_and_not_the_files_slippery_one(tiptoe: Robot) -> None:
    model = tiptoe.model()
    planes = [model.geom(g) for g in range(model.ngeom) if model.geom(g).type[0] == 0]
    assert [plane.name for plane in planes] == ["floor"]
    assert planes[0].friction[0] == 1.0


def test_the_second_robot_stands_on_its_spheres_and_capsules(tiptoe: Robot) -> None:
    ticks = pushed(tiptoe, np.zeros(3), num_steps=250)
    # 8 kg x 9.81 / 2 on each foot.
    np.testing.assert_allclose(ticks.foot_force[0, -1], 39.24, rtol=1e-3)
    assert not ticks.non_foot_contact.any()
    assert ticks.torso_uprightness[0, -1] > np.cos(np.radians(2.0))
    assert np.abs(ticks.com_velocity[0, -1]).max() < 1e-3


@pytest.mark.parametrize(("body", "image"), [("root", "root"), ("left_shank", "right_shank")])
def test_a_mirrored_push_gives_the_mirrored_motion(tiptoe: Robot, body: str, image: str) -> None:
    left = pushed(tiptoe, np.array([0.4, 0.9, 0.1]), body)
    right = pushed(tiptoe, np.array([0.4, -0.9, 0.1]), image)
    source, sign = observation.mirror(tiptoe)
    seen, mirrored = (observation.observe(ticks) for ticks in (left, right))
    np.testing.assert_allclose(sign * seen[..., source], mirrored, atol=1e-9)
    assert np.abs(left.com_velocity[..., 1]).max() > 0.01


def test_a_fingerprint_tells_physical_facts_and_no_looks(tiptoe: Robot, copy: Path) -> None:
    model = copy.parent / "tiptoe.xml"
    change(model, '<geom type="box" size="0.05 0.08 0.04"/>', '<geom type="box" size="0.05 0.08 0.04" rgba="1 0 0 1"/>')
    assert load_robot(copy).fingerprint == tiptoe.fingerprint
    heavier = copy.parent / "heavier.toml"
    shutil.copy(copy, heavier)
    change(heavier, "torque = 30", "torque = 31")
    assert load_robot(heavier).fingerprint != tiptoe.fingerprint


# What is answered to a wrong one.


def test_a_wrong_key_is_answered_with_the_valid_ones(copy: Path) -> None:
    change(copy, 'title = "Tiptoe"', 'titel = "Tiptoe"')
    assert refusal(copy).startswith("tiptoe.toml: unknown key 'titel'; valid: model, title, root")


def test_a_missing_key_is_named(copy: Path) -> None:
    change(copy, 'root = "base"\n', "")
    assert refusal(copy) == "tiptoe.toml: key 'root' is needed"


def test_a_joint_that_is_not_there_is_answered_with_those_that_are(copy: Path) -> None:
    change(copy, '"hip_yaw_*" =', '"hip_twist_*" =')
    assert refusal(copy).startswith(
        "tiptoe.toml: motors: there is no joint 'hip_twist_*'; valid: waist_yaw_joint, arm_l"
    )


def test_a_body_that_is_not_there_is_answered_with_those_that_are(copy: Path) -> None:
    change(copy, 'left = "foot_l"', 'left = "paw_l"')
    assert refusal(copy).startswith("tiptoe.toml: left foot: there is no body 'paw_l'; valid: base, trunk, arm_l")


def test_a_motor_without_a_speed_limit_is_named(copy: Path) -> None:
    change(copy, "torque = 30, speed = 14", "torque = 30")
    assert refusal(copy) == "tiptoe.toml: motor knee_l_joint: key 'speed' is needed"


def test_a_foot_without_a_shape_that_touches_is_named(copy: Path) -> None:
    change(copy, 'left = "foot_l"', 'left = "thigh_yaw_l"')
    assert refusal(copy) == "tiptoe.toml: feet: the body 'thigh_yaw_l' has no geom that can touch the floor"


@pytest.mark.parametrize(
    ("old", "new", "answer"),
    [
        ('knee_r_joint" axis="0 1 0" range="-3 120"', 'knee_r_joint" axis="0 1 0" range="-3 110"', "the ranges of"),
        (
            'name="shank_r" pos="0 0 -0.2"',
            'name="shank_r" pos="0 0.01 -0.2"',
            "joint 'knee_l_joint' has no mirror image",
        ),
    ],
)
def test_a_lopsided_model_learns_without_a_mirror_and_says_so_unless_the_description_waives_or_asks_for_it(
    copy: Path, old: str, new: str, answer: str, capsys: pytest.CaptureFixture[str]
) -> None:
    change(copy.parent / "tiptoe.xml", old, new)
    assert not load_robot(copy).is_symmetric
    told = capsys.readouterr().err
    assert answer in told
    assert "learns without a mirror" in told
    waived = copy.parent / "waived.toml"
    waived.write_text("symmetric = false\n" + copy.read_text())
    assert not load_robot(waived).is_symmetric
    assert capsys.readouterr().err == ""
    asked = copy.parent / "asked.toml"
    asked.write_text("symmetric = true\n" + copy.read_text())
    assert answer in refusal(asked)


def test_a_missing_mesh_is_named_in_one_line(copy: Path) -> None:
    (copy.parent / "shank.stl").unlink()
    assert "shank.stl" in refusal(copy)


def test_a_missing_model_and_a_missing_description_are_named(copy: Path) -> None:
    (copy.parent / "tiptoe.xml").unlink()
    assert refusal(copy) == "tiptoe.toml: model: there is no file tiptoe.xml"
    assert refusal(copy.parent / "nobody.toml") == "cannot read robot nobody.toml: No such file or directory"


@pytest.mark.parametrize(
    ("line", "answer"),
    [
        ("own_actuators = 1", "own_actuators must be true or false, not 1"),
        ('load_unit = "much"', "load_unit must be a number, not much"),
        ("root = ", "cannot read robot"),
        ('default_pose = "upright"', "unknown default_pose 'upright'; valid: crouched"),
        ("x = " + 3000 * "[" + 3000 * "]", "its TOML is nested too deeply"),
        (f"load_unit = {10**400}", "load_unit must be a number, not a whole number of more than 60 digits"),
        (f'unknown{3000 * "x"} = "x"', f"unknown key 'unknown{53 * 'x'}...'"),
    ],
)
def test_a_value_of_the_wrong_kind_is_named(copy: Path, line: str, answer: str) -> None:
    copy.write_text(line + "\n" + copy.read_text())
    assert answer in refusal(copy)


@pytest.mark.parametrize(
    ("before", "after", "answer"),
    [
        ('name="ankle_pitch_l_joint"', "", "a hinge of the model, or the body that it turns, has no name"),
        ('name="thigh_roll_l"', "", "a hinge of the model, or the body that it turns, has no name"),
        ('pos="', 'pos="nan 0 0" user="', "that is not finite"),
    ],
)
def test_a_model_that_no_robot_can_be_made_of_is_named(copy: Path, before: str, after: str, answer: str) -> None:
    file = copy.parent / "tiptoe.xml"
    text = file.read_text()
    assert before in text
    file.write_text(text.replace(before, after, 1))
    assert answer in refusal(copy)


def test_gains_may_come_from_the_files_own_actuators(copy: Path) -> None:
    actuators = "".join(
        f'<position joint="ankle_{axis}_{side}_joint" kp="77" kv="2" forcerange="-9 9"/>'
        for side in "lr"
        for axis in ("pitch", "roll")
    )
    change(copy.parent / "tiptoe.xml", "  <sensor>", f"  <actuator>{actuators}</actuator>\n  <sensor>")
    change(copy, '"ankle_*" = { stiffness = 80, damping = 2.5, torque = 14, speed = 14 }', '"ankle_*" = { speed = 14 }')
    copy.write_text("own_actuators = true\n" + copy.read_text())
    robot = load_robot(copy)
    ankle = robot.joint_names.index("ankle_roll_r_joint")
    assert (robot.stiffness[ankle], robot.damping[ankle], robot.torque_limit[ankle]) == (77.0, 2.0, 9.0)
    knee = robot.joint_names.index("knee_r_joint")
    assert robot.stiffness[knee] == 150.0
