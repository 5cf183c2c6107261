"""Words: pushes and trials described in words."""

from __future__ import annotations

import numpy as np

from surefoot.evaluation.trials import Trial
from surefoot.physics.pushes import Push
from surefoot.robots import Robot

_WAYS = (
    *("forward", "forward left", "left", "backward left"),
    *("backward", "backward right", "right", "forward right"),
)
"""The eight main directions, from +x on counter-clockwise."""


def push_words(push: Push) -> str:
    """A push in words: "240 Ns forward", "108 Ns left at the left shank", "90 Ns at 30°"."""
    x, y, z = push.direction
    angle = float(np.degrees(np.arctan2(y, x))) % 360.0
    eighth = round(angle / 45.0)
    if abs(z) > np.hypot(x, y):
        way = "up" if z > 0 else "down"
    elif abs(angle - 45.0 * eighth) < 1.0:
        way = _WAYS[eighth % 8]
    else:
        way = f"at {angle:.0f}°"
    body = "" if push.body == "root" else f" at the {push.body.replace('_', ' ')}"
    return f"{push.impulse:g} Ns {way}{body}"


def trial_words(trial: Trial) -> str:
    """A trial's disturbance in words: "drop from 0.4 m, leaning", "500 Ns up, then 70 Ns forward"."""
    parts = []
    if trial.drop:
        parts.append(f"drop from {trial.drop.height:g} m" + ", leaning" * bool(trial.drop.roll or trial.drop.pitch))
    parts += [push_words(push) for push in trial.pushes if push.impulse]
    return ", then ".join(parts) or "no push"


def pushable_words(robot: Robot) -> dict[str, str]:
    """Word that a reader sees, such as "left thigh" -> name under which that body is pushed; the root comes first."""
    others = [name for name, body in robot.pushable.items() if body != robot.root]
    return {robot.root.replace("_", " "): "root"} | {name.replace("_", " "): name for name in others}
