"""Controls: the panel of buttons and sliders, and the keys; other modules carry out their requests."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import viser

from surefoot.evaluation.protocol import protocol_for
from surefoot.physics.pushes import Push, horizontal_push
from surefoot.rendering.words import pushable_words
from surefoot.robots import Robot
from surefoot.viewer.clip import SECONDS
from surefoot.viewer.deeds import SHOWN
from surefoot.viewer.markup import render
from surefoot.viewer.player import MIN_SPEED, Player
from surefoot.viewer.session import Session
from surefoot.viewer.settings import Setting, choice, number
from surefoot.viewer.source import PolicySource, offered_policies

CROWDS = ("1", "4", "16", "36", "64")
_KEYS = {
    "space": "pause",
    "N": "one step",
    "R": "reset",
    "F": "follow",
    "X": "see through",
    "1 to 5": "see a push again",
}
_ARROWS = {
    "arrowup": ("Push away from the viewer", 0, 1),
    "arrowdown": ("Push towards the viewer", 0, -1),
    "arrowleft": ("Push to the left on the screen", -1, 0),
    "arrowright": ("Push to the right on the screen", 1, 0),
}
"""Of a key: what it does, and its direction on the screen, to the right and away from the viewer."""
_FIRST_IMPULSE, _LARGEST_IMPULSE = 15, 80
"""Of the slider, in steps of the robot's grid of impulses."""


class Actions(Protocol):
    """The actions that the controls request.

    Attributes:
        player: plays the session.
        source: where the policy comes from.
        follow: does the camera follow the watched robot?
    """

    player: Player
    source: PolicySource
    follow: bool

    def push(self, action: Callable[[Session], object]) -> None:
        """Do something that disturbs the robots."""

    def reset(self) -> None:
        """Put all robots back to their places."""

    def set_source(self, name: str) -> None:
        """Go on with another policy."""

    def set_num_robots(self, num_robots: int) -> None:
        """Begin anew with another number of robots."""

    def see_again(self, number: int) -> None:
        """Show what the watched robot did at one of the last deeds, 0 for the newest."""

    def set_see_through(self, see_through: bool) -> None:
        """Draw the robots such that the marks inside are seen, or not."""

    def set_overlays(self, visible: bool) -> None:
        """Show forces and points, or not."""

    def send_clip(self, client: viser.ClientHandle) -> None:
        """Give a browser the last seconds as a film."""

    def cancel_clip(self) -> None:
        """End the film that is being drawn."""


