"""Page: one server, one session, any number of browsers, all of which see and push the same robots."""

from __future__ import annotations

import contextlib
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Literal

import numpy as np
import rich
import viser

from surefoot.errors import UserError
from surefoot.physics.pushes import horizontal_push
from surefoot.viewer.browser_scene import BrowserScene
from surefoot.viewer.clip import ClipRecorder
from surefoot.viewer.controls import Controls
from surefoot.viewer.live import History, LivePanel
from surefoot.viewer.player import Player
from surefoot.viewer.session import Session
from surefoot.viewer.source import PolicySource

PORT = 8080
HAND_STIFFNESS = 500.0
"""The hand that drags a body is a spring [N/m]."""
HAND_FORCE = 800.0
"""Its largest force [N]."""
_FIELD_OF_VIEW = 38.0
_HORIZON, _ZENITH = (206, 214, 224), (138, 152, 171)
_HINT = "Drag me with the mouse, or press an arrow key"
_HINT_CROWD = "Press an arrow key: all get the same push. Click one to watch it"
_PANEL_HZ = 8.0
_POLL_S = 1.0
# viser turns the camera by the arrow keys too: they stop here, below the document at which it listens.
_PAGE_SCRIPT = """<img alt="" style="display:none" src="data:," onerror="
document.title='surefoot';
if(!window.surefoot){window.surefoot=true;
document.documentElement.addEventListener('keydown',e=>{if(e.key.startsWith('Arrow'))e.stopPropagation()});}">"""


