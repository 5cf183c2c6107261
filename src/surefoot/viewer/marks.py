"""Marks: the forces and points of the live page's scene, and the colours of a robot's verdict."""

from __future__ import annotations

import numpy as np
import viser

from surefoot.rendering.framing import scale_of
from surefoot.rendering.moment import Moment
from surefoot.robots import Robot
from surefoot.viewer.verdict import State

# Lengths are for a robot of `framing.REFERENCE_HEIGHT` [m], forces are shares of the robot's weight.
FORCE_LENGTH, PUSH_LENGTH = 0.673, 0.943
"""Length of the arrows of a foot force and of a push that equal the robot's weight."""
_MIN_PUSH, _MAX_PUSH = 0.2, 1.4
"""Shortest and longest push arrow."""
_SURFACE = 0.18
"""A push's arrow ends so far from the CoM of the pushed body, a pull's begins there."""
LEAST_FORCE, _LOADED = 0.001, 0.004
"""Weaker pushes and foot forces are not drawn."""
_AFTERGLOW = 0.3
"""A push's arrow stays for this time after its end [s of simulated time], paler."""

# Darker than they shall look: the light brightens them.
PUSH, COM, FORCE, PRESSURE = (235, 62, 0), (240, 160, 0), (0, 95, 225), (125, 30, 205)
PUSH_PAST = (225, 110, 55)
CAPTURED, ESCAPED, SUPPORT = (0, 140, 55), (215, 15, 25), (25, 45, 75)
STATE_COLORS = {
    State.STANDING: (120, 132, 148),
    State.RECOVERING: (245, 165, 30),
    State.RECOVERED: (40, 170, 90),
    State.FELL: (220, 50, 50),
    State.RESTLESS: (200, 120, 60),
}
"""Of the discs under the robots of a crowd, and of the verdict beside it."""


