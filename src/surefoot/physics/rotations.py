"""Rotations: functions of unit quaternions (w, x, y, z), and horizontal vectors as complex numbers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def components(quaternion: np.ndarray) -> tuple[np.ndarray, ...]:
    """w, x, y and z of quaternions (..., 4): (...) each."""
    return tuple(quaternion[..., i] for i in range(4))


def horizontal(vectors: np.ndarray) -> np.ndarray:
    """View of the horizontal part of vectors (..., 2 or 3) as complex numbers x + iy: (...).

    Rotations become products, and NumPy's inner loops run over ticks instead of over pairs.
    """
    return vectors[..., :2].view(complex)[..., 0]


def by_degree(values: Sequence[float] | np.ndarray) -> np.ndarray:
    """Return values in evenly spaced directions, counter-clockwise from +x, for every degree (360,), linear between."""
    around = np.append(values, values[0])
    return np.interp(np.arange(360.0), np.linspace(0.0, 360.0, len(around)), around)


def roll_pitch(quaternion: np.ndarray) -> np.ndarray:
    """Roll and pitch (Z-Y-X Euler angles) [rad] of unit quaternions (..., 4): (2, ...)."""
    w, x, y, z = components(quaternion)
    angles = np.empty((2, *w.shape))
    np.arctan2(w * x + y * z, 0.5 - (x * x + y * y), out=angles[0, ...])
    sine = 2.0 * (w * y - z * x)
    np.arcsin(np.minimum(np.maximum(sine, -1.0), 1.0), out=angles[1, ...])
    return angles


def uprightness(quaternion: np.ndarray) -> np.ndarray:
    """Cosine of the angle between a body's z axis and the vertical, from unit quaternions (..., 4)."""
    return 1.0 - 2.0 * (quaternion[..., 1] ** 2 + quaternion[..., 2] ** 2)


def sole_corners(center: np.ndarray, quaternion: np.ndarray, half_size: np.ndarray) -> np.ndarray:
    """DomainParameters positions of the soles' corners [m].

    Args:
        center: sole centres (..., 3).
        quaternion: foot orientations (..., 4).
        half_size: half length and half width (2,).

    Returns:
        (..., 4, 3), counter-clockwise from above, front left first.
    """
    w, x, y, z = components(quaternion)
    along = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)], axis=-1)
    across = np.stack([2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)], axis=-1)
    signs = ((1, 1), (-1, 1), (-1, -1), (1, -1))
    offsets = [i * half_size[0] * along + j * half_size[1] * across for i, j in signs]
    return center[..., None, :] + np.stack(offsets, axis=-2)


def stance_quaternion(roll: np.ndarray | float, pitch: np.ndarray | float, yaw: np.ndarray | float) -> np.ndarray:
    """Unit quaternions (..., 4) of Z-Y-X Euler angles [rad]."""
    roll, pitch, yaw = np.broadcast_arrays(roll, pitch, yaw)
    (cr, sr), (cp, sp), (cy, sy) = ((np.cos(0.5 * angle), np.sin(0.5 * angle)) for angle in (roll, pitch, yaw))
    return np.stack(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ],
        axis=-1,
    )


def z_axis(quaternion: np.ndarray) -> np.ndarray:
    """A body's z axis (3,) from its unit quaternion (4,)."""
    w, x, y, z = quaternion
    return np.array([2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)])
