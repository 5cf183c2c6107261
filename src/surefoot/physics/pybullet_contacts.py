"""Contacts in PyBullet: the shapes that may touch, their friction, and the forces of the floor on the feet."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import combinations
from typing import Any

import mujoco
import numpy as np

from surefoot.robots import Robot
from surefoot.robots.model import FLOOR

_LINK, _PLACE, _DISTANCE, _NORMAL_FORCE = 3, 5, 8, 9
_FORCES = ((9, 7), (10, 11), (12, 13))
"""Places in what Bullet tells of a contact point; forces: size and direction of the normal one and of friction."""


def collision_pairs(model: mujoco.MjModel) -> Iterator[tuple[str, str, bool]]:
    """Pairs of bodies, "world" for the floor, that have shapes, and whether MuJoCo lets any of these touch."""
    shapes = [g for g in range(model.ngeom) if model.geom_contype[g] or model.geom_conaffinity[g]]
    of_body: dict[int, list[int]] = {}
    for geom in shapes:
        of_body.setdefault(int(model.geom_bodyid[geom]), []).append(geom)
    excluded = {(int(pair) >> 16, int(pair) & 0xFFFF) for pair in model.exclude_signature}
    for one, other in combinations(sorted(of_body), 2):
        apart = not excluded & {(one, other), (other, one)} and not _are_neighbours(model, one, other)
        allowed = apart and any(_fit(model, a, b) for a in of_body[one] for b in of_body[other])
        yield model.body(one).name, model.body(other).name, allowed


def _are_neighbours(model: mujoco.MjModel, one: int, other: int) -> bool:
    """MuJoCo lets no body touch what it is welded to, nor its parent, unless that is the world."""
    weld, parent = model.body_weldid, model.body_weldid[model.body_parentid[model.body_weldid]]
    if weld[one] == weld[other]:
        return True
    return bool(weld[one] and weld[other] and (parent[one] == weld[other] or parent[other] == weld[one]))


def _fit(model: mujoco.MjModel, one: int, other: int) -> bool:
    kinds, likes = model.geom_contype, model.geom_conaffinity
    return bool(kinds[one] & likes[other] or kinds[other] & likes[one])


def link_friction(model: mujoco.MjModel) -> dict[str, float]:
    """Body -> sliding friction coefficient between its shapes and the floor, in MuJoCo the larger one of both."""
    floor = float(model.geom(FLOOR).friction[0])
    found: dict[str, float] = {}
    for geom in range(model.ngeom):
        body = int(model.geom_bodyid[geom])
        if body and (model.geom_contype[geom] or model.geom_conaffinity[geom]):
            name = model.body(body).name
            found[name] = max(found.get(name, floor), float(model.geom_friction[geom, 0]))
    return found


class Contacts:
    """The floor's action on a robot in the last substep.

    Args:
        model: of the robot.
        robot: whose feet.
        links: body -> number of its link in Bullet.
        points: asks Bullet for the contact points of the robot with the floor.

    Attributes:
        forces: what `read` returned last; the caller may put it back.
    """

    def __init__(
        self, model: mujoco.MjModel, robot: Robot, links: dict[str, int], points: Callable[[], tuple[Any, ...]]
    ):
        self._points = points
        self._feet = [{links[body] for body in _subtree(model, foot)} for foot in robot.feet]
        self.forces = np.zeros(_NUM_COLUMNS)

    def read(self) -> np.ndarray:
        """Ask Bullet: both feet's contact columns and the number of all contacts, as the record holds them (21,).

        A point touches if its distance is not positive, or it bears a force: Bullet also keeps points in sight that are
        near.
        """
        found = np.zeros(_NUM_COLUMNS)
        touching = [point for point in self._points() if point[_DISTANCE] <= 0.0 or point[_NORMAL_FORCE] > 0.0]
        for side, links in enumerate(self._feet):
            _add_up([point for point in touching if point[_LINK] in links], found[10 * side : 10 * side + 10])
        found[-1] = len(touching)
        self.forces = found
        return found

    def write(self, row: np.ndarray, columns: dict[str, slice]) -> None:
        """Write what was read last into a row of the record."""
        first, last = columns["left_foot_contact"], columns["ground_contact"]
        row[first.start : last.stop] = self.forces


_NUM_COLUMNS = 21


def _subtree(model: mujoco.MjModel, root: str) -> list[str]:
    """A body and all that hangs on it."""
    inside = {model.body(root).id}
    for body in range(1, model.nbody):
        if model.body_parentid[body] in inside:
            inside.add(body)
    return [model.body(body).name for body in inside]


def _add_up(points: list[Any], columns: np.ndarray) -> None:
    """Write number, net force, torque about the pressure centre, and the pressure centre of some contact points."""
    if not points:
        return
    total = sum(point[_NORMAL_FORCE] for point in points)
    cx = cy = cz = fx = fy = fz = tx = ty = tz = 0.0
    for point in points:  # in plain numbers: arrays of three are several times slower
        x, y, z = point[_PLACE]
        normal, first, second = (point[size] for size, _ in _FORCES)
        (nx, ny, nz), (ax, ay, az), (bx, by, bz) = (point[direction] for _, direction in _FORCES)
        px = normal * nx + first * ax + second * bx
        py = normal * ny + first * ay + second * by
        pz = normal * nz + first * az + second * bz
        share = normal / total if total > 0.0 else 1.0 / len(points)
        cx, cy, cz = cx + share * x, cy + share * y, cz + share * z
        fx, fy, fz = fx + px, fy + py, fz + pz
        tx, ty, tz = tx + y * pz - z * py, ty + z * px - x * pz, tz + x * py - y * px
    moved = cy * fz - cz * fy, cz * fx - cx * fz, cx * fy - cy * fx
    columns[:] = len(points), fx, fy, fz, tx - moved[0], ty - moved[1], tz - moved[2], cx, cy, cz