class Controls:
    """All that a user can set, and what happens then.

    Args:
        gui: where the panel is made.
        actions: object that carries out the requests.
        folders: folders whose runs and policy files are offered.

    Attributes:
        last_pushes: where a phone shows what was pushed.
    """

    def __init__(self, gui: viser.GuiApi, actions: Actions, folders: Sequence[Path]):
        self._gui = gui
        self._actions = actions
        self._folders = folders
        self._first_policy = actions.source.name
        with gui.add_folder("Push"):
            self._add_pushes(actions.player.session.robot)
        self.last_pushes = gui.add_html("")
        with gui.add_folder("Policy and robots"):
            self._add_policy()
            self._add_conditions()
        with gui.add_folder("Time"):
            self._add_time()
        with gui.add_folder("View"):
            self._add_view()
        gui.add_html(render("help", keys=_KEYS))
        self._add_keys()

    def set_impulse(self, impulse: float) -> None:
        """Move the slider [Ns]."""
        self._impulse.set(impulse)

    def show_film(self, share: float | None) -> None:
        """Show how much of a film has been drawn, 0 to 1, and the button that cancels it; None: there is none."""
        self._save.visible = share is None
        for handle in (self._film_title, self._film_bar, self._cancel):
            handle.visible = share is not None
        self._film_bar.value = round(100.0 * (share or 0.0))  # type: ignore[misc] # as in _toggle

    def refresh_policies(self) -> None:
        """Offer run folders that are new."""
        if self._policies.options != self._offered():
            self._policies.options = self._offered()

    def _add_pushes(self, robot: Robot) -> None:
        gui, step = self._gui, protocol_for(robot).impulse_step
        self._bodies = pushable_words(robot)
        body = gui.add_dropdown("Body", tuple(self._bodies), initial_value=next(iter(self._bodies)))
        self._body = Setting(body, choice("body", lambda: tuple(self._bodies)))
        angle = gui.add_slider(
            "Direction",
            min=-180,
            max=180,
            step=15,
            initial_value=0,
            marks=((-180, "back"), (-90, "right"), (0, "front"), (90, "left"), (180, "back")),
            hint="degrees, as the robot sees it",
        )
        self._angle = Setting(angle, number("direction", -180, 180))
        largest, first = round(_LARGEST_IMPULSE * step, 2), round(_FIRST_IMPULSE * step, 2)
        self._impulse = self._add_slider("Impulse [Ns]", "impulse", step, largest, step, first)
        self._duration = self._add_slider("Duration [s]", "duration", 0.02, 1.0, 0.02, 0.12)
        button = gui.add_button("Push", icon=viser.Icon.HAND_MOVE, color=(226, 88, 24))
        button.on_click(lambda _: self._push(self._chosen_push()))
        self._height = self._add_slider("Height [m]", "height", 0.05, 0.6, 0.05, 0.3)
        gui.add_button_group("", ("Drop", "Lift and push")).on_click(self._drop_or_lift)

    def _add_slider(
        self,
        label: str,
        name: str,
        low: float,
        high: float,
        step: float,
        first: float,
        on_change: Callable[[float], object] = lambda value: None,
        hint: str | None = None,
    ) -> Setting[float]:
        slider = self._gui.add_slider(label, min=low, max=high, step=step, initial_value=first, hint=hint)
        return Setting(slider, number(name, low, high), on_change)

    def _drop_or_lift(self, event: viser.GuiEvent[Any]) -> None:
        fall, push = self._height.value, self._chosen_push()
        if event.target.value == "Drop":
            self._actions.push(lambda session: session.drop(fall))
        elif event.target.value == "Lift and push":
            self._actions.push(lambda session: session.lift_and_push(push))

    def _push(self, push: Push) -> None:
        self._actions.push(lambda session: session.push(push))

    def _chosen_push(self) -> Push:
        return self._push_towards(self._angle.value)

    def _push_towards(self, angle_deg: float) -> Push:
        body = self._bodies[self._body.value]
        return horizontal_push(body, angle_deg, self._impulse.value, self._duration.value)

    def _add_policy(self) -> None:
        actions, gui = self._actions, self._gui
        self._policies = gui.add_dropdown("Policy", self._offered(), initial_value=self._first_policy)
        Setting(self._policies, choice("policy", self._offered), actions.set_source)
        crowd = gui.add_dropdown("Robots", CROWDS, initial_value=str(actions.player.session.num_robots))
        Setting(crowd, choice("robots", lambda: crowd.options), lambda value: actions.set_num_robots(int(value)))

    def _add_conditions(self) -> None:
        player, gui = self._actions.player, self._gui
        self._add_slider(
            *("Noise [%]", "noise", 0, 100, 10, 0),
            lambda noise: player.do(lambda session: session.set_noise(noise / 100.0)),
            "of the paper's noise",
        )
        self._add_slider(
            *("Friction", "friction", 0.1, 1.5, 0.05, float(np.clip(player.session.friction, 0.1, 1.5))),
            lambda friction: player.do(lambda session: session.set_friction(friction)),
        )
        stands_up = gui.add_checkbox("Stand up again", initial_value=True, hint="after a fall, by itself")

        @stands_up.on_update
        def _(_: viser.GuiEvent[Any]) -> None:
            player.do(lambda session: setattr(session, "stands_up", bool(stands_up.value)))

    def _offered(self) -> tuple[str, ...]:
        return offered_policies(self._actions.player.session.robot, self._folders, self._first_policy)

    def _add_time(self) -> None:
        actions, gui = self._actions, self._gui
        buttons = gui.add_button_group("", ("Pause", "Step", "Reset"))

        @buttons.on_click
        def _(event: viser.GuiEvent[Any]) -> None:
            deeds = {"Pause": self._pause, "Step": actions.player.single_step, "Reset": actions.reset}
            if event.target.value in deeds:
                deeds[event.target.value]()

        self._add_slider(
            *("Speed", "speed", MIN_SPEED, 1.0, 0.05, 1.0),
            lambda speed: setattr(actions.player, "speed", speed),
            "1 is real time",
        )
        self._save = gui.add_button(f"Save the last {SECONDS:.0f} s as MP4", icon=viser.Icon.MOVIE)
        self._film_title = gui.add_markdown("Drawing the film", visible=False)
        self._film_bar = gui.add_progress_bar(0.0, visible=False)
        self._cancel = gui.add_button("Cancel the film", icon=viser.Icon.X, color="gray", visible=False)
        self._cancel.on_click(lambda _: actions.cancel_clip())

        @self._save.on_click
        def _(event: viser.GuiEvent[Any]) -> None:
            if event.client:
                threading.Thread(target=actions.send_clip, args=(event.client,), daemon=True).start()

    def _pause(self) -> None:
        self._actions.player.paused = not self._actions.player.paused

    def _add_view(self) -> None:
        actions, gui = self._actions, self._gui
        self._follow = gui.add_checkbox("Follow", initial_value=actions.follow)
        self._see_through = gui.add_checkbox("See through", initial_value=False)
        overlays = gui.add_checkbox("Marks", initial_value=True)

        @self._follow.on_update
        def _(_: viser.GuiEvent[Any]) -> None:
            actions.follow = bool(self._follow.value)

        self._see_through.on_update(lambda _: actions.set_see_through(bool(self._see_through.value)))
        overlays.on_update(lambda _: actions.set_overlays(bool(overlays.value)))

    def _add_keys(self) -> None:
        actions, gui = self._actions, self._gui
        for key, (words, right, away) in _ARROWS.items():
            self._push_by(gui.add_command(words, hotkey=key), right, away)  # type: ignore[arg-type] # a literal's key
        gui.add_command("Pause or go on", hotkey="space").on_trigger(lambda _: self._pause())
        gui.add_command("One step", hotkey="N").on_trigger(lambda _: actions.player.single_step())
        gui.add_command("Reset", hotkey="R").on_trigger(lambda _: actions.reset())
        gui.add_command("Camera follows", hotkey="F").on_trigger(lambda _: _toggle(self._follow))
        gui.add_command("See through", hotkey="X").on_trigger(lambda _: _toggle(self._see_through))
        for place in range(SHOWN):
            self._see_again_by(gui, place)

    def _see_again_by(self, gui: viser.GuiApi, number: int) -> None:
        which = "the last push" if number == 0 else f"push {number + 1} of the last ones"
        command = gui.add_command(f"See {which} again", hotkey=str(number + 1))  # type: ignore[arg-type] # a digit
        command.on_trigger(lambda _: self._actions.see_again(number))

    def _push_by(self, command: viser.CommandHandle, right: int, away: int) -> None:
        @command.on_trigger
        def _(event: viser.CommandEvent) -> None:
            if event.client:
                push = self._push_towards(angle_on_screen(event.client, right, away))
                self._actions.push(lambda session: session.push(push) if not session.is_pushed() else None)


def angle_on_screen(client: viser.ClientHandle, right: float, away: float) -> float:
    """The direction in the world, counter-clockwise from +x in steps of 15 [deg], of one on a browser's screen.

    Args:
        client: client with this screen.
        right: to the right of the viewer, of a unit vector.
        away: away from the viewer, of the same.
    """
    view = np.asarray(client.camera.look_at) - np.asarray(client.camera.position)
    angle = np.degrees(np.arctan2(view[1], view[0])) + np.degrees(np.arctan2(-right, away))
    return 15.0 * round(float(angle) / 15.0)


def _toggle(box: viser.GuiCheckboxHandle) -> None:
    box.value = not box.value  # type: ignore[misc] # viser declares the setter where mypy does not look
