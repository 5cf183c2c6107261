"""Controls: the panel of buttons and sliders, and the keys."""

from __future__ import annotations

import tempfile
import threading
from pathlib import Path
from typing import TYPE_CHECKING

import viser

from surefoot.errors import UserError
from surefoot.physics.pushes import Push, horizontal_push
from surefoot.viewer.clip import SECONDS, save_clip
from surefoot.viewer.session import FRICTION
from surefoot.viewer.source import offered_policies

if TYPE_CHECKING:
    from surefoot.viewer.page import Page

CROWDS = ("1", "4", "16", "36", "64")
_OTHER = "other ..."
_KEYS = {"space": "pause", "N": "one step", "R": "reset", "F": "follow", "X": "see through"}
_HELP = (
    '<div style="font:13px/1.5 system-ui,sans-serif;padding:6px 12px 4px">'
    "<b>Drag</b> any part of the robot with the mouse, press an <b>arrow key</b>, or press <b>Push</b>."
    '<div style="opacity:.65;font-size:12px">'
    + " · ".join(f'<span style="white-space:nowrap"><b>{key}</b> {what}</span>' for key, what in _KEYS.items())
    + "<br>drag the floor to turn the view, wheel to zoom</div></div>"
)


class Controls:
    """All that a user can set, and what happens then. The page does it."""

    def __init__(self, page: Page, runs: Path):
        self._page = page
        self._runs = runs
        self._gui = page.server.gui
        self._gui.add_html(_HELP)
        with self._gui.add_folder("Push"):
            self._add_pushes()
        with self._gui.add_folder("Policy and robots"):
            self._add_policy()
        with self._gui.add_folder("Time"):
            self._add_time()
        with self._gui.add_folder("View"):
            self._add_view()
        self._add_keys()

    @property
    def body(self) -> str:
        return self._body.value.replace(" ", "_")

    @property
    def impulse(self) -> float:
        return float(self._impulse.value)

    def set_impulse(self, impulse: int) -> None:
        """Move the slider [Ns]."""
        self._impulse.value = impulse  # type: ignore[misc] # as in _toggle

    @property
    def duration(self) -> float:
        return float(self._duration.value)

    def _add_pushes(self) -> None:
        page, gui = self._page, self._gui
        bodies = [name.replace("_", " ") for name in page.player.session.robot.pushable if name != "root"]
        self._body = gui.add_dropdown("Body", bodies, initial_value="root")
        self._angle = gui.add_slider(
            "Direction",
            min=-180,
            max=180,
            step=15,
            initial_value=0,
            marks=((-180, "back"), (-90, "right"), (0, "forward"), (90, "left"), (180, "back")),
            hint="degrees, as the robot sees it",
        )
        self._impulse = gui.add_slider("Impulse [Ns]", min=6, max=480, step=6, initial_value=90)
        self._duration = gui.add_slider("Duration [s]", min=0.02, max=1.0, step=0.02, initial_value=0.12)
        button = gui.add_button("Push", icon=viser.Icon.HAND_MOVE, color=(226, 88, 24))

        @button.on_click
        def _(_: viser.GuiEvent) -> None:
            push = self._chosen_push()
            page.push(lambda session: session.push(push))

        height = gui.add_slider("Height [m]", min=0.05, max=0.6, step=0.05, initial_value=0.3)
        drop = gui.add_button_group("", ("Drop", "Lift and push"))

        @drop.on_click
        def _(event: viser.GuiEvent) -> None:
            fall, push = float(height.value), self._chosen_push()
            if event.target.value == "Drop":
                page.push(lambda session: session.drop(fall))
            else:
                page.push(lambda session: session.lift_and_push(push))

    def _chosen_push(self) -> Push:
        return horizontal_push(self.body, float(self._angle.value), self.impulse, self.duration)

    def _add_policy(self) -> None:
        page, gui = self._page, self._gui
        self._policies = policies = gui.add_dropdown("Policy", self._offered(), initial_value=page.source.name)
        other = gui.add_text("File or run", "", hint="a policy file or a run folder, then Enter", visible=False)

        @policies.on_update
        def _(_: viser.GuiEvent) -> None:
            other.visible = policies.value == _OTHER
            if policies.value != _OTHER:
                page.set_source(policies.value)

        @other.on_update
        def _(_: viser.GuiEvent) -> None:
            if other.value.strip():
                page.set_source(other.value.strip())

        crowd = gui.add_dropdown("Robots", CROWDS, initial_value=str(page.player.session.num_robots))
        crowd.on_update(lambda _: page.set_num_robots(int(crowd.value)))
        noise = gui.add_slider("Noise [%]", min=0, max=100, step=10, initial_value=0, hint="of the paper's noise")
        friction = gui.add_slider("Friction", min=0.1, max=1.5, step=0.05, initial_value=FRICTION)
        stands_up = gui.add_checkbox("Stand up again", initial_value=True, hint="after a fall, by itself")

        @noise.on_update
        def _(_: viser.GuiEvent) -> None:
            page.player.do(lambda session: session.set_noise(float(noise.value) / 100.0))

        @friction.on_update
        def _(_: viser.GuiEvent) -> None:
            page.player.do(lambda session: session.set_friction(float(friction.value)))

        @stands_up.on_update
        def _(_: viser.GuiEvent) -> None:
            page.player.do(lambda session: setattr(session, "stands_up", bool(stands_up.value)))

    def refresh_policies(self) -> None:
        """Offer run folders that are new."""
        if self._policies.options != self._offered():
            self._policies.options = self._offered()

    def _offered(self) -> tuple[str, ...]:
        return (*offered_policies(self._runs, self._page.source.name), _OTHER)

    def _add_time(self) -> None:
        page, gui = self._page, self._gui
        buttons = gui.add_button_group("", ("Pause", "Step", "Reset"))

        @buttons.on_click
        def _(event: viser.GuiEvent) -> None:
            {"Pause": self._pause, "Step": page.player.single_step, "Reset": self._reset}[event.target.value]()

        speed = gui.add_slider("Speed", min=0.05, max=1.0, step=0.05, initial_value=1.0, hint="1 is real time")

        @speed.on_update
        def _(_: viser.GuiEvent) -> None:
            page.player.speed = float(speed.value)

        clip = gui.add_button(f"Save the last {SECONDS:.0f} s as MP4", icon=viser.Icon.MOVIE)

        @clip.on_click
        def _(event: viser.GuiEvent) -> None:
            if event.client:
                threading.Thread(target=self._send_clip, args=(event.client,), daemon=True).start()

    def _pause(self) -> None:
        self._page.player.paused = not self._page.player.paused

    def _reset(self) -> None:
        page = self._page
        page.history.clear()
        page.player.do(lambda session: session.reset())

    def _send_clip(self, client: viser.ClientHandle) -> None:
        page = self._page
        note = client.add_notification("clip", "drawing the film", loading=True)
        try:
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "surefoot.mp4"
                save_clip(path, page.player.session.robot, page.clip.shots())
                client.send_file_download("surefoot.mp4", path.read_bytes())
            note.remove()
        except UserError as error:
            note.remove()
            client.add_notification("clip", str(error), color="red")

    def _add_view(self) -> None:
        page, gui = self._page, self._gui
        self._follow = gui.add_checkbox("Follow", initial_value=page.follow)
        self._see_through = gui.add_checkbox("See through", initial_value=page.see_through)
        overlays = gui.add_checkbox("Marks", initial_value=True)

        @self._follow.on_update
        def _(_: viser.GuiEvent) -> None:
            page.follow = bool(self._follow.value)

        @self._see_through.on_update
        def _(_: viser.GuiEvent) -> None:
            page.set_see_through(bool(self._see_through.value))

        @overlays.on_update
        def _(_: viser.GuiEvent) -> None:
            page.set_overlays(bool(overlays.value))

    def _add_keys(self) -> None:
        page, gui = self._page, self._gui
        self._push_by(gui.add_command("Push away from the viewer", hotkey="arrowup"), 0, 1)
        self._push_by(gui.add_command("Push towards the viewer", hotkey="arrowdown"), 0, -1)
        self._push_by(gui.add_command("Push to the left on the screen", hotkey="arrowleft"), -1, 0)
        self._push_by(gui.add_command("Push to the right on the screen", hotkey="arrowright"), 1, 0)
        gui.add_command("Pause or go on", hotkey="space").on_trigger(lambda _: self._pause())
        gui.add_command("One step", hotkey="N").on_trigger(lambda _: page.player.single_step())
        gui.add_command("Reset", hotkey="R").on_trigger(lambda _: self._reset())
        gui.add_command("Camera follows", hotkey="F").on_trigger(lambda _: _toggle(self._follow))
        gui.add_command("See through", hotkey="X").on_trigger(lambda _: _toggle(self._see_through))

    def _push_by(self, command: viser.CommandHandle, right: int, away: int) -> None:
        @command.on_trigger
        def _(event: viser.CommandEvent) -> None:
            if event.client:
                self._page.push_from_screen(event.client, right, away, self)


def _toggle(box: viser.GuiCheckboxHandle) -> None:
    box.value = not box.value  # type: ignore[misc] # viser declares the setter where mypy does not look
