"""Settings: the controls of the page, whose values are checked before use.

A browser can send any value. A value that does not fit is reset in all browsers, and the browser that
sent it is notified.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Generic, TypeVar

import viser

from surefoot.checks import check_number
from surefoot.errors import UserError

T = TypeVar("T")


class Setting(Generic[T]):
    """A control with its last valid value.

    Args:
        handle: the control.
        check: returns a valid value as it is used, and raises UserError for any other.
        on_change: called with every new valid value that a browser sends.

    Attributes:
        value: the last valid one.
    """

    def __init__(self, handle: Any, check: Callable[[Any], T], on_change: Callable[[T], object] = lambda value: None):
        self.handle = handle
        self.value = check(handle.value)
        self._check = check
        self._on_change = on_change
        handle.on_update(self._take)

    def set(self, value: T) -> None:
        """Move the control.

        Raises:
            UserError: the value is not valid.
        """
        self.value = self._check(value)
        self.handle.value = value

    def _take(self, event: viser.GuiEvent[Any]) -> None:
        try:
            value = self._check(self.handle.value)
            if value != self.value:  # it is the same after `set`, and after it was put back
                self.value = value
                self._on_change(value)
        except UserError as error:
            self.handle.value = self.value
            if event.client:
                event.client.add_notification("surefoot", str(error), auto_close_seconds=6.0, color="red")


def number(name: str, low: float, high: float) -> Callable[[Any], float]:
    """A check for finite numbers from `low` to `high`."""
    # A browser's slider computes its values: 0.1 + 2 * 0.1 is a little more than 0.3.
    slack = 1e-6 * (high - low)
    return lambda value: min(max(float(check_number(name, value, low - slack, high + slack)), low), high)


def choice(name: str, options: Callable[[], Sequence[str]]) -> Callable[[Any], str]:
    """A check for one of the words that `options` returns at that time."""

    def check(value: Any) -> str:
        if value in options():
            return str(value)
        raise UserError(f"{name} must be one of those offered, not {str(value)[:40]!r}")

    return check