class Page:
    """The live page.

    Args:
        source: the policy to begin with.
        num_robots: 1 to 64.
        host, port: where it listens.
        runs: folder whose run folders are offered.

    Raises:
        UserError: the port is in use, or the number of robots will not do.
    """

    def __init__(
        self,
        source: PolicySource,
        num_robots: int = 1,
        host: str = "127.0.0.1",
        port: int = PORT,
        runs: Path = Path("runs"),
    ):
        check_port(host, port)
        session = Session(source.policy, num_robots)  # refused before anything listens
        self.source = source
        self.watched = 0
        self.follow = num_robots == 1
        self.see_through = False
        self.history = History()
        self.clip = ClipRecorder()
        self._is_pushed = False
        self._last_panel = self._last_poll = 0.0
        with _quiet():
            self.server = viser.ViserServer(host=host, port=port, label="surefoot", verbose=False)
        self.player = Player(session, self._show, lambda: bool(self.server.get_clients()), self._remember)
        self._light()
        self.stage = self._build_stage(session)
        self._build_panels(runs)
        self.player.start()

    @property
    def address(self) -> str:
        """What a browser on this machine opens."""
        host = self.server.get_host()
        return f"http://{'127.0.0.1' if host in ('0.0.0.0', '::') else host}:{self.server.get_port()}"

    def close(self) -> None:
        """Stop the robots, then the server."""
        self.player.stop()
        with _quiet():
            self.server.stop()

    # What the panel and the keys ask for.

    def set_num_robots(self, num_robots: int) -> None:
        """Begin anew with another number of robots."""

        def rebuild(old: Session) -> None:
            session = Session(old.policy, num_robots)
            session.stands_up = old.stands_up
            session.set_noise(old.noise)
            if old.friction != session.friction:
                session.set_friction(old.friction)
            self.watched = 0
            self.history.clear()
            self.stage.remove()
            self.player.session = session
            self.stage = self._build_stage(session)
            self.follow = num_robots == 1
            for client in self.server.get_clients().values():
                client.camera.position, client.camera.look_at = camera_place(num_robots)

        self.player.do(rebuild)

    def set_see_through(self, see_through: bool) -> None:
        """Draw the robots such that the marks inside are seen, or not."""
        self.see_through = see_through

        def rebuild(session: Session) -> None:
            self.stage.remove()
            self.stage = self._build_stage(session)

        self.player.do(rebuild)

    def set_source(self, name: str) -> None:
        """Go on with another policy; one that cannot be had is reported, and the old one goes on."""

        def change(session: Session) -> None:
            source = PolicySource(name)
            session.set_policy(source.policy)
            self.source = source
            self.tell(f"{source.policy.name}: {source.description}", "policy")

        self.player.do(change)

    def set_overlays(self, visible: bool) -> None:
        """Show forces and points, or not."""
        self.player.do(lambda session: setattr(self.stage, "overlays", visible))

    def push_from_screen(self, client: viser.ClientHandle, right: float, away: float, controls: Controls) -> None:
        """Push as seen on a browser's screen: `right` and `away` from the viewer, a unit vector."""
        view = np.asarray(client.camera.look_at) - np.asarray(client.camera.position)
        angle = np.degrees(np.arctan2(view[1], view[0])) + np.degrees(np.arctan2(-right, away))
        angle = 15.0 * round(angle / 15.0)
        push = horizontal_push(controls.body, angle, controls.impulse, controls.duration)
        self.push(lambda session: session.push(push) if not session.is_pushed() else None)

    def push(self, action: Callable[[Session], object]) -> None:
        """Do something that disturbs the robots; the hint has done its work then."""

        def disturb(session: Session) -> None:
            self._is_pushed, self._hint.visible = True, False
            action(session)

        self.player.do(disturb)

    def tell(self, message: str, title: str = "surefoot", color: Literal["gray", "red"] = "gray") -> None:
        """A notification in every browser."""
        for client in self.server.get_clients().values():
            client.add_notification(title=title, body=message, auto_close_seconds=6.0, color=color)

    # What the player shows.

    def _show(self, session: Session, tick: int) -> None:
        self.stage.draw(session, tick, self.watched, self.follow)
        now = time.monotonic()
        if now - self._last_panel > 1.0 / _PANEL_HZ:
            self._last_panel = now
            policy = f"{self.source.policy.name} · {self.source.description}"
            self.live.show(session, self.history, self.watched, policy, self._rates())
            if session.message:
                self.tell(session.message, "surefoot", "red")
                session.message = ""
        if now - self._last_poll > _POLL_S:
            self._last_poll = now
            self._look_for_news(session)

    def _remember(self, session: Session) -> None:
        self.history.add(session, self.watched)
        self.clip.add(session, self.watched)

    def _rates(self) -> str:
        player = self.player
        if player.paused:
            return "paused"
        return f"{player.speed * min(player.real_time, 1.0):.2f} × real time, {player.frame_rate:.0f} frames/s"

    def _look_for_news(self, session: Session) -> None:
        try:
            if self.source.refresh():
                session.set_policy(self.source.policy)
                self.tell(f"new checkpoint of {self.source.name}: {self.source.description}", "policy")
            self.controls.refresh_policies()
        except UserError as error:
            session.message = str(error)

    # How the page is made.

    def _build_stage(self, session: Session) -> BrowserScene:
        with self.server.atomic():
            stage = BrowserScene(self.server, session.robot, session.num_robots, self.see_through)
            self._add_key_light(session.num_robots)
            self._hint = stage.add_hint("" if self._is_pushed else _HINT_CROWD if session.num_robots > 1 else _HINT)
        for body, handle in stage.bodies.items():
            self._listen(body, handle)
        return stage

    def _listen(self, body: int, handle: viser.BatchedGlbHandle) -> None:
        @handle.on_drag
        async def _(event: viser.SceneNodeDragEvent) -> None:
            robot = event.instance_index or 0
            stretch = np.subtract(event.end_position, event.start_position)
            force = HAND_STIFFNESS * stretch
            force *= min(1.0, HAND_FORCE / max(float(np.linalg.norm(force)), 1e-9))
            if event.phase == "end":
                self.player.do(lambda session: session.release(robot))
            else:
                self.push(lambda session: session.pull(robot, body, force))

        @handle.on_click
        async def _(event: viser.SceneNodePointerEvent) -> None:
            robot = event.instance_index or 0
            if robot != self.watched:
                self.watched = robot
                self.history.clear()

    def _light(self) -> None:
        scene = self.server.scene
        scene.set_up_direction("+z")
        scene.set_background_image(_sky(), format="png")
        scene.configure_environment_map("studio", environment_intensity=0.3)
        scene.configure_default_lights(enabled=False)
        scene.add_light_hemisphere("/light/sky", sky_color=(255, 255, 255), ground_color=(150, 160, 175), intensity=0.7)
        camera = self.server.initial_camera
        camera.fov = float(np.radians(_FIELD_OF_VIEW))
        camera.position, camera.look_at = camera_place(self.player.session.num_robots)

    def _add_key_light(self, num_robots: int) -> None:
        """A soft spot from the front left, far enough to cover all robots; it casts the shadows."""
        away = 1.0 + 0.5 * (np.ceil(np.sqrt(num_robots)) - 1.0)
        self.server.scene.add_light_spot(
            "/light/key",
            position=(3.5 * away, 3.0 * away, 7.0 * away),
            direction=(-0.42, -0.36, -0.83),
            intensity=75.0 * away**2,
            angle=0.5,
            penumbra=1.0,
            cast_shadow=True,
        )

    def _build_panels(self, runs: Path) -> None:
        gui = self.server.gui
        gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(226, 88, 24), control_width="medium")
        gui.add_html(_PAGE_SCRIPT)
        self.controls = Controls(self, runs)
        gui.main_panel.dock_right()
        panel = gui.add_panel()
        with panel.add_tab("Live", viser.Icon.ACTIVITY):
            self.live = LivePanel(self.server)
        panel.dock_left()
        panel.set_width(340)


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """viser greets and says goodbye through rich's own console, which nobody else uses."""
    console = rich.get_console()
    before, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = before


def _sky(height: int = 256) -> np.ndarray:
    """A background that is bright at the horizon, in the middle, and darker above: uint8 (height, 16, 3)."""
    above = np.clip(1.0 - 2.0 * np.arange(height) / height, 0.0, 1.0)[:, None]
    color = (1.0 - above) * np.array(_HORIZON) + above * np.array(_ZENITH)
    return np.repeat(np.rint(color).astype(np.uint8)[:, None], 16, axis=1)


def check_port(host: str, port: int) -> None:
    """Raises UserError: nobody can listen there."""
    try:
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((host, port))
    except (OSError, OverflowError) as error:
        reason = (getattr(error, "strerror", None) or str(error)).lower()
        raise UserError(
            f"cannot listen on {host}:{port}: {reason}; valid: a free --port, such as {port + 1}"
        ) from error


def camera_place(num_robots: int) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Position of the camera, and what it looks at [m]: all of one robot, or the middle of a crowd."""
    side = float(np.ceil(np.sqrt(num_robots))) - 1.0
    away = 1.0 + 0.8 * side
    return (3.6 * away, 2.5 * away, 1.45 + 1.1 * side), (0.0, 0.0, 0.93)
