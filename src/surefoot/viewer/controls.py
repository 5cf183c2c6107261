"""Controls: the panel of buttons and sliders, and the keys. What they ask for is done by somebody else."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import viser

from surefoot.evaluation.protocol import protocol_for
from surefoot.physics.pushes import Push, horizontal_push
from surefoot.rendering.words import pushable_words
from surefoot.robots import Robot
from surefoot.viewer.clip import SECONDS
from surefoot.viewer.markup import render
from surefoot.viewer.player import Player
from surefoot.viewer.session import FRICTION, Session
from surefoot.viewer.source import PolicySource, offered_policies

CROWDS = ("1", "4", "16", "36", "64")
_OTHER = "other ..."
_KEYS = {"space": "pause", "N": "one step", "R": "reset", "F": "follow", "X": "see through"}
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
    """What the controls ask for.

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

    def set_see_through(self, see_through: bool) -> None:
        """Draw the robots such that the marks inside are seen, or not."""

    def set_overlays(self, visible: bool) -> None:
        """Show forces and points, or not."""

    def send_clip(self, client: viser.ClientHandle) -> None:
        """Give a browser the last seconds as a film."""


class Controls:
    """All that a user can set, and what happens then.

    Args:
        gui: where the panel is made.
        actions: who does what is asked for.
        runs: folder whose run folders are offered.
    """

    def __init__(self, gui: viser.GuiApi, actions: Actions, runs: Path):
        self._gui = gui
        self._actions = actions
        self._runs = runs
        gui.add_html(render("help", keys=_KEYS))
        with gui.add_folder("Push"):
            self._add_pushes(actions.player.session.robot)
        with gui.add_folder("Policy and robots"):
            self._add_policy()
            self._add_conditions()
        with gui.add_folder("Time"):
            self._add_time()
        with gui.add_folder("View"):
            self._add_view()
        self._add_keys()

    def set_impulse(self, impulse: float) -> None:
        """Move the slider [Ns]."""
        self._impulse.value = impulse  # type: ignore[misc] # as in _toggle

    def refresh_policies(self) -> None:
        """Offer run folders that are new."""
        if self._policies.options != self._offered():
            self._policies.options = self._offered()

    def _add_pushes(self, robot: Robot) -> None:
        gui, step = self._gui, protocol_for(robot).impulse_step
        self._bodies = pushable_words(robot)
        self._body = gui.add_dropdown("Body", tuple(self._bodies), initial_value=next(iter(self._bodies)))
        self._angle = gui.add_slider(
            "Direction",
            min=-180,
            max=180,
            step=15,
            initial_value=0,
            marks=((-180, "back"), (-90, "right"), (0, "forward"), (90, "left"), (180, "back")),
            hint="degrees, as the robot sees it",
        )
        self._impulse = gui.add_slider(
            "Impulse [Ns]",
            min=step,
            max=round(_LARGEST_IMPULSE * step, 2),
            step=step,
            initial_value=round(_FIRST_IMPULSE * step, 2),
        )
        self._duration = gui.add_slider("Duration [s]", min=0.02, max=1.0, step=0.02, initial_value=0.12)
        button = gui.add_button("Push", icon=viser.Icon.HAND_MOVE, color=(226, 88, 24))
        button.on_click(lambda _: self._push(self._chosen_push()))
        self._height = gui.add_slider("Height [m]", min=0.05, max=0.6, step=0.05, initial_value=0.3)
        gui.add_button_group("", ("Drop", "Lift and push")).on_click(self._drop_or_lift)

    def _drop_or_lift(self, event: viser.GuiEvent[Any]) -> None:
        fall, push = float(self._height.value), self._chosen_push()
        if event.target.value == "Drop":
            self._actions.push(lambda session: session.drop(fall))
        else:
            self._actions.push(lambda session: session.lift_and_push(push))

    def _push(self, push: Push) -> None:
        self._actions.push(lambda session: session.push(push))

    def _chosen_push(self) -> Push:
        return self._push_towards(float(self._angle.value))

    def _push_towards(self, angle_deg: float) -> Push:
        body = self._bodies[self._body.value]
        return horizontal_push(body, angle_deg, float(self._impulse.value), float(self._duration.value))

    def _add_policy(self) -> None:
        actions, gui = self._actions, self._gui
        self._policies = policies = gui.add_dropdown("Policy", self._offered(), initial_value=actions.source.name)
        other = gui.add_text("File or run", "", hint="a policy file or a run folder, then Enter", visible=False)

        @policies.on_update
        def _(_: viser.GuiEvent[Any]) -> None:
            other.visible = policies.value == _OTHER
            if policies.value != _OTHER:
                actions.set_source(policies.value)

        @other.on_update
        def _(_: viser.GuiEvent[Any]) -> None:
            if other.value.strip():
                actions.set_source(other.value.strip())

        crowd = gui.add_dropdown("Robots", CROWDS, initial_value=str(actions.player.session.num_robots))
        crowd.on_update(lambda _: actions.set_num_robots(int(crowd.value)))

    def _add_conditions(self) -> None:
        player, gui = self._actions.player, self._gui
        noise = gui.add_slider("Noise [%]", min=0, max=100, step=10, initial_value=0, hint="of the paper's noise")
        friction = gui.add_slider("Friction", min=0.1, max=1.5, step=0.05, initial_value=FRICTION)
        stands_up = gui.add_checkbox("Stand up again", initial_value=True, hint="after a fall, by itself")

        @noise.on_update
        def _(_: viser.GuiEvent[Any]) -> None:
            player.do(lambda session: session.set_noise(float(noise.value) / 100.0))

        @friction.on_update
        def _(_: viser.GuiEvent[Any]) -> None:
            player.do(lambda session: session.set_friction(float(friction.value)))

        @stands_up.on_update
        def _(_: viser.GuiEvent[Any]) -> None:
            player.do(lambda session: setattr(session, "stands_up", bool(stands_up.value)))

    def _offered(self) -> tuple[str, ...]:
        return (*offered_policies(self._runs, self._actions.source.name), _OTHER)

    def _add_time(self) -> None:
        actions, gui = self._actions, self._gui
        buttons = gui.add_button_group("", ("Pause", "Step", "Reset"))

        @buttons.on_click
        def _(event: viser.GuiEvent[Any]) -> None:
            deeds = {"Pause": self._pause, "Step": actions.player.single_step, "Reset": actions.reset}
            deeds[event.target.value]()

        speed = gui.add_slider("Speed", min=0.05, max=1.0, step=0.05, initial_value=1.0, hint="1 is real time")

        @speed.on_update
        def _(_: viser.GuiEvent[Any]) -> None:
            actions.player.speed = float(speed.value)

        clip = gui.add_button(f"Save the last {SECONDS:.0f} s as MP4", icon=viser.Icon.MOVIE)

        @clip.on_click
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

    def _push_by(self, command: viser.CommandHandle, right: int, away: int) -> None:
        @command.on_trigger
        def _(event: viser.CommandEvent) -> None:
            if event.client:
                push = self._push_towards(angle_on_screen(event.client, right, away))
                self._actions.push(lambda session: session.push(push) if not session.is_pushed() else None)


def angle_on_screen(client: viser.ClientHandle, right: float, away: float) -> float:
    """The direction in the world, counter-clockwise from +x in steps of 15 [deg], of one on a browser's screen.

    Args:
        client: whose screen it is.
        right: to the right of the viewer, of a unit vector.
        away: away from the viewer, of the same.
    """
    view = np.asarray(client.camera.look_at) - np.asarray(client.camera.position)
    angle = np.degrees(np.arctan2(view[1], view[0])) + np.degrees(np.arctan2(-right, away))
    return 15.0 * round(float(angle) / 15.0)


def _toggle(box: viser.GuiCheckboxHandle) -> None:
    box.value = not box.value  # type: ignore[misc] # viser declares the setter where mypy does not look
