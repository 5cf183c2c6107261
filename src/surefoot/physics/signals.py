"""Signals between policy and joints: low-pass filter, noise and bias of the observation, path and delay of targets."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.signal import butter

CUTOFF_HZ = 10.0


class LowPass:
    """First-order Butterworth low-pass of batches of signals, advanced by whole blocks of ticks.

    y[k] = b0 x[k] + b1 x[k-1] - a1 y[k-1]. An agent sees only the last tick of its control step, and that is linear in
    the block's ticks and the filter's state, so that one product per block does what a loop over ticks would.

    Args:
        num_robots, num_signals: shape of the filter's state.
        cutoff_hz, sample_hz: the filter's design.

    Attributes:
        output: the last output of every robot (num_robots, num_signals).
    """

    def __init__(self, num_robots: int, num_signals: int, sample_hz: float, cutoff_hz: float = CUTOFF_HZ):
        (self._b0, self._b1), (_, self._a1) = butter(1, cutoff_hz, fs=sample_hz)
        self._weights: dict[int, tuple[np.ndarray, float, float]] = {}
        self._input = np.zeros((num_robots, num_signals))
        self.output = np.zeros((num_robots, num_signals))

    def reset(self, ids: np.ndarray, signal: np.ndarray) -> None:
        """Start robots `ids` (n,) in the steady state of a constant signal (n, num_signals)."""
        self._input[ids] = signal
        self.output[ids] = signal

    def __call__(self, signals: Sequence[np.ndarray], ids: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Filter a block of ticks of robots `ids` (n,).

        Args:
            signals: the block in parts, (n, num_ticks, size) each, `num_signals` in all.
            ids: the robots (n,).

        Returns:
            The block's last output (n, num_signals).
        """
        of_block, of_input, of_output = self._weights_of(signals[0].shape[1])
        self.output[ids] = (
            of_output * self.output[ids]
            + of_input * self._input[ids]
            + np.concatenate([np.matmul(of_block, part) for part in signals], axis=-1)
        )
        self._input[ids] = np.concatenate([part[:, -1] for part in signals], axis=-1)
        return self.output[ids]

    def _weights_of(self, num_ticks: int) -> tuple[np.ndarray, float, float]:
        """The weights in a block's last output: of its ticks (num_ticks,), of the last input and the last output."""
        if num_ticks not in self._weights:
            decay = (-self._a1) ** np.arange(num_ticks - 1, -1, -1.0)
            of_block = self._b0 * decay
            of_block[:-1] += self._b1 * decay[1:]
            self._weights[num_ticks] = of_block, self._b1 * decay[0], (-self._a1) ** num_ticks
        return self._weights[num_ticks]


class Noise:
    """Gaussian noise of its own for each of `num_robots` robots, so that no robot's depends on who else is there."""

    def __init__(self, num_robots: int):
        self._std = np.zeros(num_robots)
        self._generators: list[np.random.Generator | None] = [None] * num_robots

    def reset(self, robot: int, std: float, generator: np.random.Generator) -> None:
        """Give one robot its standard deviation; 0 for none."""
        self._std[robot], self._generators[robot] = std, generator if std else None

    def add(self, ids: np.ndarray, signal: np.ndarray) -> np.ndarray:
        """Signals (n, ...) of robots `ids` (n,) with their noise."""
        noisy = np.flatnonzero(self._std[ids])
        if not len(noisy):
            return signal
        signal = np.array(signal)
        for row in noisy:
            generator = self._generators[ids[row]]
            assert generator is not None
            signal[row] += self._std[ids[row]] * generator.standard_normal(signal.shape[1:])
        return signal


class Delay:
    """Holds back the targets of `num_robots` robots, each by a number of ticks of its own.

    Args:
        block: the longest delay, and the most ticks per call.
        size: numbers per tick.
    """

    def __init__(self, num_robots: int, block: int, size: int):
        self._ticks = np.zeros(num_robots, np.int64)
        self._last = np.zeros((num_robots, block, size))

    def reset(self, robot: int, num_ticks: int, value: np.ndarray) -> None:
        """Give one robot its delay, and the value (size,) that comes out until the first one arrives."""
        self._ticks[robot] = num_ticks
        self._last[robot] = value

    def __call__(self, ids: np.ndarray, signal: np.ndarray) -> np.ndarray:
        """Delayed signals (n, num_ticks, size) of robots `ids` (n,)."""
        if not self._ticks[ids].any():
            return signal
        both = np.concatenate([self._last[ids], signal], axis=1)
        longest, num_ticks = self._last.shape[1], signal.shape[1]
        self._last[ids] = both[:, -longest:]
        when = longest + np.arange(num_ticks) - self._ticks[ids, None]
        return np.take_along_axis(both, when[..., None], axis=1)


def cubic_path(start: np.ndarray, end: np.ndarray, num_ticks: int, out: np.ndarray | None = None) -> np.ndarray:
    """Targets (n, num_ticks, k) from `start` to `end` (n, k), at rest at both ends; the last tick is `end`.

    s(u) = 3 u^2 - 2 u^3 for u = 1/num_ticks .. 1.
    """
    u = np.arange(1, num_ticks + 1) / num_ticks
    share = (u * u * (3.0 - 2.0 * u))[:, None]
    path = np.multiply(share, (end - start)[:, None])
    if out is None:
        out = path
    return np.add(path, start[:, None], out=out)