class Marks:
    """Push arrows and states of all robots; balance of the watched one.

    Args:
        server: where they are drawn.
        robot: for which they are; lengths and forces below are scaled by its height and its weight.
        num_robots: how many there are.
        root: the scene's node under which the marks are.
    """

    def __init__(self, server: viser.ViserServer, robot: Robot, num_robots: int, root: str):
        self._root, self._scale, self._weight = root, scale_of(robot), robot.weight
        self._add_arrows(server.scene)
        self._add_balance(server.scene)
        self._discs = self._add_discs(server.scene, num_robots) if num_robots > 1 else None

    def _add_arrows(self, scene: viser.SceneApi) -> None:
        size, nothing = self._scale, np.zeros((1, 2, 3))
        self._pushes = scene.add_arrows(
            f"{self._root}/push",
            nothing,
            PUSH,
            shaft_radius=0.022 * size,
            head_radius=0.05 * size,
            head_length=0.12 * size,
            visible=False,
        )
        self._forces = scene.add_arrows(
            f"{self._root}/foot_force",
            nothing,
            FORCE,
            shaft_radius=0.009 * size,
            head_radius=0.022 * size,
            head_length=0.06 * size,
        )

    def _add_balance(self, scene: viser.SceneApi) -> None:
        size, root, nothing = self._scale, self._root, np.zeros((1, 2, 3))
        self._support = scene.add_line_segments(
            f"{root}/support", nothing, SUPPORT, thickness=0.012 * size, thickness_units="world"
        )
        self._plumb = scene.add_line_segments(
            f"{root}/com_line", nothing, COM, thickness=0.006 * size, thickness_units="world"
        )
        self._com = scene.add_icosphere(f"{root}/com", 0.045 * size, color=COM)
        self._com_ground = scene.add_cylinder(f"{root}/com_ground", 0.028 * size, 0.02 * size, color=COM)
        self._captured = scene.add_cylinder(f"{root}/capture_point", 0.05 * size, 0.012 * size, color=CAPTURED)
        self._escaped = scene.add_cylinder(f"{root}/capture_point_beyond", 0.05 * size, 0.012 * size, color=ESCAPED)
        block = (0.05 * size, 0.05 * size, 0.016 * size)
        self._pressure = scene.add_box(f"{root}/pressure", color=PRESSURE, dimensions=block)

    def _add_discs(self, scene: viser.SceneApi, num_robots: int) -> viser.BatchedMeshHandle:
        return scene.add_batched_meshes_simple(
            f"{self._root}/states",
            *_disc(0.42 * self._scale),
            np.tile([1.0, 0.0, 0.0, 0.0], (num_robots, 1)),
            np.zeros((num_robots, 3)),
            batched_colors=np.zeros((num_robots, 3), np.uint8),
            opacity=0.8,
            cast_shadow=False,
            lod="off",
        )

    def show_pushes(self, centers: np.ndarray, force: np.ndarray, since: np.ndarray, is_held: np.ndarray) -> None:
        """Arrows to body centres (N, 3) [m] for forces (N, 3) [N] that ended `since` (N,) [s] ago, or not yet.

        A push comes from behind the body, a hand that holds it (N,) pulls away from it.
        """
        shown = (since < _AFTERGLOW) & (np.linalg.norm(force, axis=1) > LEAST_FORCE * self._weight)
        self._pushes.visible = bool(shown.any())
        if not shown.any():
            return
        strength = np.linalg.norm(force[shown], axis=1)[:, None]
        direction = force[shown] / strength
        length = self._scale * np.clip(PUSH_LENGTH * strength / self._weight, _MIN_PUSH, _MAX_PUSH)
        surface = self._scale * _SURFACE
        tips = centers[shown] + np.where(is_held[shown, None], surface + length, -surface) * direction
        self._pushes.points = np.stack([tips - length * direction, tips], axis=1).astype(np.float32)
        self._pushes.colors = np.where(since[shown, None] < 0.0, PUSH, PUSH_PAST).astype(np.uint8)

    def show_states(self, root: np.ndarray, states: np.ndarray | None) -> None:
        """A disc in the colour of its state under each root (N, 3) [m] of a crowd."""
        if self._discs is None or states is None:
            return
        self._discs.batched_positions = (root * [1, 1, 0] + [0, 0, 0.003 * self._scale]).astype(np.float32)
        self._discs.batched_colors = np.array([STATE_COLORS[State(state)] for state in states], np.uint8)

    def show_balance(self, moment: Moment, place: np.ndarray, visible: bool) -> None:
        """CoM, capture point, support polygon, CoP and foot forces of one robot."""
        com, captured = moment.com_position + place, moment.is_captured
        ground = np.array([com[0], com[1], 0.012 * self._scale])
        capture = np.append(moment.capture_point, 0.01 * self._scale) + place
        self._com.position, self._com_ground.position = com, ground
        self._plumb.points = np.array([[com, ground]], np.float32)
        self._captured.position = self._escaped.position = capture
        for mark in (self._com, self._com_ground, self._plumb):
            mark.visible = visible
        self._captured.visible, self._escaped.visible = visible and captured, visible and not captured
        self._show_support(moment, place, visible)
        force, points = moment.foot_force, moment.foot_pressure_point
        loaded = force > _LOADED * self._weight
        self._forces.visible = self._pressure.visible = visible and bool(loaded.any())
        if loaded.any():
            feet = points[loaded] + place
            tips = feet + np.outer(force[loaded] / self._weight, [0, 0, FORCE_LENGTH * self._scale])
            self._forces.points = np.stack([feet, tips], axis=1).astype(np.float32)
            middle = (force[:, None] * points).sum(axis=0) / force.sum()
            self._pressure.position = middle + place + [0, 0, 0.01 * self._scale]

    def _show_support(self, moment: Moment, place: np.ndarray, visible: bool) -> None:
        corners = moment.support_polygon
        self._support.visible = visible and len(corners) > 1
        if len(corners) > 1:
            raised = np.column_stack([corners, np.full(len(corners), 0.008 * self._scale)]) + place
            self._support.points = np.stack([raised, np.roll(raised, -1, axis=0)], axis=1).astype(np.float32)


def _disc(radius: float, corners: int = 40) -> tuple[np.ndarray, np.ndarray]:
    """A flat round mesh that faces up."""
    angle = np.linspace(0.0, 2.0 * np.pi, corners, endpoint=False)
    rim = radius * np.stack([np.cos(angle), np.sin(angle), np.zeros(corners)], axis=1)
    numbers = np.arange(corners)
    faces = np.stack([np.full(corners, corners), numbers, (numbers + 1) % corners], axis=1)
    return np.vstack([rim, np.zeros(3)]), faces
