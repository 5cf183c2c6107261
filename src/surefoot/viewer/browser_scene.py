"""What the browser draws: floor, light, robots, and the forces and points that decide whether they fall."""

from __future__ import annotations

import mujoco
import numpy as np
import viser

from surefoot.physics.step_record import StepRecord
from surefoot.rendering.moment import Moment
from surefoot.robots import Robot
from surefoot.viewer.body_meshes import body_glbs, visual_model
from surefoot.viewer.session import HAND, Session
from surefoot.viewer.verdict import State

SPACING = 2.2
"""Between the places of a crowd's robots [m]."""
FORCE_LENGTH = 0.5e-3
"""Length of foot force arrows [m/N]."""
PUSH_LENGTH = 0.7e-3
"""Length of push arrows [m/N]."""
_MAX_PUSH = 1.4
"""Longest push arrow [m]."""
_SURFACE = 0.18
"""A push's arrow ends so far from the CoM of the pushed body, a pull's begins there [m]."""
_ROOT = "/world"

# Darker than they shall look: the light brightens them.
PUSH, COM, FORCE, PRESSURE = (235, 62, 0), (240, 160, 0), (0, 95, 225), (125, 30, 205)
PUSH_PAST = (225, 110, 55)
CAPTURED, ESCAPED, SUPPORT = (0, 140, 55), (215, 15, 25), (25, 45, 75)
_AFTERGLOW = 0.3
"""A push's arrow stays for so long after its end [s of simulated time], paler."""
STATE_COLORS = {
    State.STANDING: (120, 132, 148),
    State.RECOVERING: (245, 165, 30),
    State.RECOVERED: (40, 170, 90),
    State.FELL: (220, 50, 50),
    State.RESTLESS: (200, 120, 60),
}
"""Of the discs under the robots of a crowd, and of the verdict beside it."""


