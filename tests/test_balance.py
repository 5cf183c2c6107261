import numpy as np
import pytest

from surefoot.physics import balance


def test_the_capture_point_is_where_equation_5_puts_it() -> None:
    gravity = 9.8
    # sqrt(z / g) = sqrt(2.45 / 9.8) = 0.5 s
    point = balance.capture_point(np.array([1.0, 2.0]), np.array([0.6, -1.0]), np.array(2.45), gravity)
    np.testing.assert_allclose(point, [1.0 + 0.6 * 0.5, 2.0 - 1.0 * 0.5], rtol=1e-15)


def test_the_capture_point_of_a_robot_at_rest_is_below_its_com() -> None:
    com = np.array([[0.3, -0.2], [4.0, 5.0]])
    np.testing.assert_array_equal(balance.capture_point(com, np.zeros((2, 2)), np.array([1.1, 0.4]), 9.81), com)


def test_each_robot_and_tick_has_its_own_time_constant() -> None:
    # z = g t^2, so that v = 1 m/s moves the point by t.
    time_constant = np.array([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]])
    velocity = np.broadcast_to([1.0, -2.0], (2, 3, 2))
    point = balance.capture_point(np.zeros((2, 3, 2)), velocity, 9.81 * time_constant**2, 9.81)
    np.testing.assert_allclose(point, np.stack([time_constant, -2.0 * time_constant], axis=-1), rtol=1e-14)


def test_a_com_below_the_ground_gives_a_finite_capture_point() -> None:
    point = balance.capture_point(np.array([0.5, 0.5]), np.array([3.0, 3.0]), np.array(-0.1), 9.81)
    np.testing.assert_array_equal(point, [0.5, 0.5])


@pytest.mark.parametrize(("margin", "impulse"), [(0.13, 53.0), (0.19, 78.0)])
def test_equation_6_gives_the_papers_impulses(margin: float, impulse: float) -> None:
    # 137 kg * sqrt(9.81 / 1.1) 1/s = 409.1 kg/s; times 0.13 m = 53.2 Ns, times 0.19 m = 77.7 Ns
    assert balance.rejectable_impulse(137.0, 1.1, margin, 9.81) == pytest.approx(impulse, abs=0.5)
    assert balance.rejectable_impulse(137.0, 1.1, margin, 9.81) == pytest.approx(409.125 * margin, rel=1e-5)


def test_equation_6_puts_the_capture_point_on_the_border() -> None:
    # J = m v, and the capture point of that v, v sqrt(z / g), must be the margin.
    impulse = balance.rejectable_impulse(80.0, 0.9, 0.1, 9.81)
    point = balance.capture_point(np.zeros(2), np.array([impulse / 80.0, 0.0]), np.array(0.9), 9.81)
    assert point[0] == pytest.approx(0.1, rel=1e-14)


def test_the_hull_keeps_only_the_corners_counter_clockwise() -> None:
    square = [(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 1.0)]
    inside_and_on_edges = [(1.0, 0.5), (1.0, 0.0), (2.0, 0.5), (0.3, 0.9), (0.0, 0.5)]
    hull = balance.convex_hull(np.array(inside_and_on_edges + square[::-1]))
    np.testing.assert_array_equal(hull, square)


def test_the_hull_of_random_points_is_convex_and_holds_them_all() -> None:
    points = np.random.default_rng(3).normal(size=(60, 2))
    hull = balance.convex_hull(points)
    edges = np.roll(hull, -1, axis=0) - hull
    # Left of every edge (or on it): cross(edge, point - corner) >= 0.
    offset = points[None] - hull[:, None]
    cross = edges[:, None, 0] * offset[..., 1] - edges[:, None, 1] * offset[..., 0]
    assert cross.min() > -1e-12
    assert (cross.max(axis=0) > 0).all()
    # Each corner is one of the points and turns strictly left.
    assert {tuple(corner) for corner in hull} <= {tuple(point) for point in points}
    following = np.roll(edges, -1, axis=0)
    assert (edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0] > 0).all()


@pytest.mark.parametrize(
    ("points", "hull"),
    [
        (np.zeros((0, 2)), np.zeros((0, 2))),
        ([(1.0, 2.0)], [(1.0, 2.0)]),
        ([(1.0, 2.0)] * 4, [(1.0, 2.0)]),
        ([(1.0, 2.0), (0.0, 0.0)], [(0.0, 0.0), (1.0, 2.0)]),
        ([(2.0, 2.0), (0.0, 0.0), (1.0, 1.0), (3.0, 3.0)], [(0.0, 0.0), (3.0, 3.0)]),
        ([(0.0, 1.0), (0.0, 3.0), (0.0, 2.0), (0.0, 1.0)], [(0.0, 1.0), (0.0, 3.0)]),
    ],
    ids=["nothing", "point", "same point", "two points", "diagonal line", "upright line"],
)
def test_flat_sets_of_points_have_a_hull(points: object, hull: object) -> None:
    np.testing.assert_array_equal(balance.convex_hull(np.array(points).reshape(-1, 2)), hull)


def test_the_margin_is_the_distance_to_the_border_along_the_push() -> None:
    rectangle = np.array([(-0.1, -0.2), (0.17, -0.2), (0.17, 0.2), (-0.1, 0.2)])
    point = np.array([0.04, 0.05])
    assert balance.margin(rectangle, point, np.array([1.0, 0.0])) == pytest.approx(0.17 - 0.04)
    assert balance.margin(rectangle, point, np.array([-1.0, 0.0])) == pytest.approx(0.04 + 0.1)
    assert balance.margin(rectangle, point, np.array([0.0, 1.0])) == pytest.approx(0.2 - 0.05)
    # Diagonally: x reaches 0.17 after 0.13 sqrt(2), y reaches 0.2 after 0.15 sqrt(2); the first counts.
    assert balance.margin(rectangle, point, np.array([1.0, 1.0]) / np.sqrt(2)) == pytest.approx(0.13 * np.sqrt(2))


def test_the_margin_at_the_border_is_zero_outwards_and_the_width_inwards() -> None:
    triangle = np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)])
    on_edge = np.array([0.0, 0.25])
    assert balance.margin(triangle, on_edge, np.array([-1.0, 0.0])) == 0.0
    # Inwards to the hypotenuse x + y = 1: 1 - 0.25.
    assert balance.margin(triangle, on_edge, np.array([1.0, 0.0])) == pytest.approx(0.75)
