"""Geometry: the facts measured on a compiled model instead of typed by hand: soles, mirror, legs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from surefoot.errors import UserError

FLAT = 0.004
"""Points of a foot that are less than this above its lowest one belong to the sole [m]."""
_DIGITS = 9
"""Lengths are rounded to so many digits, so that a sum of two typed numbers is the number that a person would type."""
_EDGE = 0.005
"""A foot whose lowest points are narrower than this stands on an edge while all joints are at zero [m]."""
_COPLANAR, _DOWNWARD = 0.9998, 0.7
"""Cosines: facets of a foot whose directions differ by less than the first are one, and face down by the second."""
_NEAR = 0.002
"""Mirrored places may differ by this [m]."""
_ALIKE = 0.005
"""Mirrored bodies may differ in mass by this share of the robot's mass."""


@dataclass(frozen=True, eq=False)
class Sole:
    """The rectangle on which a foot stands.

    Attributes:
        center: in the foot body's frame (3,) [m].
        quaternion: of the sole in the foot body's frame: x forward, z up.
        half_size: half length and half width (2,) [m].
    """

    center: np.ndarray
    quaternion: np.ndarray
    half_size: np.ndarray


@dataclass(frozen=True, eq=False)
class Mirror:
    """Left and right exchanged: a mirrored vector over the joints is ``sign * vector[source]``; likewise bodies."""

    source: np.ndarray
    sign: np.ndarray
    bodies: dict[str, str]


def reference_data(model: mujoco.MjModel) -> mujoco.MjData:
    """The model with all joints at zero and its root upright."""
    data = mujoco.MjData(model)
    data.qpos[3:] = 0.0
    data.qpos[3] = 1.0
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    return data


def find_sole(model: mujoco.MjModel, foot: str, where: str) -> Sole:
    """The sole of a foot: the rectangle about the lowest points of all its shapes that can touch something.

    The lowest points are those with all joints at zero. A foot that then stands on an edge is turned so that its
    largest face lies flat.

    Raises:
        UserError: the foot has no such shape.
    """
    data = reference_data(model)
    body = model.body(foot).id
    geoms = [g for g in range(model.ngeom) if model.geom_bodyid[g] == body and _collides(model, g)]
    if not geoms:
        raise UserError(f"{where}: feet: the body '{foot}' has no geom that can touch the floor")
    points = np.concatenate([_lowest_points(model, data, geom) for geom in geoms])
    turn = np.array([1.0, 0.0, 0.0, 0.0])
    middle, half_size = _rectangle(points)
    if half_size.min() < _EDGE:
        turn = _turn_to_largest_face(points)
        turned = _rotated(points, turn)
        middle, half_size = _rectangle(turned)
        middle = _rotated(middle[None], turn * [1, -1, -1, -1])[0]
    rotation = data.xmat[body].reshape(3, 3)
    center = np.round((middle - data.xpos[body]) @ rotation, _DIGITS)
    quaternion, upright = np.zeros(4), np.zeros(4)
    mujoco.mju_mulQuat(upright, turn, np.round(data.xquat[body], _DIGITS))
    mujoco.mju_negQuat(quaternion, upright)
    return Sole(center + 0.0, quaternion + 0.0, np.round(half_size, _DIGITS))


