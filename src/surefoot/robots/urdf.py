"""URDF: a compiled model as a file that other physics engines read: bodies, joints and the shapes that touch."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from surefoot.errors import UserError
from surefoot.robots.model import CONSTANT_COLUMN, MAX_VOLTAGE_COLUMN

_KIND = mujoco.mjtGeom
_NUM_POINTS = 400
"""Of the polyhedron that stands for an ellipsoid."""


@dataclass(frozen=True)
class Urdf:
    """A robot as URDF.

    A link has the name and the frame of its body, moved to the anchor of the body's last joint. A body with several
    joints is carried by a massless link for each joint but the last.

    Attributes:
        text: of the file; it refers to the meshes by their names.
        meshes: file name -> convex mesh in Wavefront's format.
        joints: for each hinge in the model's order, the name of its URDF joint.
        joint_reference: angle of each hinge in the model at which the URDF joint is at zero [rad].
        link_origin: body -> origin of its link in the body's frame (3,) [m].
    """

    text: str
    meshes: dict[str, str] = field(repr=False)
    joints: tuple[str, ...]
    joint_reference: np.ndarray
    link_origin: dict[str, np.ndarray] = field(repr=False)

    def write(self, folder: Path) -> Path:
        """Write the file and its meshes into a folder; returns the file's path."""
        for name, text in self.meshes.items():
            (folder / name).write_text(text)
        file = folder / "robot.urdf"
        file.write_text(self.text)
        return file


def urdf_of(model: mujoco.MjModel) -> Urdf:
    """Write a floating robot's compiled model as URDF.

    The inertia of every joint's rotor (the armature) is added to the link that the joint moves, about the joint's axis:
    URDF knows no rotors. It turns with the link, not with the joint, which is the same wherever the link that carries
    the motor turns much more slowly.

    Raises:
        UserError: a shape that touches is neither a box, a sphere, a capsule, a cylinder, an ellipsoid nor a mesh.
    """
    return _Writer(model).write()


def link_inertia(model: mujoco.MjModel, body: int) -> tuple[np.ndarray, np.ndarray]:
    """Principal moments (3,) [kg m^2] of a body with its joints' rotors, and their axes in the body's frame (3, 3).

    The axes are the columns of a rotation.
    """
    axes = _matrix(model.body_iquat[body])
    rotors = _rotor_inertia(model, body)
    if not rotors.any():
        return model.body_inertia[body].copy(), axes
    moments, axes = np.linalg.eigh(axes @ np.diag(model.body_inertia[body]) @ axes.T + rotors)
    axes[:, 0] *= np.linalg.det(axes)  # a rotation, not a reflection
    return moments, axes


def _rotor_inertia(model: mujoco.MjModel, body: int) -> np.ndarray:
    inertia = np.zeros((3, 3))
    for joint in _hinges(model, body):
        axis = model.jnt_axis[joint]
        inertia += model.dof_armature[model.jnt_dofadr[joint]] * np.outer(axis, axis)
    return inertia


def _hinges(model: mujoco.MjModel, body: int) -> list[int]:
    first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
    return [j for j in range(first, first + count) if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE]


