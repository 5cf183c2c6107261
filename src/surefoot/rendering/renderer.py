"""Renderer: offscreen pictures of a robot with its push, CoM, capture point, support polygon and foot forces."""

from __future__ import annotations

import importlib
from typing import Any

import mujoco
import numpy as np

from surefoot.errors import UserError
from surefoot.physics.pushes import Push
from surefoot.rendering.framing import scale_of, visible_geoms
from surefoot.rendering.moment import Moment
from surefoot.rendering.opengl import gl_backend
from surefoot.rendering.scenery import drawn_model
from surefoot.robots import Robot
from surefoot.robots.domain import NOMINAL_DOMAIN, DomainParameters
from surefoot.robots.model import FLOOR

LARGEST = (1920, 1080)
"""Width and height of the largest picture [pixels]."""

# Lengths are for a robot of `framing.REFERENCE_HEIGHT` [m].
_LOOK_AT_HEIGHT, _ABOVE_LOOK_AT, _DISTANCE = 0.88, 0.25, 3.1
"""The camera looks at the middle of a standing robot, so far below its CoM when it flies, from so far away."""
_FORCE_LENGTH = 0.485
"""Length of the arrow of a force that equals the robot's weight."""
_BODY_RADIUS = 0.13
"""A push's arrow ends so far from the CoM of the pushed body."""
_LEAST_FORCE = 0.001
"""Foot forces below this share of the robot's weight are not drawn."""
AFTERGLOW = 0.3
"""A push stays in a film for this time after its end [s]: at 25 pictures a second it acts in three of them only."""
_NEARER = 0.5
"""Marks inside the robot are drawn at this share of their distance from the eye, so that nothing hides them."""

_PUSH, _PUSH_PAST = (1.0, 0.3, 0.05, 1.0), (1.0, 0.3, 0.05, 0.4)
_COM, _FORCE, _SUPPORT = (1.0, 0.82, 0.1, 1.0), (0.15, 0.6, 1.0, 0.9), (0.9, 0.95, 1.0, 0.8)
_CAPTURED, _ESCAPED = (0.1, 0.85, 0.35, 1.0), (0.95, 0.1, 0.15, 1.0)

_SIGHT = {"sagittal": (112.0, -10.0), "lateral": (196.0, -10.0)}
"""Azimuth and elevation of the camera's view [deg]: from the right side, and from the front."""

LEGEND = (
    ("push", _PUSH),
    ("CoM", _COM),
    ("capture point over the support", _CAPTURED),
    ("beyond it", _ESCAPED),
    ("foot force", _FORCE),
)
"""Legend of the marks: word and colour (red, green, blue, opacity)."""


