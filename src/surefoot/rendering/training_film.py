"""Training film: a few seconds of the newest policy of a run, as a small animated GIF."""

from __future__ import annotations

import io

from PIL import Image

from surefoot.agents.network import NetworkAgent
from surefoot.evaluation.protocol import protocol_for
from surefoot.evaluation.trials import Trial
from surefoot.learning.training_log import Film
from surefoot.physics.pushes import horizontal_push
from surefoot.rendering.film import frames
from surefoot.rendering.recording import record

SIZE = (240, 180)
SECONDS = 4.0
FPS = 12.5
CELLS = 30
"""Size of the push in steps of the robot's grid of impulses: 180 Ns for the paper's robot."""


def film_of(policy: NetworkAgent) -> Film:
    """Draw a policy that is pushed forward.

    Raises:
        UserError: there is no OpenGL to draw with.
    """
    push = horizontal_push("root", 0.0, CELLS * protocol_for(policy.robot).impulse_step)
    recording = record(policy, Trial(push, horizon=SECONDS, quiet_from=SECONDS / 2))
    pictures = [Image.fromarray(picture) for picture in frames(recording, FPS, SIZE, -0.3, SECONDS)]
    buffer = io.BytesIO()
    pictures[0].save(buffer, "GIF", save_all=True, append_images=pictures[1:], duration=1000 / FPS, loop=0)
    return Film(buffer.getvalue(), *SIZE)
