"""Page: one server, one session, any number of browsers, all of which see and push the same robots."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import viser

from surefoot.errors import UserError
from surefoot.rendering.framing import REFERENCE_HEIGHT, scale_of
from surefoot.viewer.browser_scene import BrowserScene
from surefoot.viewer.clip import ClipRecorder
from surefoot.viewer.controls import Controls
from surefoot.viewer.filming import Filming
from surefoot.viewer.guard import Guard
from surefoot.viewer.history import History
from surefoot.viewer.live_panel import LivePanel, legend_html
from surefoot.viewer.markup import render
from surefoot.viewer.playback import Kept, Playback, Shown, Takes
from surefoot.viewer.player import Player
from surefoot.viewer.server import add_key_light, camera_place, check_port, place_camera, start_server, stop_server
from surefoot.viewer.session import Session
from surefoot.viewer.source import PolicySource
from surefoot.viewer.verdict import State

PORT = 8080
_HAND_STIFFNESS = 0.66
"""The hand that drags a body is a spring: its force in robot weights when it is stretched by the robot's height."""
_HAND_FORCE = 0.6
"""Its largest force in robot weights."""
_HINT = "Drag me, or press Push"
_HINT_CROWD = "Press Push: all get the same push. Click one to watch it"
_PANEL_HZ = 8.0
_POLL_S = 1.0


