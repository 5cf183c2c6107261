"""Mixture: a network that holds all its teachers, estimates hidden quantities and chooses the teacher that fits.

A trunk takes the noisy observation with its memory. It gives an estimate of the clear observation, and gates between
the teachers' networks, which act on that estimate. So the student answers a push as the teacher does that fits, to the
last digit while the observation is clear, where a network that imitates them only comes near.

As a policy file the mixture is what every policy is, a chain of linear layers and tanh: tanh(e x) / e hands a number on
for a small e, and (tanh(z + e x) - tanh(z - e x)) / 2e is x times sech(z) squared, which is a gate.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import nn

from surefoot.learning.actor import put_layers
from surefoot.learning.networks import linear_modules, mlp

Layers = list[tuple[np.ndarray, np.ndarray]]
"""(weight (out, in), bias (out,)) of every linear layer of a network with tanh between them."""

CLOSED = 4.0
"""A gate's z runs from 0, where it is open, to twice this, where it is closed: sech(8) squared is 4e-7."""
MIDDLE = 1.045
"""The gate is half open where its tanh has this argument: sech(4 - 4 tanh(1.045)) squared is 0.5."""
_PASS, _GATE = 1e-3, 1e-2
"""Small numbers by which values are handed on, and gated."""


class MixtureNetwork(nn.Module):
    """The trunk, and behind it frozen networks: the second one acts, and gates let the others act in its place.

    Args:
        num_inputs: observation and memory, normalised.
        num_observed: components of the observation, which are the first inputs.
        hidden: sizes of the trunk's two hidden layers.
        teachers: layers of each teacher's network on the normalised observation, in the student's actions.
    """

    def __init__(self, num_inputs: int, num_observed: int, hidden: Sequence[int], teachers: Sequence[Layers]):
        super().__init__()
        self.trunk = mlp(num_inputs, hidden, num_observed + len(teachers), nn.Tanh)
        self.num_observed = num_observed
        self._teachers = [[(_tensor(weight), _tensor(bias)) for weight, bias in each] for each in teachers]
        last = linear_modules(self.trunk)[-1]
        with torch.no_grad():  # the estimate begins as the observation, and its gate open enough to learn
            last.weight *= 0.01
            last.bias.zero_()
            last.bias[num_observed] = MIDDLE

    def parts(self, inputs: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Return actions (n, num_joints), the clear observation (n, num_observed), and the logits of the gates.

        The logits (n, teachers - 1) are those of the first teacher and of all from the third on; one is above 0 where
        that teacher has more than half of the say.
        """
        told = self.trunk(inputs)
        correction, noisy, choices = told.split([self.num_observed, 1, len(self._teachers) - 1], dim=1)
        clear = inputs[:, : self.num_observed] + _gate(noisy) * correction
        first, second, *others = (_through(layers, clear) for layers in self._teachers)
        actions = second
        for choice, action in zip(choices.split(1, dim=1), (first, *others), strict=True):
            actions = actions + _gate(choice) * (action - second)
        return actions, clear, 4.0 * (choices - MIDDLE)

    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        """Return the actions."""
        return self.parts(inputs)[0]

    def put_trunk(self, layers: Layers) -> None:
        """Take the trunk of a mixture with the same sizes and as many teachers, which may be others.

        Args:
            layers: of that mixture, as `layers` returns them.

        Raises:
            ValueError: they are not those of such a mixture.
        """
        observed, modules = self.num_observed, linear_modules(self.trunk)
        ours, theirs = self.layers()[:3], layers[:3]
        if [weight.shape for weight, _ in ours] != [weight.shape for weight, _ in theirs]:
            raise ValueError("its trunk has other sizes, or it has more or fewer teachers")
        if any(np.abs(a[-observed:] - b[-observed:]).max() > 1e-4 for (a, _), (b, _) in zip(ours, theirs, strict=True)):
            raise ValueError("it is no mixture")
        columns = [None, modules[0].out_features, modules[1].out_features]
        trunk = [
            (weight[: layer.out_features, :width], bias[: layer.out_features])
            for (weight, bias), layer, width in zip(theirs, modules, columns, strict=True)
        ]
        scale = np.where(np.arange(modules[2].out_features) < observed, 1.0 / _PASS, 1.0)
        trunk[2] = (scale[:, None] * trunk[2][0], scale * trunk[2][1])
        put_layers(self.trunk, trunk)

    def layers(self) -> Layers:
        """Return the same as one chain of linear layers with tanh between them."""
        observed, gates = self.num_observed, len(self._teachers) - 1
        (w1, b1), (w2, b2), (w3, b3) = ((_array(m.weight), _array(m.bias)) for m in linear_modules(self.trunk))
        eye = np.eye(observed)
        told = _stack((_PASS * w3[:observed], _PASS * b3[:observed]), (w3[observed:], b3[observed:]))
        chain = [
            _stack((w1, b1), (_PASS * np.eye(observed, w1.shape[1]), None)),
            _blocks((w2, b2), (eye, None)),
            _blocks(told, (eye, None)),
        ]
        # Values now: correction * PASS, tanh(noisy), tanh(choices), observation * PASS.
        size = 2 * observed + 1 + gates
        correction, closing = np.eye(observed, size) / _PASS, np.zeros((observed, size))
        closing[:, observed] = -CLOSED
        passed = np.eye(gates + observed, size, k=observed + 1)
        passed[:gates] *= _PASS
        chain.append(_stack(*_halves(closing, correction, np.zeros(observed)), (passed, None)))
        # Values now: both halves of the gated correction, tanh(choices) * PASS, observation * PASS.
        clear = np.hstack([_of_halves(observed), np.zeros((observed, gates)), eye / _PASS])
        choices = np.eye(gates, clear.shape[1], k=2 * observed)
        depth = max(map(len, self._teachers))
        teachers = [_deepened([(_array(w), _array(b)) for w, b in each], depth) for each in self._teachers]
        chain.append(_stack(*((each[0][0] @ clear, each[0][1]) for each in teachers), (choices, None)))
        hidden = (_blocks(*(each[layer] for each in teachers), (np.eye(gates), None)) for layer in range(1, depth - 1))
        return [*chain, *hidden, *_last([each[-1] for each in teachers])]


def _deepened(layers: Layers, depth: int) -> Layers:
    """The same network with so many layers: the first ones hand its inputs on."""
    (weight, bias), *others = layers
    eye = np.eye(weight.shape[1])
    hands_on = [(_PASS * eye if i == 0 else eye, np.zeros(len(eye))) for i in range(depth - len(layers))]
    return [*hands_on, (weight / _PASS if hands_on else weight, bias), *others]


def _last(teachers: Sequence[tuple[np.ndarray, np.ndarray]]) -> Layers:
    """The gates between all teachers' actions, and their output.

    Args:
        teachers: the last layer of each.
    """
    num_joints, gates = len(teachers[0][1]), len(teachers) - 1
    width = sum(weight.shape[1] for weight, _ in teachers) + gates
    ends = np.cumsum([weight.shape[1] for weight, _ in teachers])
    actions = []
    for (weight, bias), end in zip(teachers, ends, strict=True):
        columns = np.zeros((num_joints, width))
        columns[:, end - weight.shape[1] : end] = weight
        actions.append((columns, bias))
    first, (second, bias), *others = actions
    parts: list[tuple[np.ndarray, np.ndarray | None]] = []
    for gate, (weight, shift) in enumerate((first, *others)):
        closing = np.zeros((num_joints, width))
        closing[:, gate - gates] = -CLOSED / _PASS
        parts += _halves(closing, weight - second, shift - bias)
    out = np.hstack([*[_of_halves(num_joints)] * gates, np.eye(num_joints) / _PASS])
    return [_stack(*parts, (_PASS * second, _PASS * bias)), (out, np.zeros(num_joints))]


def _halves(closing: np.ndarray, weight: np.ndarray, bias: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Both halves z + e x and z - e x of gates, where z = CLOSED + closing and x = weight and bias (n,)."""
    return [(closing + sign * _GATE * weight, CLOSED + sign * _GATE * bias) for sign in (1.0, -1.0)]


def _of_halves(number: int) -> np.ndarray:
    """What so many gates let through, of tanh of both their halves: (number, 2 number)."""
    eye = np.eye(number) / (2.0 * _GATE)
    return np.hstack([eye, -eye])


def _gate(argument: torch.Tensor) -> torch.Tensor:
    """sech(z) squared with z = CLOSED (1 - tanh(argument)): from 0, closed, to 1, open."""
    return torch.cosh(CLOSED * (1.0 - torch.tanh(argument))).square().reciprocal()


def _through(layers: Sequence[tuple[torch.Tensor, torch.Tensor]], values: torch.Tensor) -> torch.Tensor:
    for weight, bias in layers[:-1]:
        values = torch.tanh(nn.functional.linear(values, weight, bias))
    return nn.functional.linear(values, *layers[-1])


def _stack(*parts: tuple[np.ndarray, np.ndarray | None]) -> tuple[np.ndarray, np.ndarray]:
    """One layer of several on the same inputs; a bias of None is zero."""
    biases = [np.zeros(len(weight)) if bias is None else bias for weight, bias in parts]
    return np.vstack([weight for weight, _ in parts]), np.concatenate(biases)


def _blocks(*parts: tuple[np.ndarray, np.ndarray | None]) -> tuple[np.ndarray, np.ndarray]:
    """One layer of several, each on inputs of its own, one after the other."""
    weight = np.zeros((sum(len(w) for w, _ in parts), sum(w.shape[1] for w, _ in parts)))
    row = column = 0
    for w, _ in parts:
        weight[row : row + len(w), column : column + w.shape[1]] = w
        row, column = row + len(w), column + w.shape[1]
    return weight, np.concatenate([np.zeros(len(w)) if bias is None else bias for w, bias in parts])


def _tensor(array: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(np.ascontiguousarray(array, np.float32))


def _array(tensor: torch.Tensor) -> np.ndarray:
    return tensor.detach().numpy().astype(np.float64)