class BrowserScene:
    """The scene of a server, shared by all its browsers.

    Args:
        num_robots: how many are drawn, in a square.
        see_through: draw the robots so that the marks inside them are seen.

    Attributes:
        bodies: handles by index into `Robot.body_names`, one instance per robot: to listen to the mouse.
        places: where each robot stands when it has not moved (num_robots, 3) [m].
        offset: of the world in the browser [m], by which the camera follows a robot.
    """

    def __init__(self, server: viser.ViserServer, robot: Robot, num_robots: int, see_through: bool = False):
        self._server = server
        self._robot = robot
        self._model = visual_model(robot, coarse=num_robots > 4)
        self._data = mujoco.MjData(self._model)
        self.num_robots = num_robots
        self.places = square_of_places(num_robots)
        self.offset = np.zeros(3)
        self.overlays = True
        self._world = server.scene.add_frame(_ROOT, show_axes=False)
        self._add_floor()
        still = np.tile([1.0, 0.0, 0.0, 0.0], (num_robots, 1)), self.places
        self.bodies = {
            body - 1: server.scene.add_batched_glb(f"{_ROOT}/body_{body}", glb, *still, lod="off")
            for body, glb in body_glbs(self._model, 0.35 if see_through else 1.0).items()
        }
        self._xpos = np.zeros((self._model.nbody, num_robots, 3))
        self._xquat = np.zeros((self._model.nbody, num_robots, 4))
        self._pushed = np.zeros((self._model.nbody - 1, num_robots, 3))
        self._marks = Marks(server, num_robots)

    def draw(self, session: Session, tick: int, watched: int, follow: bool) -> None:
        """Show a tick of the session's last step; `watched` is the robot with all its marks."""
        ticks = session.ticks
        tick = min(tick, len(ticks) - 1)
        self._place_bodies(ticks, tick)
        self._move_world(ticks["root_position"][watched, tick], watched, follow)
        with self._server.atomic():
            self._world.position = self.offset
            for body, handle in self.bodies.items():
                handle.batched_positions = self._xpos[1 + body].astype(np.float32)
                handle.batched_wxyzs = self._xquat[1 + body].astype(np.float32)
            self._show_pushes(session, tick)
            self._marks.show_states(self._xpos[1], session.verdicts.state if self.num_robots > 1 else None)
            moment = Moment.of(ticks, robot=watched, tick=tick)
            self._marks.show_balance(moment, self.places[watched], self.overlays)

    def in_world(self, point: np.ndarray) -> np.ndarray:
        """A point of the browser's coordinates in those of the simulation [m]."""
        return np.asarray(point) - self.offset

    def add_hint(self, text: str) -> viser.LabelHandle:
        """Words above the first robot."""
        place = self.places[0] + [0.0, 0.0, 2.05]
        return self._server.scene.add_label(
            f"{_ROOT}/hint", text, position=place, visible=bool(text), anchor="bottom-center", font_screen_scale=1.2
        )

    def remove(self) -> None:
        self._world.remove()  # and all that is below it

    def _place_bodies(self, ticks: StepRecord, tick: int) -> None:
        qpos = np.concatenate(
            [ticks["root_position"][:, tick], ticks["root_orientation"][:, tick], ticks.joint_position[:, tick]],
            axis=1,
        )
        for robot in range(self.num_robots):
            self._data.qpos[:] = qpos[robot]
            mujoco.mj_kinematics(self._model, self._data)
            self._xpos[:, robot] = self._data.xpos + self.places[robot]
            self._xquat[:, robot] = self._data.xquat
            self._pushed[:, robot] = self._data.xipos[1:] + self.places[robot]

    def _show_pushes(self, session: Session, tick: int) -> None:
        pushes, everyone = session.pushes, np.arange(self.num_robots)
        is_held = np.zeros((self.num_robots, pushes.num_slots), bool)
        is_held[:, HAND] = session.is_held
        self._marks.show_pushes(
            centers=self._pushed[pushes.body, everyone[:, None]].reshape(-1, 3),
            force=pushes.force.reshape(-1, 3),
            since=session.since(tick).ravel(),
            is_held=is_held.ravel(),
        )

    def _move_world(self, root: np.ndarray, watched: int, follow: bool) -> None:
        # The world moves, not the camera: who orbits it is not disturbed.
        goal = np.zeros(3)
        if follow:
            goal[:2] = -(self.places[watched] + root)[:2]
        self.offset = self.offset + 0.12 * (goal - self.offset)

    def _add_floor(self) -> None:
        scene = self._server.scene
        scene.add_grid(
            f"{_ROOT}/floor",
            plane="xy",
            infinite_grid=True,
            cell_size=0.5,
            section_size=1.0,
            cell_color=(176, 186, 198),
            section_color=(150, 161, 176),
            cell_thickness=0.6,
            section_thickness=1.0,
            plane_color=(190, 199, 210),
            plane_opacity=1.0,
            shadow_opacity=0.4,
            fade_distance=40.0,
            fade_strength=1.0,
        )
        if self.num_robots > 1:
            return  # distances from which of them?
        for axis, name in ((0, "forward"), (1, "left")):
            for meters in (1, 2, 3, 4):
                place = np.zeros(3)
                place[axis] = meters
                scene.add_label(
                    f"{_ROOT}/distance_{name}_{meters}",
                    f"{meters} m" + (f" {name}" if meters == 1 else ""),
                    position=place + [0, 0, 0.01],
                    font_size_mode="scene",
                    font_scene_height=0.045,
                    depth_test=True,
                    anchor="bottom-center",
                )


