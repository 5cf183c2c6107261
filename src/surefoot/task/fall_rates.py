"""Fall rates: recent rates of falls by push, so that training can choose pushes that make some robots fall."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from surefoot.robots import Robot

NUM_SECTORS = 16
"""Directions are counted in sectors that are centred on the main directions, counter-clockwise from +x."""
IMPULSE_STEP = 30.0
"""Impulses are counted in steps of this size [Ns], for a robot of the mass of the paper's."""
FORGET = 0.05
"""Weight of one more push in the share of falls."""
_FULL_TURN = 2.0 * np.pi


class FallRates:
    """Share of the pushes that ended in a fall lately, by body, direction and impulse.

    A push and its mirror image are counted as one.

    Args:
        robot: the machine that is pushed; its `mirror_body` tells which bodies are a pair.
        bodies: names of those that are pushed.
        max_impulse: larger ones are counted with it [Ns].

    Attributes:
        share: (body, sector, step of impulse). The first body of a pair, in the robot's order, stands for both; bodies
            in the middle have the sectors from forward to the left to backward only, and no falls elsewhere.
        step: size of a step of impulse [Ns].
    """

    def __init__(self, robot: Robot, bodies: Sequence[str], max_impulse: float):
        order = list(robot.pushable)
        pairs = [sorted((body, robot.mirror_body(body)), key=order.index) for body in bodies]
        self.step = IMPULSE_STEP * robot.mass_scale
        names = list(dict.fromkeys(first for first, _ in pairs))
        self._first = np.array([robot.body_id(name) for name in names])
        self._second = np.array([robot.body_id(robot.mirror_body(name)) for name in names])
        self.share = np.full((len(names), NUM_SECTORS, int(np.ceil(max_impulse / self.step))), 0.5)
        self.share[self._first == self._second, NUM_SECTORS // 2 + 1 :] = 0.0

    def count(self, body: np.ndarray, angle: np.ndarray, impulse: np.ndarray, fell: bool) -> None:
        """Count pushes that have ended: of bodies (n,), by their ids, at angles (n,) [rad], with impulses (n,) [Ns]."""
        for row, sector, step in zip(*self._places(body, angle, impulse), strict=True):
            self.share[row, sector, step] += FORGET * (fell - self.share[row, sector, step])

    def _places(self, body: np.ndarray, angle: np.ndarray, impulse: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return the row, sector and step of impulse (n,) each under which pushes are counted."""
        row = ((body[:, None] == self._first) | (body[:, None] == self._second)).argmax(axis=1)
        middle = self._first[row] == self._second[row]
        mirrored = ~middle & (body == self._second[row])
        sector = to_sector(np.where(mirrored, -angle, angle))
        sector = np.where(middle, np.minimum(sector, NUM_SECTORS - sector), sector)
        return row, sector, np.minimum(impulse / self.step, self.share.shape[2] - 1).astype(np.int64)

    def draw(self, n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Draw pushes of which robots sometimes fall: in proportion to f (1 - f), where f is the share that fell.

        Returns:
            Body ids, directions [rad] and impulses [Ns], (n,) each.
        """
        weight = (self.share * (1.0 - self.share)).ravel()
        row, sector, step = np.unravel_index(rng.choice(weight.size, n, p=weight / weight.sum()), self.share.shape)
        angle = (sector + rng.uniform(-0.5, 0.5, n)) * (_FULL_TURN / NUM_SECTORS)
        first = rng.random(n) < 0.5
        body = np.where(first, self._first[row], self._second[row])
        return body, np.where(first, angle, -angle) % _FULL_TURN, (step + rng.random(n)) * self.step


def to_sector(angle: np.ndarray) -> np.ndarray:
    """The sector of directions (n,) [rad]."""
    return np.rint(angle / _FULL_TURN * NUM_SECTORS).astype(np.int64) % NUM_SECTORS
