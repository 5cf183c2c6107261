"""Server: the address, the light and the camera of the live page."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Iterator

import numpy as np
import rich
import viser

from surefoot.errors import UserError
from surefoot.viewer.guard import Guard

_FIELD_OF_VIEW = 38.0
"""Of the camera [deg]."""
_STEP_BACK = 1.15
"""Distance of the camera from its target where the window is narrow, as a multiple of the usual distance."""
_HORIZON, _ZENITH = (206, 214, 224), (138, 152, 171)
"""Colours of the sky."""


def start_server(host: str, port: int, guard: Guard) -> viser.ViserServer:
    """A server that listens, is guarded, and is lit.

    Raises:
        UserError: nobody can listen there.
    """
    check_port(host, port)
    with _quiet(), guard.installed():
        server = viser.ViserServer(host=host, port=port, label="surefoot", verbose=False)
    _light(server)
    return server


def stop_server(server: viser.ViserServer) -> None:
    """Stop listening."""
    with _quiet():
        server.stop()


def check_port(host: str, port: int) -> None:
    """Check that somebody can listen there.

    Raises:
        UserError: nobody can.
    """
    try:
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((host, port))
    except (OSError, OverflowError) as error:
        reason = (getattr(error, "strerror", None) or str(error)).lower()
        raise UserError(
            f"cannot listen on {host}:{port}: {reason}; valid: a free --port, such as {port + 1}"
        ) from error


def camera_place(num_robots: int, scale: float) -> tuple[np.ndarray, np.ndarray]:
    """Position of the camera, and what it looks at [m]: all of one robot, or the middle of a crowd.

    Args:
        num_robots: how many there are.
        scale: their size, `framing.scale_of`.
    """
    side = float(np.ceil(np.sqrt(num_robots))) - 1.0
    away = 1.0 + 0.8 * side
    position = np.array([3.6 * away, 2.5 * away, 1.45 + 1.1 * side])
    return scale * position, scale * np.array([0.0, 0.0, 0.93])


def place_camera(camera: viser.CameraHandle, num_robots: int, scale: float) -> None:
    """Put a browser's camera where `camera_place` says, or farther away where the window is higher than wide.

    On a phone the distances on the floor would be cut off at the sides otherwise.
    """
    position, target = camera_place(num_robots, scale)
    away = _STEP_BACK if camera.aspect < 1.0 else 1.0
    camera.position, camera.look_at = target + away * (position - target), target


def add_key_light(server: viser.ViserServer, num_robots: int, scale: float) -> None:
    """Add a soft spot from the front left, far enough to cover all robots; it casts the shadows."""
    away = scale * (1.0 + 0.5 * (np.ceil(np.sqrt(num_robots)) - 1.0))
    server.scene.add_light_spot(
        "/light/key",
        position=(3.5 * away, 3.0 * away, 7.0 * away),
        direction=(-0.42, -0.36, -0.83),
        intensity=75.0 * away**2,
        angle=0.5,
        penumbra=1.0,
        cast_shadow=True,
    )


def _light(server: viser.ViserServer) -> None:
    scene = server.scene
    scene.set_up_direction("+z")
    scene.set_background_image(_sky(), format="png")
    scene.configure_environment_map("studio", environment_intensity=0.3)
    scene.configure_default_lights(enabled=False)
    scene.add_light_hemisphere("/light/sky", sky_color=(255, 255, 255), ground_color=(150, 160, 175), intensity=0.7)
    server.initial_camera.fov = float(np.radians(_FIELD_OF_VIEW))


def _sky(height: int = 256) -> np.ndarray:
    """A background that is bright at the horizon, in the middle, and darker above: uint8 (height, 16, 3)."""
    above = np.clip(1.0 - 2.0 * np.arange(height) / height, 0.0, 1.0)[:, None]
    color = (1.0 - above) * np.array(_HORIZON) + above * np.array(_ZENITH)
    return np.repeat(np.rint(color).astype(np.uint8)[:, None], 16, axis=1)


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keep viser from greeting and saying goodbye through rich's own console, which nobody else uses."""
    console = rich.get_console()
    before, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = before
