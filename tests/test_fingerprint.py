"""The fingerprint of a model: what its physics depends on changes it, and nothing else does."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import pytest

from surefoot.robots import Robot
from surefoot.robots.fingerprint import model_fingerprint

MODEL = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 1"/>
    <body name="trunk" pos="0 0 1">
      <freejoint/>
      <geom name="box" type="box" size=".1 .1 .1" mass="2"/>
      <geom name="shell" type="sphere" size=".2" contype="0" conaffinity="0" mass="0" rgba="1 0 0 1"/>
      <body name="leg" pos="0 0 -.2">
        <joint name="hip" axis="0 1 0" range="-1 1" damping=".1"/>
        <geom name="shin" type="capsule" size=".05 .1" mass="1"/>
      </body>
    </body>
  </worldbody>
  <actuator><position name="motor" joint="hip" kp="100" kv="5" forcerange="-50 50"/></actuator>
  <sensor><jointpos name="hip_angle" joint="hip"/></sensor>
</mujoco>
"""


def fingerprint(text: str) -> str:
    return model_fingerprint(mujoco.MjModel.from_xml_string(text))


def changed(old: str, new: str) -> str:
    assert old in MODEL
    return fingerprint(MODEL.replace(old, new))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('mass="1"', 'mass="1.01"'),
        ('size=".1 .1 .1"', 'size=".1 .1 .11"'),
        ('pos="0 0 -.2"', 'pos="0 0 -.21"'),
        ('axis="0 1 0"', 'axis="1 0 0"'),
        ('range="-1 1"', 'range="-1 1.1"'),
        ('damping=".1"', 'damping=".2"'),
        ('kp="100"', 'kp="101"'),
        ('forcerange="-50 50"', 'forcerange="-50 51"'),
        ('timestep="0.002"', 'timestep="0.001"'),
        ('timestep="0.002"', 'timestep="0.002" cone="elliptic"'),
        ('mass="2"', 'mass="2" friction="0.5"'),
        ('mass="2"', 'mass="2" condim="4"'),
    ],
)
def test_what_the_physics_depends_on_counts(old: str, new: str) -> None:
    assert changed(old, new) != fingerprint(MODEL)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('rgba="1 0 0 1"', 'rgba="0 1 0 1"'),
        ('name="shell" type="sphere" size=".2"', 'name="skin" type="box" size=".2 .3 .4"'),
        ("<worldbody>", "<!-- a comment --><worldbody>"),
        ('<jointpos name="hip_angle" joint="hip"/>', '<jointvel name="hip_speed" joint="hip"/>'),
        ('name="box"', 'name="crate"'),
        ('mass="2"', 'mass="2.0000000000001"'),
    ],
)
def test_colours_names_comments_sensors_and_the_last_digits_do_not_count(old: str, new: str) -> None:
    assert changed(old, new) == fingerprint(MODEL)


def test_the_order_of_the_shapes_does_not_count() -> None:
    floor = '<geom name="floor" type="plane" size="1 1 1"/>'
    wall = '<geom name="wall" type="plane" size="1 1 1" zaxis="1 0 0" pos="-2 0 0"/>'
    assert changed(floor, floor + wall) == changed(floor, wall + floor)


def test_the_robot_is_the_same_with_and_without_its_looks(robot: Robot) -> None:
    assert robot.fingerprint == model_fingerprint(robot.model()) == model_fingerprint(robot.model(visual=True))


@pytest.mark.parametrize(
    "change",
    [
        lambda model: model.body_mass.__imul__(1.001),
        lambda model: model.geom_friction.__imul__(1.1),
        lambda model: model.actuator_gainprm.__imul__(1.001),
    ],
    ids=["masses", "friction", "motors"],
)
def test_another_robot_of_the_same_name_has_another_fingerprint(
    robot: Robot, change: Callable[[mujoco.MjModel], object]
) -> None:
    model = robot.model()
    change(model)
    assert model_fingerprint(model) != robot.fingerprint
