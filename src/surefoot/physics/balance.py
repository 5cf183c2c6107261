"""Balance in closed form: capture point, support polygon, and the impulse that they let a robot reject."""

from __future__ import annotations

import numpy as np


def capture_point(com: np.ndarray, com_velocity: np.ndarray, com_height: np.ndarray, gravity: float) -> np.ndarray:
    """Where to step to come to rest, x + v * sqrt(z / g): equation (5) of Yang et al. 2018, after Pratt 2006.

    Args:
        com: horizontal position (..., 2) [m].
        com_velocity: horizontal velocity (..., 2) [m/s].
        com_height: above the ground [m], (...).
        gravity: [m/s^2].

    Returns:
        (..., 2) [m].
    """
    time_constant = np.sqrt(np.maximum(com_height, 0.0) / gravity)
    return com + com_velocity * time_constant[..., None]


def rejectable_impulse(mass: float, com_height: float, margin: float, gravity: float) -> float:
    """The largest impulse [Ns] that can be rejected without a step: equation (6) of the paper.

    Args:
        mass: [kg].
        com_height: above the ground [m].
        margin: from the CoM to the border of the support polygon in the direction of the push [m].
        gravity: [m/s^2].
    """
    return mass * float(np.sqrt(gravity / com_height)) * margin


def convex_hull(points: np.ndarray) -> np.ndarray:
    """Corners of the convex hull of points (n, 2), counter-clockwise (Andrew's monotone chain).

    Written here because SciPy's hull refuses the flat sets of points that a tilted sole gives.
    """
    ordered = sorted(map(tuple, np.unique(points, axis=0)))
    if len(ordered) < 3:
        return np.array(ordered).reshape(-1, 2)

    def chain(sequence: list[tuple[float, float]]) -> list[tuple[float, float]]:
        hull: list[tuple[float, float]] = []
        for point in sequence:
            while len(hull) > 1 and _turn(hull[-2], hull[-1], point) <= 0:
                hull.pop()
            hull.append(point)
        return hull[:-1]

    return np.array(chain(ordered) + chain(ordered[::-1]))


def margin(polygon: np.ndarray, point: np.ndarray, direction: np.ndarray) -> float:
    """Distance [m] from a point inside a convex polygon (n, 2) to its border along a unit direction (2,)."""
    edges = np.roll(polygon, -1, axis=0) - polygon
    outward = np.stack([edges[:, 1], -edges[:, 0]], axis=1)
    distance = (outward * (polygon - point)).sum(axis=1)
    speed = outward @ direction
    return float((distance[speed > 1e-12] / speed[speed > 1e-12]).min())


def _turn(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