class Renderer:
    """An offscreen picture of a robot with its push, CoM, capture point, support polygon and foot forces.

    Args:
        width, height: of the pictures [pixels].
        domain: what the robot stands on.

    Raises:
        UserError: the size is beyond the model's offscreen buffer, or no OpenGL can be had.
    """

    def __init__(self, robot: Robot, width: int = 640, height: int = 480, domain: DomainParameters = NOMINAL_DOMAIN):
        if not (0 < width <= LARGEST[0] and 0 < height <= LARGEST[1]):
            raise UserError(f"cannot draw {width} x {height} pixels; valid: up to {LARGEST[0]} x {LARGEST[1]}")
        self.robot = robot
        self._scale = scale_of(robot)
        self._force_length = self._scale * _FORCE_LENGTH / robot.weight  # [m/N]
        self._model = drawn_model(robot, domain)
        self._model.vis.global_.offwidth, self._model.vis.global_.offheight = width, height
        self._rect = mujoco.MjrRect(0, 0, width, height)
        self._data = mujoco.MjData(self._model)
        self._option = _shown_groups(self._model)
        self._camera = mujoco.MjvCamera()
        self._scene = mujoco.MjvScene(self._model, maxgeom=500)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = 0
        self._gl = importlib.import_module(f"mujoco.{gl_backend()}").GLContext(width, height)
        self._gl.make_current()
        self._canvas = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._canvas)

    def draw(self, moment: Moment, push: Push | None = None, afterglow: float = AFTERGLOW) -> np.ndarray:
        """A picture, uint8 (height, width, 3).

        Args:
            moment: what is shown.
            push: what the robot is pushed by from time 0 on. Its direction chooses the view: from the side unless it
                is mostly lateral.
            afterglow: how long the push stays in the picture after its end, paler [s].
        """
        self._data.qpos = moment.qpos
        mujoco.mj_forward(self._model, self._data)
        lateral = push is not None and abs(push.direction[1]) > abs(push.direction[0])
        self._camera.azimuth, self._camera.elevation = _SIGHT["lateral" if lateral else "sagittal"]
        height = max(self._scale * _LOOK_AT_HEIGHT, moment.com_position[2] - self._scale * _ABOVE_LOOK_AT)
        self._camera.lookat = [*moment.com_position[:2], height]
        self._camera.distance = self._scale * _DISTANCE
        # First, because mjv_updateScene puts the headlight where the camera was before.
        mujoco.mjv_updateCamera(self._model, self._data, self._camera, self._scene)
        mujoco.mjv_updateScene(
            self._model, self._data, self._option, None, self._camera, mujoco.mjtCatBit.mjCAT_ALL, self._scene
        )
        self._mark_ground(moment)
        self._mark_robot(moment)
        if push is not None and push.impulse and 0.0 <= moment.time < push.duration + afterglow:
            self._mark_push(push, _PUSH if moment.time < push.duration else _PUSH_PAST)
        return self._render()

    def close(self) -> None:
        """Free the OpenGL context."""
        if self._gl is not None:
            with self._gl.as_current():
                self._canvas.free()
            self._gl.free()
            self._gl = None

    def __enter__(self) -> Renderer:
        """Enter a block whose end closes the renderer."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the renderer."""
        self.close()

    def _render(self) -> np.ndarray:
        pixels = np.empty((self._rect.height, self._rect.width, 3), np.uint8)
        self._gl.make_current()
        mujoco.mjr_render(self._rect, self._scene, self._canvas)
        mujoco.mjr_readPixels(pixels, None, self._rect, self._canvas)
        return pixels[::-1].copy()

    def _mark_ground(self, moment: Moment) -> None:
        raised = self._ground(moment.support_polygon) + 0.004 * self._scale
        corners = np.column_stack([moment.support_polygon, raised])
        for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            self._connect(mujoco.mjtGeom.mjGEOM_CAPSULE, 0.006, a, b, _SUPPORT)
        capture_color = _CAPTURED if moment.is_captured else _ESCAPED
        # The CoM's disc is smaller and lies higher: both are seen when one is on the other.
        discs = ((moment.capture_point, 0.045, 0.010, capture_color), (moment.com_position[:2], 0.028, 0.016, _COM))
        for center, radius, top, color in discs:
            ground = self._ground(center)
            low, high = [*center, ground], [*center, ground + top * self._scale]
            self._connect(mujoco.mjtGeom.mjGEOM_CYLINDER, radius, low, high, color, nearer=True)

    def _ground(self, points: np.ndarray) -> np.ndarray:
        """Height of the floor (...) [m] at points (..., 2)."""
        floor = self._data.geom(FLOOR)
        normal = floor.xmat[2::3]
        heights: np.ndarray = floor.xpos[2] - (np.asarray(points) - floor.xpos[:2]) @ normal[:2] / normal[2]
        return heights

    def _mark_robot(self, moment: Moment) -> None:
        com = moment.com_position
        self._connect(mujoco.mjtGeom.mjGEOM_CAPSULE, 0.04, com, com + [0, 0, 1e-3], _COM, nearer=True)
        for force, point in zip(moment.foot_force, moment.foot_pressure_point, strict=True):
            if force > _LEAST_FORCE * self.robot.weight:
                tip = point + [0, 0, force * self._force_length]
                self._connect(mujoco.mjtGeom.mjGEOM_ARROW, 0.012, point, tip, _FORCE, nearer=True)

    def _mark_push(self, push: Push, color: tuple[float, ...]) -> None:
        direction = np.array(push.direction)
        tip = self._data.body(self.robot.pushed_body(push.body)).xipos - _BODY_RADIUS * self._scale * direction
        tail = tip - direction * push.impulse / push.duration * self._force_length
        self._connect(mujoco.mjtGeom.mjGEOM_ARROW, 0.035, tail, tip, color, nearer=True)

    def _connect(
        self, kind: mujoco.mjtGeom, width: float, start: Any, end: Any, color: tuple[float, ...], nearer: bool = False
    ) -> None:
        """Add a shape from `start` to `end` (3,) to the scene; `width` is for a robot of `REFERENCE_HEIGHT`."""
        start, end = np.asarray(start, float), np.asarray(end, float)
        width *= self._scale
        if nearer:
            # Shrinking towards the eye changes what hides the shape, not how it looks.
            eye = np.mean([camera.pos for camera in self._scene.camera], axis=0)
            start, end, width = eye + _NEARER * (start - eye), eye + _NEARER * (end - eye), _NEARER * width
        shape = self._scene.geoms[self._scene.ngeom]
        mujoco.mjv_initGeom(shape, kind, np.zeros(3), np.zeros(3), np.eye(3).ravel(), np.array(color, np.float32))
        # MuJoCo draws an arrow at half the length that it is given.
        whole = end + (end - start if kind == mujoco.mjtGeom.mjGEOM_ARROW else 0.0)
        mujoco.mjv_connector(shape, kind, width, start, whole)
        shape.emission = 0.5
        self._scene.ngeom += 1


def _shown_groups(model: mujoco.MjModel) -> mujoco.MjvOption:
    """Show the groups of the robot's visible geoms and of all that belongs to the world."""
    option = mujoco.MjvOption()
    shown = np.union1d(model.geom_group[visible_geoms(model)], model.geom_group[model.geom_bodyid == 0])
    option.geomgroup[:] = np.isin(np.arange(len(option.geomgroup)), shown)
    return option
