"""Browser scene: the floor, light and robots, and the forces and points that decide whether they fall."""

from __future__ import annotations

import mujoco
import numpy as np
import viser

from surefoot.physics.step_record import StepRecord
from surefoot.rendering.framing import scale_of
from surefoot.rendering.moment import Moment
from surefoot.robots import Robot
from surefoot.viewer.body_meshes import body_glbs
from surefoot.viewer.marks import Marks
from surefoot.viewer.playback import Shown
from surefoot.viewer.session import HAND

# Lengths are for a robot of `framing.REFERENCE_HEIGHT` [m].
SPACING = 2.2
"""Between the places of a crowd's robots."""
_DISTANCES = (1.0, 0.5, 0.2, 0.1)
"""Between the labels on the floor [m]: the largest one that a robot of its size does not push out of the picture."""
_HINT_HEIGHT = 2.05
"""Of the words above the first robot."""
_FEW = 4
"""Up to so many robots are drawn with all their details."""
_WORLD = "/world"


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
        self._scale = scale_of(robot)
        self._model = robot.model()
        self._data = mujoco.MjData(self._model)
        self.num_robots = num_robots
        self.places = self._scale * square_of_places(num_robots)
        self.offset = np.zeros(3)
        self.overlays = True
        self._world = server.scene.add_frame(_WORLD, show_axes=False)
        self._add_floor()
        still = np.tile([1.0, 0.0, 0.0, 0.0], (num_robots, 1)), self.places
        glbs = body_glbs(robot, coarse=num_robots > _FEW, opacity=0.35 if see_through else 1.0)
        self.bodies = {
            body: server.scene.add_batched_glb(f"{_WORLD}/body_{body}", glb, *still, lod="off")
            for body, glb in glbs.items()
        }
        self._xpos = np.zeros((self._model.nbody - 1, num_robots, 3))
        self._xquat = np.zeros((self._model.nbody - 1, num_robots, 4))
        self._pushed = np.zeros((self._model.nbody - 1, num_robots, 3))
        self._marks = Marks(server, robot, num_robots, _WORLD)

    def draw(self, shown: Shown, tick: int, watched: int, follow: bool) -> None:
        """Show a tick of the last step that is shown; `watched` is the robot with all its marks."""
        ticks = shown.ticks
        tick = min(tick, len(ticks) - 1)
        self._place_bodies(ticks, tick)
        self._move_world(ticks["root_position"][watched, tick], watched, follow)
        with self._server.atomic():
            self._world.position = self.offset
            for body, handle in self.bodies.items():
                handle.batched_positions = self._xpos[body].astype(np.float32)
                handle.batched_wxyzs = self._xquat[body].astype(np.float32)
            self._show_pushes(shown, tick)
            self._marks.show_states(self._xpos[0], shown.verdicts.state if self.num_robots > 1 else None)
            moment = Moment.of(ticks, robot=watched, tick=tick)
            self._marks.show_balance(moment, self.places[watched], self.overlays)

    def in_world(self, point: np.ndarray) -> np.ndarray:
        """A point of the browser's coordinates in those of the simulation [m]."""
        return np.asarray(point) - self.offset

    def add_hint(self, text: str) -> viser.LabelHandle:
        """Words above the first robot."""
        place = self.places[0] + [0.0, 0.0, _HINT_HEIGHT * self._scale]
        return self._server.scene.add_label(
            f"{_WORLD}/hint", text, position=place, visible=bool(text), anchor="bottom-center", font_screen_scale=1.2
        )

    def remove(self) -> None:
        """Take everything out of the scene."""
        self._world.remove()  # and all that is below it

    def _place_bodies(self, ticks: StepRecord, tick: int) -> None:
        qpos = np.concatenate(
            [ticks["root_position"][:, tick], ticks["root_orientation"][:, tick], ticks.joint_position[:, tick]],
            axis=1,
        )
        for robot in range(self.num_robots):
            self._data.qpos[:] = qpos[robot]
            mujoco.mj_kinematics(self._model, self._data)
            self._xpos[:, robot] = self._data.xpos[1:] + self.places[robot]
            self._xquat[:, robot] = self._data.xquat[1:]
            self._pushed[:, robot] = self._data.xipos[1:] + self.places[robot]

    def _show_pushes(self, shown: Shown, tick: int) -> None:
        pushes, everyone = shown.pushes, np.arange(self.num_robots)
        is_held = np.zeros((self.num_robots, pushes.num_slots), bool)
        is_held[:, HAND] = shown.is_held
        self._marks.show_pushes(
            centers=self._pushed[pushes.body, everyone[:, None]].reshape(-1, 3),
            force=pushes.force.reshape(-1, 3),
            since=shown.since(tick).ravel(),
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
            f"{_WORLD}/floor",
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
        step = next((step for step in _DISTANCES if step <= 1.1 * self._scale), _DISTANCES[-1])
        for axis, name in ((0, "forward"), (1, "left")):
            for number in (1, 2, 3, 4):
                place = np.zeros(3)
                place[axis] = number * step
                scene.add_label(
                    f"{_WORLD}/distance_{name}_{number}",
                    f"{number * step:g} m" + (f" {name}" if number == 1 else ""),
                    position=place + [0, 0, 0.01],
                    font_size_mode="scene",
                    font_scene_height=0.05 * self._scale,
                    depth_test=True,
                    anchor="bottom-center",
                )


def square_of_places(num_robots: int) -> np.ndarray:
    """Places (num_robots, 3) of a square crowd around the origin, the first in its front row."""
    side = int(np.ceil(np.sqrt(num_robots)))
    row, column = np.divmod(np.arange(num_robots), side)
    middle = 0.5 * (side - 1)
    return SPACING * np.stack([middle - row, middle - column, np.zeros(num_robots)], axis=1)