class _Writer:
    """Writes one model."""

    def __init__(self, model: mujoco.MjModel):
        self.model = model
        self.robot = ElementTree.Element("robot", name="robot")
        self.meshes: dict[str, str] = {}
        self.origin = [self._last_anchor(body) for body in range(model.nbody)]

    def write(self) -> Urdf:
        model = self.model
        for body in range(1, model.nbody):
            self._add_carriers(body)
            self._add_link(body)
            if body > 1:
                self._add_joints(body)
        ElementTree.indent(self.robot)  # Bullet reads no line of more than some thousand characters
        hinges = [j for body in range(1, model.nbody) for j in _hinges(model, body)]
        return Urdf(
            ElementTree.tostring(self.robot, "unicode"),
            self.meshes,
            tuple(model.joint(j).name for j in hinges),
            model.qpos0[[model.jnt_qposadr[j] for j in hinges]],
            {model.body(b).name: self.origin[b] for b in range(1, model.nbody)},
        )

    def _last_anchor(self, body: int) -> np.ndarray:
        hinges = _hinges(self.model, body)
        return self.model.jnt_pos[hinges[-1]].copy() if hinges else np.zeros(3)

    def _add_link(self, body: int) -> None:
        model = self.model
        link = ElementTree.SubElement(self.robot, "link", name=model.body(body).name)
        moments, axes = link_inertia(model, body)
        _add_inertial(link, model.body_ipos[body] - self.origin[body], axes, model.body_mass[body], moments)
        for geom in range(model.ngeom):
            if model.geom_bodyid[geom] == body and (model.geom_contype[geom] or model.geom_conaffinity[geom]):
                collision = ElementTree.SubElement(link, "collision")
                place = model.geom_pos[geom] - self.origin[body]
                _add_origin(collision, place, _matrix(model.geom_quat[geom]))
                self._add_shape(ElementTree.SubElement(collision, "geometry"), geom)

    def _add_carriers(self, body: int) -> None:
        """The massless links between a body's joints: before its own link, for none may come before its parent."""
        for j in _hinges(self.model, body)[:-1]:
            link = ElementTree.SubElement(self.robot, "link", name=self._moved_link(body, j))
            _add_inertial(link, np.zeros(3), np.eye(3), 0.0, np.zeros(3))

    def _moved_link(self, body: int, joint: int) -> str:
        name = self.model.body(body).name
        return name if joint == _hinges(self.model, body)[-1] else f"{name}/{self.model.joint(joint).name}"

    def _add_joints(self, body: int) -> None:
        """The joints of a body, the outermost first."""
        model, parent = self.model, int(self.model.body_parentid[body])
        name, above = model.body(body).name, model.body(parent).name
        turn = _matrix(model.body_quat[body])
        place = model.body_pos[body] - self.origin[parent]
        hinges = _hinges(model, body)
        if not hinges:
            self._add_joint(f"{name}/weld", "fixed", above, name, place, turn)
        for j in hinges:
            below = self._moved_link(body, j)
            anchor = model.jnt_pos[j]
            moved = anchor - model.jnt_pos[j - 1] if j != hinges[0] else place + turn @ anchor
            joint = self._add_joint(model.joint(j).name, "revolute", above, below, moved, turn)
            self._describe_hinge(joint, j)
            above, turn = below, np.eye(3)

    def _add_joint(
        self, name: str, kind: str, above: str, below: str, place: np.ndarray, turn: np.ndarray
    ) -> ElementTree.Element:
        joint = ElementTree.SubElement(self.robot, "joint", name=name, type=kind)
        _add_origin(joint, place, turn)
        ElementTree.SubElement(joint, "parent", link=above)
        ElementTree.SubElement(joint, "child", link=below)
        return joint

    def _describe_hinge(self, joint: ElementTree.Element, j: int) -> None:
        """Axis, range, the motor's limits, and the joint's own damping and friction."""
        model, dof = self.model, int(self.model.jnt_dofadr[j])
        ElementTree.SubElement(joint, "axis", xyz=_texts(model.jnt_axis[j]))
        low, high = model.jnt_range[j] - model.qpos0[model.jnt_qposadr[j]]
        motors = np.flatnonzero(model.actuator_trnid[:, 0] == j)
        effort = model.actuator_forcerange[motors, 1].sum()
        speed = model.actuator_gainprm[motors, MAX_VOLTAGE_COLUMN] / model.actuator_gainprm[motors, CONSTANT_COLUMN]
        limits = {"lower": low, "upper": high, "effort": effort, "velocity": speed.sum()}
        ElementTree.SubElement(joint, "limit", {key: _text(value) for key, value in limits.items()})
        damping, friction = _text(model.dof_damping[dof]), _text(model.dof_frictionloss[dof])
        ElementTree.SubElement(joint, "dynamics", damping=damping, friction=friction)

    def _add_shape(self, parent: ElementTree.Element, geom: int) -> None:
        model = self.model
        kind, size = _KIND(model.geom_type[geom]), model.geom_size[geom]
        if kind == _KIND.mjGEOM_BOX:
            ElementTree.SubElement(parent, "box", size=_texts(2.0 * size))
        elif kind == _KIND.mjGEOM_SPHERE:
            ElementTree.SubElement(parent, "sphere", radius=_text(size[0]))
        elif kind in (_KIND.mjGEOM_CAPSULE, _KIND.mjGEOM_CYLINDER):
            word = "capsule" if kind == _KIND.mjGEOM_CAPSULE else "cylinder"
            ElementTree.SubElement(parent, word, radius=_text(size[0]), length=_text(2.0 * size[1]))
        elif kind in (_KIND.mjGEOM_MESH, _KIND.mjGEOM_ELLIPSOID):
            file = f"shape_{geom}.obj"
            self.meshes[file] = _hull(model, geom)
            ElementTree.SubElement(parent, "mesh", filename=file)
        else:
            body = model.body(model.geom_bodyid[geom]).name
            raise UserError(
                f"body '{body}' has a shape of the kind {kind.name.removeprefix('mjGEOM_').lower()}; "
                f"valid in URDF: box, sphere, capsule, cylinder, ellipsoid, mesh"
            )