def _rectangle(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The rectangle about the lowest of some points (n, 3): its middle (3,) and its half size (2,) [m]."""
    points = points[points[:, 2] < points[:, 2].min() + FLAT]
    low, high = points.min(axis=0), points.max(axis=0)
    return np.array([0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), low[2]]), 0.5 * (high - low)[:2]


def _turn_to_largest_face(points: np.ndarray) -> np.ndarray:
    """The smallest turn, a quaternion, after which the largest face below some points (n, 3) lies flat.

    Points without such a face are not turned.
    """
    from scipy.spatial import ConvexHull, QhullError

    turn = np.array([1.0, 0.0, 0.0, 0.0])
    try:
        hull = ConvexHull(points)
    except QhullError:  # all of them lie in a plane
        return turn
    normals, corners = hull.equations[:, :3], points[hull.simplices]
    areas = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    faces = (normals @ normals.T > _COPLANAR) @ areas
    faces[normals[:, 2] > -_DOWNWARD] = 0.0
    if faces.max() > 0.0:
        down = normals[np.argmax(faces)]
        turn = np.array([1.0 - down[2], *np.cross(down, [0.0, 0.0, -1.0])])
    return turn / np.linalg.norm(turn)


def _rotated(points: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, quaternion)
    return points @ rotation.reshape(3, 3).T


def find_mirror(model: mujoco.MjModel, joints: Sequence[str], where: str) -> Mirror:
    """Which joint is which one's mirror image, from their places and axes.

    A rotation's axis is an axial vector: its mirror image through the sagittal plane is (-x, y, -z).

    Raises:
        UserError: a joint has no counterpart of mirrored place, axis, range, motor and mass; the message names it.
    """
    data = reference_data(model)
    ids = np.array([model.joint(name).id for name in joints])
    places, axes = data.xanchor[ids] - data.xpos[1], data.xaxis[ids]
    source, sign = np.zeros(len(ids), np.int64), np.zeros(len(ids))
    for i, name in enumerate(joints):
        apart = np.linalg.norm(places - places[i] * [1, -1, 1], axis=1)
        along = axes @ (axes[i] * [-1, 1, -1])
        fits = np.flatnonzero((apart < _NEAR) & (np.abs(along) > 0.999))
        if len(fits) != 1:
            raise UserError(f"{where}: joint '{name}' has no mirror image; is the model symmetric, left and right?")
        source[i], sign[i] = fits[0], np.sign(along[fits[0]])
        _check_alike(model, ids[i], ids[fits[0]], sign[i], where)
    bodies = {
        model.body(model.jnt_bodyid[ids[i]]).name: model.body(model.jnt_bodyid[ids[source[i]]]).name
        for i in range(len(ids))
    }
    return Mirror(source, sign, bodies)


def _check_alike(model: mujoco.MjModel, one: int, other: int, sign: float, where: str) -> None:
    low, high = model.jnt_range[other] if sign > 0 else -model.jnt_range[other][::-1]
    names = f"'{model.joint(one).name}' and '{model.joint(other).name}'"
    if np.abs(model.jnt_range[one] - [low, high]).max() > 1e-3:
        raise UserError(f"{where}: the ranges of {names} are no mirror images; is the model symmetric?")
    masses = [model.body_mass[model.jnt_bodyid[joint]] for joint in (one, other)]
    if abs(masses[0] - masses[1]) > _ALIKE * model.body_mass.sum():
        raise UserError(f"{where}: the bodies of {names} differ in mass; is the model symmetric?")
    motors = [model.actuator_gainprm[model.actuator_trnid[:, 0] == joint] for joint in (one, other)]
    if not np.allclose(motors[0], motors[1], rtol=1e-6):
        raise UserError(f"{where}: the motors of {names} differ; is the model symmetric?")


def joint_groups(joints: Sequence[str], source: np.ndarray) -> tuple[str, ...]:
    """A name for each joint that it shares with its mirror image: ``left_knee_pitch`` -> ``knee_pitch``."""
    return tuple(_shared_name(name, joints[source[i]]) for i, name in enumerate(joints))


def _shared_name(one: str, other: str) -> str:
    if one == other:
        return one
    pairs = list(zip(one.split("_"), other.split("_"), strict=False))
    shared = [a for a, b in pairs if a == b]
    return "_".join(shared) or one


def leg_length(model: mujoco.MjModel, foot: str, sole: Sole) -> float:
    """From the first joint of the leg down to the sole, joints at zero [m]."""
    data = reference_data(model)
    body, first = model.body(foot).id, -1
    sole_height = data.xpos[body, 2] + (data.xmat[body].reshape(3, 3) @ sole.center)[2]
    while body > 1:
        if model.body_jntnum[body]:
            first = model.body_jntadr[body]
        body = model.body_parentid[body]
    return round(float(data.xanchor[first, 2] - sole_height), _DIGITS)


def _collides(model: mujoco.MjModel, geom: int) -> bool:
    return bool(model.geom_contype[geom] or model.geom_conaffinity[geom])


def _lowest_points(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> np.ndarray:
    """Points of a shape (n, 3) [m], its lowest ones among them, with all joints at zero."""
    size, kind = model.geom_size[geom], mujoco.mjtGeom(model.geom_type[geom])
    place, rotation = data.geom_xpos[geom], data.geom_xmat[geom].reshape(3, 3)
    down = np.array([0.0, 0.0, -1.0])
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return place + (size * _CORNERS) @ rotation.T
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = model.mesh(model.geom_dataid[geom])
        first, count = int(mesh.vertadr[0]), int(mesh.vertnum[0])
        return place + model.mesh_vert[first : first + count] @ rotation.T
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        ends = np.outer([-size[1], size[1]], rotation[:, 2])
        return place + ends + size[0] * down
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        angle = np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False)
        rim = size[0] * np.stack([np.cos(angle), np.sin(angle), np.zeros(64)], axis=1)
        return place + np.concatenate([rim + [0, 0, size[1]], rim - [0, 0, size[1]]]) @ rotation.T
    radii = size if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID else np.full(3, size[0])
    normal = radii * (rotation.T @ down)  # the lowest point of an ellipsoid is where its normal points down
    return place + rotation @ (radii * normal / np.linalg.norm(normal))[None].T[:, 0] + np.zeros((1, 3))


_CORNERS = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
