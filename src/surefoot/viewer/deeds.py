"""Deeds: the last actions on the robots and their results, for the list on the live page."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

SHOWN = 5
"""How many of the last deeds are kept."""


@dataclass
class Deed:
    """One disturbance.

    Attributes:
        words: what was done: "300 Ns left, 2500 N".
        recovered, fell: how many robots did so since, until the next deed.
        how: the strategies of the robot that recovered or fell last, in words.
        force: largest force of a hand so far [N]; 0 for other deeds.
        impulse: of the hand so far, world frame (3,) [Ns].
    """

    words: str
    recovered: int = 0
    fell: int = 0
    how: str = ""
    force: float = 0.0
    impulse: np.ndarray = field(default_factory=lambda: np.zeros(3))

    @property
    def verdict(self) -> str:
        """The verdict on the robots, in words; empty while it is open."""
        parts = [(self.recovered, "recovered"), (self.fell, "fell")]
        several = self.recovered + self.fell > 1
        return ", ".join(f"{number} {word}" if several else word for number, word in parts if number)

    def tell_hand(self) -> None:
        """Say in words what the hand has done so far."""
        self.words = f"by hand, up to {self.force:.0f} N, {np.linalg.norm(self.impulse):.0f} Ns"


class Deeds:
    """The last deeds, the newest first."""

    def __init__(self) -> None:
        self._deeds: deque[Deed] = deque(maxlen=SHOWN)

    def __iter__(self) -> Iterator[Deed]:
        """Go through them, the newest first."""
        return iter(list(self._deeds))

    @property
    def newest(self) -> Deed | None:
        """The last deed."""
        return self._deeds[0] if self._deeds else None

    def begin(self, words: str) -> None:
        """Something is done now."""
        self._deeds.appendleft(Deed(words))

    def pull(self, force: float) -> None:
        """A hand pulls with a force [N]; one deed until its robot has recovered or fallen."""
        latest = self.newest
        if latest is None or not latest.force or latest.verdict:
            self.begin("")
            latest = self._deeds[0]
        latest.force = max(latest.force, force)
        latest.tell_hand()

    def add_impulse(self, impulse: np.ndarray) -> None:
        """A hand has pulled with an impulse (3,) [Ns]."""
        if self._deeds and self._deeds[0].force:
            self._deeds[0].impulse += impulse
            self._deeds[0].tell_hand()

    def count(self, recovered: int, fell: int, how: str) -> None:
        """So many robots have recovered or fallen in this step, the last of them with these strategies."""
        if self._deeds and (recovered or fell):
            latest = self._deeds[0]
            latest.recovered += recovered
            latest.fell += fell
            latest.how = how