def _hull(model: mujoco.MjModel, geom: int) -> str:
    """The convex hull of a mesh or an ellipsoid, in Wavefront's format."""
    if model.geom_type[geom] == _KIND.mjGEOM_ELLIPSOID:
        points = _sphere() * model.geom_size[geom]
    else:
        mesh = model.mesh(model.geom_dataid[geom])
        first, count = int(mesh.vertadr[0]), int(mesh.vertnum[0])
        points = model.mesh_vert[first : first + count]
    hull = ConvexHull(points)
    number = {vertex: i for i, vertex in enumerate(hull.vertices.tolist(), start=1)}
    lines = [f"v {_texts(points[vertex])}" for vertex in number]
    lines += [f"f {' '.join(str(number[vertex]) for vertex in face)}" for face in hull.simplices.tolist()]
    return "\n".join(lines) + "\n"


def _sphere() -> np.ndarray:
    """Points (n, 3) that are spread evenly over the unit sphere, along a spiral from pole to pole."""
    turn = np.pi * (1.0 + np.sqrt(5.0)) * (np.arange(_NUM_POINTS) + 0.5)
    z = np.linspace(-1.0, 1.0, _NUM_POINTS)
    radius = np.sqrt(1.0 - z * z)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=1)


def _add_inertial(
    link: ElementTree.Element, place: np.ndarray, axes: np.ndarray, mass: float, moments: np.ndarray
) -> None:
    inertial = ElementTree.SubElement(link, "inertial")
    _add_origin(inertial, place, axes)
    ElementTree.SubElement(inertial, "mass", value=_text(mass))
    xx, yy, zz = map(_text, moments)
    ElementTree.SubElement(inertial, "inertia", ixx=xx, ixy="0", ixz="0", iyy=yy, iyz="0", izz=zz)


def _add_origin(parent: ElementTree.Element, place: np.ndarray, turn: np.ndarray) -> None:
    with warnings.catch_warnings(action="ignore", category=UserWarning):  # any of the angles of a gimbal lock will do
        angles = Rotation.from_matrix(turn).as_euler("xyz")
    ElementTree.SubElement(parent, "origin", xyz=_texts(place), rpy=_texts(angles))


def _matrix(quaternion: np.ndarray) -> np.ndarray:
    turned = np.zeros(9)
    mujoco.mju_quat2Mat(turned, quaternion)
    return turned.reshape(3, 3)


def _text(value: float) -> str:
    return repr(float(value) + 0.0)


def _texts(values: np.ndarray) -> str:
    return " ".join(map(_text, values))