class Marks:
    """Push arrows and states of all robots; balance of the watched one."""

    def __init__(self, server: viser.ViserServer, num_robots: int):
        scene = server.scene
        nothing = np.zeros((1, 2, 3))
        self._pushes = scene.add_arrows(
            f"{_ROOT}/push", nothing, PUSH, shaft_radius=0.022, head_radius=0.05, head_length=0.12, visible=False
        )
        self._forces = scene.add_arrows(
            f"{_ROOT}/foot_force", nothing, FORCE, shaft_radius=0.009, head_radius=0.022, head_length=0.06
        )
        self._support = scene.add_line_segments(
            f"{_ROOT}/support", nothing, SUPPORT, thickness=0.012, thickness_units="world"
        )
        self._plumb = scene.add_line_segments(
            f"{_ROOT}/com_line", nothing, COM, thickness=0.006, thickness_units="world"
        )
        self._com = scene.add_icosphere(f"{_ROOT}/com", 0.045, color=COM)
        self._com_ground = scene.add_cylinder(f"{_ROOT}/com_ground", 0.028, 0.02, color=COM)
        self._captured = scene.add_cylinder(f"{_ROOT}/capture_point", 0.05, 0.012, color=CAPTURED)
        self._escaped = scene.add_cylinder(f"{_ROOT}/capture_point_beyond", 0.05, 0.012, color=ESCAPED)
        self._pressure = scene.add_box(f"{_ROOT}/pressure", color=PRESSURE, dimensions=(0.05, 0.05, 0.016))
        self._discs: viser.BatchedMeshHandle | None = None
        if num_robots > 1:
            disc = _disc(0.42)
            self._discs = scene.add_batched_meshes_simple(
                f"{_ROOT}/states",
                *disc,
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
        shown = (since < _AFTERGLOW) & (np.linalg.norm(force, axis=1) > 1.0)
        self._pushes.visible = bool(shown.any())
        if not shown.any():
            return
        strength = np.linalg.norm(force[shown], axis=1)[:, None]
        direction = force[shown] / strength
        length = np.clip(strength * PUSH_LENGTH, 0.2, _MAX_PUSH)
        tips = centers[shown] + np.where(is_held[shown, None], _SURFACE + length, -_SURFACE) * direction
        self._pushes.points = np.stack([tips - length * direction, tips], axis=1).astype(np.float32)
        self._pushes.colors = np.where(since[shown, None] < 0.0, PUSH, PUSH_PAST).astype(np.uint8)

    def show_states(self, root: np.ndarray, states: np.ndarray | None) -> None:
        """A disc in the colour of its state under each root (N, 3) [m] of a crowd."""
        if self._discs is None or states is None:
            return
        self._discs.batched_positions = (root * [1, 1, 0] + [0, 0, 0.003]).astype(np.float32)
        self._discs.batched_colors = np.array([STATE_COLORS[State(state)] for state in states], np.uint8)

    def show_balance(self, moment: Moment, place: np.ndarray, visible: bool) -> None:
        """CoM, capture point, support polygon, CoP and foot forces of one robot."""
        com, captured = moment.com_position + place, moment.is_captured
        ground = np.array([com[0], com[1], 0.012])
        capture = np.append(moment.capture_point, 0.01) + place
        self._com.position, self._com_ground.position = com, ground
        self._plumb.points = np.array([[com, ground]], np.float32)
        self._captured.position = self._escaped.position = capture
        for mark in (self._com, self._com_ground, self._plumb):
            mark.visible = visible
        self._captured.visible, self._escaped.visible = visible and captured, visible and not captured
        self._show_support(moment, place, visible)
        force, points = moment.foot_force, moment.foot_pressure_point
        loaded = force > 5.0
        self._forces.visible = self._pressure.visible = visible and bool(loaded.any())
        if loaded.any():
            feet = points[loaded] + place
            tips = feet + np.outer(force[loaded] * FORCE_LENGTH, [0, 0, 1])
            self._forces.points = np.stack([feet, tips], axis=1).astype(np.float32)
            self._pressure.position = (force[:, None] * points).sum(axis=0) / force.sum() + place + [0, 0, 0.01]

    def _show_support(self, moment: Moment, place: np.ndarray, visible: bool) -> None:
        corners = moment.support_polygon
        self._support.visible = visible and len(corners) > 1
        if len(corners) > 1:
            raised = np.column_stack([corners, np.full(len(corners), 0.008)]) + place
            self._support.points = np.stack([raised, np.roll(raised, -1, axis=0)], axis=1).astype(np.float32)


def square_of_places(num_robots: int) -> np.ndarray:
    """Places (num_robots, 3) [m] of a square crowd around the origin, the first in its front row."""
    side = int(np.ceil(np.sqrt(num_robots)))
    row, column = np.divmod(np.arange(num_robots), side)
    middle = 0.5 * (side - 1)
    return SPACING * np.stack([middle - row, middle - column, np.zeros(num_robots)], axis=1)


def _disc(radius: float, corners: int = 40) -> tuple[np.ndarray, np.ndarray]:
    """A flat round mesh that faces up."""
    angle = np.linspace(0.0, 2.0 * np.pi, corners, endpoint=False)
    rim = radius * np.stack([np.cos(angle), np.sin(angle), np.zeros(corners)], axis=1)
    numbers = np.arange(corners)
    faces = np.stack([np.full(corners, corners), numbers, (numbers + 1) % corners], axis=1)
    return np.vstack([rim, np.zeros(3)]), faces