class Page:
    """The live page.

    Args:
        source: the policy to begin with.
        num_robots: 1 to 64.
        host: name or address at which it listens.
        port: at which it listens; 0 for any that is free.
        folders: folders whose runs and policy files are offered; the page plays no others.
        names: further names by which browsers reach this machine.

    Raises:
        UserError: the port is in use, or the number of robots will not do.
    """

    def __init__(
        self,
        source: PolicySource,
        num_robots: int = 1,
        host: str = "127.0.0.1",
        port: int = PORT,
        folders: Sequence[Path] = (Path("runs"),),
        names: Sequence[str] = (),
    ):
        check_port(host, port)
        session = Session(source.policy, num_robots)  # refused before anything listens
        self.source = source
        self.watched = 0
        self.follow = num_robots == 1
        self.see_through = False
        self.history = History()
        self.clip = ClipRecorder()
        self.takes = Takes()
        self._scale = scale_of(session.robot)
        self._is_pushed = False
        self._last_panel = self._last_poll = 0.0
        self._filming = Filming(self._show_film)
        self._is_closing = False
        self.guard = Guard(host, names)
        self.server = start_server(host, port, self.guard)
        camera = self.server.initial_camera
        camera.position, camera.look_at = camera_place(num_robots, self._scale)
        self._last_shown: Shown = session
        self.player = Player(session, self._show, lambda: bool(self.server.get_clients()), self._remember)
        self.scene = self._build_scene(session)
        self._build_panels(folders)
        self.server.on_client_connect(lambda client: place_camera(client.camera, self.scene.num_robots, self._scale))
        self.player.start()

    @property
    def address(self) -> str:
        """The address for a browser on this machine; without the token it is refused."""
        return f"{self.origin}/?token={self.guard.token}"

    @property
    def origin(self) -> str:
        """The address without its token."""
        host = self.server.get_host()
        return f"http://{'127.0.0.1' if host in ('0.0.0.0', '::') else host}:{self.server.get_port()}"

    def close(self) -> None:
        """Stop the film that is being drawn and the robots, then the server."""
        self._is_closing = True
        self._filming.cancel()
        self.player.stop()
        stop_server(self.server)

    # What the panel and the keys ask for.

    def set_num_robots(self, num_robots: int) -> None:
        """Begin anew with another number of robots."""

        def rebuild(old: Session) -> None:
            session = Session(old.policy, num_robots)
            session.deeds = old.deeds
            session.stands_up = old.stands_up
            session.set_noise(old.noise)
            if old.friction != old.robot.friction:
                session.set_friction(old.friction)
            self.watched = 0
            self.player.session, self.player.playback = session, None
            self.follow = num_robots == 1

        self.player.do(rebuild)

    def set_see_through(self, see_through: bool) -> None:
        """Draw the robots such that the marks inside are seen, or not."""
        self.see_through = see_through

        self.player.do(lambda session: self._rebuild_scene(self.player.shown))

    def set_source(self, name: str) -> None:
        """Go on with another policy; one that cannot be had is reported, and the old one goes on."""

        def change(session: Session) -> None:
            source = PolicySource(name, session.robot)
            session.set_policy(source.policy)
            self.source = source
            self.tell(f"{source.policy.name}: {source.description}", "policy")

        self.player.do(change)

    def set_overlays(self, visible: bool) -> None:
        """Show forces and points, or not."""
        self.player.do(lambda session: setattr(self.scene, "overlays", visible))

    def push(self, action: Callable[[Session], object]) -> None:
        """Do something that disturbs the robots; the hint has done its work then."""

        def disturb(session: Session) -> None:
            self._is_pushed, self._hint.visible = True, False
            self.player.playback = None
            action(session)

        self.player.do(disturb)

    def reset(self) -> None:
        """Put all robots back to their places."""

        def do(session: Session) -> None:
            self.history.clear()
            self.player.playback = None
            session.reset()

        self.player.do(do)

    def see_again(self, number: int) -> None:
        """Show what the watched robot did at one of the last deeds, 0 for the newest; the live robots wait for it."""

        def play(session: Session) -> None:
            deeds = list(session.deeds)
            take = self.takes.of(deeds[number]) if number < len(deeds) else ()
            if not take:
                raise UserError(f"push number {number + 1} has not been seen yet" if deeds else "nobody has pushed yet")
            self.player.playback = Playback(take, session, deeds[number].words)

        self.player.do(play)

    def show_trial(self, words: str, take: list[Kept]) -> None:
        """List a trial, as `playback.take_of` returns it, among the last pushes, and play it."""

        def play(session: Session) -> None:
            session.deeds.begin(words)
            is_recovered = take[-1].state == State.RECOVERED
            session.deeds.count(int(is_recovered), int(not is_recovered), take[-1].words)
            self._is_pushed, self._hint.visible = True, False
            deed = session.deeds.newest
            assert deed
            self.takes.keep(deed, take)

        self.player.do(play)
        self.see_again(0)

    def send_clip(self, client: viser.ClientHandle) -> None:
        """Give a browser the last seconds as a film, drawn by another process; one at a time."""
        try:
            film = self._filming.draw(self.player.session.robot, self.clip.shots())
            if self._is_here(client):
                client.send_file_download("surefoot.mp4", film, save_immediately=True)
        except UserError as error:
            if self._is_here(client):
                client.add_notification("film", str(error), auto_close_seconds=6.0, color="red")

    def cancel_clip(self) -> None:
        """End the film that is being drawn."""
        self._filming.cancel()

    def tell(self, message: str, title: str = "surefoot", color: Literal["gray", "red"] = "gray") -> None:
        """Show a notification in every browser."""
        for client in self.server.get_clients().values():
            client.add_notification(title=title, body=message, auto_close_seconds=6.0, color=color)

    def _is_here(self, client: viser.ClientHandle) -> bool:
        """Can this browser still be told something?"""
        return not self._is_closing and client.client_id in self.server.get_clients()

    # What the player shows.

    def _show(self, shown: Shown, tick: int) -> None:
        if shown is not self._last_shown:
            self._turn_to(shown)
        session, watched = self.player.session, self._watched_of(shown)
        self.scene.draw(shown, tick, watched, self.follow or shown is not session)
        now = time.monotonic()
        if now - self._last_panel > 1.0 / _PANEL_HZ:
            self._last_panel = now
            self.live.show(shown, self.history, watched, self._policy_words(shown), self._rates())
            if session.message:
                self.tell(session.message, "surefoot", "red")
                session.message = ""
        if now - self._last_poll > _POLL_S:
            self._last_poll = now
            self._look_for_news(session)

    def _turn_to(self, shown: Shown) -> None:
        """Show the live robots, or a playback, in the place of the other."""
        self._last_shown = shown
        self.history.clear()
        if shown.num_robots != self.scene.num_robots:
            self._rebuild_scene(shown)
            for client in self.server.get_clients().values():
                place_camera(client.camera, shown.num_robots, self._scale)

    def _watched_of(self, shown: Shown) -> int:
        return min(self.watched, shown.num_robots - 1)

    def _policy_words(self, shown: Shown) -> str:
        if isinstance(shown, Playback):
            return f"seen again: {shown.words}. A push or Reset goes back to the live robots"
        return " · ".join(word for word in (self.source.policy.name, self.source.description) if word)

    def _remember(self, shown: Shown) -> None:
        watched = self._watched_of(shown)
        self.history.add(shown, watched)
        self.clip.add(shown, watched)
        if isinstance(shown, Session):
            self.takes.add(shown, watched)

    def _show_film(self, share: float | None) -> None:
        if not self._is_closing:
            self.controls.show_film(share)

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

    def _rebuild_scene(self, shown: Shown) -> None:
        self.scene.remove()
        self.scene = self._build_scene(shown)

    def _build_scene(self, shown: Shown) -> BrowserScene:
        with self.server.atomic():
            scene = BrowserScene(self.server, shown.robot, shown.num_robots, self.see_through)
            add_key_light(self.server, shown.num_robots, self._scale)
            self._hint = scene.add_hint("" if self._is_pushed else _HINT_CROWD if shown.num_robots > 1 else _HINT)
        for body, handle in scene.bodies.items():
            self._listen(body, handle)
        return scene

    def _listen(self, body: int, handle: viser.BatchedGlbHandle) -> None:
        @handle.on_drag
        async def _(event: viser.SceneNodeDragEvent[Any]) -> None:
            robot = event.instance_index or 0
            if robot >= self.player.shown.num_robots:
                return
            robot = self.watched if self.player.playback else robot
            force = self._hand_force(np.subtract(event.end_position, event.start_position))
            self._watch(robot)
            if event.phase == "end":
                self.player.do(lambda session: session.release(robot))
            else:
                self.push(lambda session: session.pull(robot, body, force))

        @handle.on_click
        async def _(event: viser.SceneNodePointerEvent[Any]) -> None:
            if not self.player.playback:
                self._watch(event.instance_index or 0)

    def _watch(self, robot: int) -> None:
        if robot != self.watched and robot < self.player.session.num_robots:
            self.watched = robot
            self.history.clear()

    def _hand_force(self, stretch: np.ndarray) -> np.ndarray:
        """The force (3,) [N] of a hand that is away (3,) [m] from where it took hold."""
        share = _HAND_STIFFNESS / (REFERENCE_HEIGHT * self._scale) * stretch
        share *= min(1.0, _HAND_FORCE / max(float(np.linalg.norm(share)), 1e-9))
        return np.asarray(self.player.session.robot.weight * share)

    def _build_panels(self, folders: Sequence[Path]) -> None:
        gui = self.server.gui
        gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(226, 88, 24), control_width="medium")
        gui.add_html(render("page_script"))
        verdict = gui.add_html("")
        self.controls = Controls(gui, self, folders)
        gui.add_html(legend_html())
        gui.main_panel.dock_right()
        panel = gui.add_panel()
        with panel.add_tab("Live", viser.Icon.ACTIVITY):
            self.live = LivePanel(self.server, self.player.session.robot, (verdict, self.controls.last_pushes))
        panel.dock_left()
        panel.set_width(340)
