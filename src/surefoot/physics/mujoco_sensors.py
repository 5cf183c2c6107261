"""MuJoCo's sensors for the quantities of a `StepRecord`, in the order of its layout."""

from __future__ import annotations

import mujoco

from surefoot.robots import Robot
from surefoot.robots.domain import DomainParameters
from surefoot.robots.model import FLOOR, SOLES, TORSO, compile_model

_SENSOR = mujoco.mjtSensor
_OBJECT = mujoco.mjtObj
_CONTACT_DATA = {"found": 0, "force": 1, "torque": 2, "dist": 3, "pos": 4, "normal": 5, "tangent": 6}
_NET_FORCE = 3
"""How a contact sensor reduces several contacts to one: their net wrench at the pressure centre."""


def model_with_sensors(robot: Robot, domain: DomainParameters) -> mujoco.MjModel:
    """Compile a robot's model in a world, with a sensor for every quantity of the record."""
    spec = robot.build()
    add_sensors(spec, robot)
    return compile_model(spec, domain)


def add_sensors(spec: mujoco.MjSpec, robot: Robot) -> None:
    """Add a sensor for every quantity, so that ``sensordata`` is a row of the record."""
    _add_joint_sensors(spec, robot)
    _add_body_sensors(spec, robot)
    _add_foot_sensors(spec, robot)


def _add_joint_sensors(spec: mujoco.MjSpec, robot: Robot) -> None:
    kinds = {
        "joint_position": _SENSOR.mjSENS_JOINTPOS,
        "joint_velocity": _SENSOR.mjSENS_JOINTVEL,
        "joint_torque": _SENSOR.mjSENS_JOINTACTFRC,
    }
    for quantity, kind in kinds.items():
        for i, joint in enumerate(robot.joint_names):
            spec.add_sensor(name=f"{quantity}_{i}", type=kind, objtype=_OBJECT.mjOBJ_JOINT, objname=joint)


def _add_body_sensors(spec: mujoco.MjSpec, robot: Robot) -> None:
    def of_body(name: str, kind: mujoco.mjtSensor, body: str = robot.root) -> None:
        spec.add_sensor(name=name, type=kind, objtype=_OBJECT.mjOBJ_XBODY, objname=body)

    def of_site(name: str, site: str) -> None:
        spec.add_sensor(name=name, type=_SENSOR.mjSENS_FRAMEPOS, objtype=_OBJECT.mjOBJ_SITE, objname=site)

    def of_subtree(name: str, kind: mujoco.mjtSensor) -> None:
        spec.add_sensor(name=name, type=kind, objtype=_OBJECT.mjOBJ_BODY, objname=robot.root)

    def vertical(name: str, body: str) -> None:
        """The world's z axis as the body sees it: all of roll and pitch."""
        spec.add_sensor(
            name=name,
            type=_SENSOR.mjSENS_FRAMEZAXIS,
            objtype=_OBJECT.mjOBJ_XBODY,
            objname="world",
            reftype=_OBJECT.mjOBJ_XBODY,
            refname=body,
        )

    of_body("root_orientation", _SENSOR.mjSENS_FRAMEQUAT)
    of_body("root_forward", _SENSOR.mjSENS_FRAMEXAXIS)
    vertical("root_up", robot.root)
    vertical("torso_up", robot.torso)
    of_body("root_position", _SENSOR.mjSENS_FRAMEPOS)
    of_body("root_velocity", _SENSOR.mjSENS_FRAMELINVEL)
    of_body("root_angular_velocity", _SENSOR.mjSENS_FRAMEANGVEL)
    of_subtree("com_velocity", _SENSOR.mjSENS_SUBTREELINVEL)
    of_subtree("com_position", _SENSOR.mjSENS_SUBTREECOM)
    of_site("torso_position", TORSO)
    of_site("left_sole_position", SOLES[0])
    of_site("right_sole_position", SOLES[1])
    of_subtree("angular_momentum", _SENSOR.mjSENS_SUBTREEANGMOM)


def _add_foot_sensors(spec: mujoco.MjSpec, robot: Robot) -> None:
    for name, site in zip(("left_foot_orientation", "right_foot_orientation"), SOLES, strict=True):
        spec.add_sensor(name=name, type=_SENSOR.mjSENS_FRAMEQUAT, objtype=_OBJECT.mjOBJ_SITE, objname=site)
    for name, body in zip(("left_foot_contact", "right_foot_contact"), robot.feet, strict=True):
        _add_contact(spec, name, body, ("found", "force", "torque", "pos"), _NET_FORCE)
    _add_contact(spec, "ground_contact", robot.root, ("found",), 0)


def _add_contact(spec: mujoco.MjSpec, name: str, body: str, data: tuple[str, ...], reduce: int) -> None:
    """Record some data of the floor's contacts with a body and all that hangs on it."""
    sensor = spec.add_sensor(
        name=name,
        type=_SENSOR.mjSENS_CONTACT,
        objtype=_OBJECT.mjOBJ_GEOM,
        objname=FLOOR,
        reftype=_OBJECT.mjOBJ_XBODY,
        refname=body,
    )
    sensor.intprm = [sum(1 << _CONTACT_DATA[word] for word in data), reduce, 1]
