"""The public holosoma policies for Unitree's G1, which walk and stand, in surefoot's trials.

They come in the wheel `holosoma-inference`, which you install yourself; its repository is under the Apache licence 2.0:

    pip install --no-deps holosoma-inference==0.1.3
    surefoot evaluate examples/holosoma.py:FastSAC --robot g1_arms --directions 8
    surefoot agent check examples/holosoma.py:PPO --robot g1_arms

The wheel's own code is not needed. Joint names and gains are in the metadata of its ONNX files; the rest is what its
configuration says of the task "g1-29dof-loco" (observation.py, robot.py and task.py of config_values).
"""

import importlib.util
import json
from pathlib import Path

import numpy as np

from surefoot.agents.foreign import OBSERVATIONS, ForeignPolicy, Interface, Moment, Network, Observation, Term
from surefoot.errors import UserError
from surefoot.robots import Robot

LEG = [-0.312, 0.0, 0.0, 0.669, -0.363, 0.0]
WAIST = [0.0, 0.0, 0.0]
LEFT_ARM = [0.2, 0.2, 0.0, 0.6, 0.0, 0.0, 0.0]
RIGHT_ARM = [0.2, -0.2, 0.0, 0.6, 0.0, 0.0, 0.0]
DEFAULT_POSE = np.array(LEG + LEG + WAIST + LEFT_ARM + RIGHT_ARM)
TERMS = (
    Term("actions"),
    Term("base_ang_vel", scale=0.25),
    Term("command_ang_vel"),
    Term("command_lin_vel"),
    Term("cos_phase", period=1.0),
    Term("dof_pos"),
    Term("dof_vel", scale=0.05),
    Term("projected_gravity"),
    Term("sin_phase", period=1.0),
)
"""The observations in the order of their names, as the wheel sorts them."""


def feet_phase(now: Moment) -> np.ndarray:
    """The gait's phase of the left and the right foot (n, 2) [rad]: half a period apart, or both pi while standing."""
    walks = np.linalg.norm(now.command, axis=1, keepdims=True) > 0.01
    phase = 2.0 * np.pi * now.state.time[:, None] / now.period + [0.0, np.pi]
    return np.where(walks, phase, np.pi)


class HolosomaPolicy(ForeignPolicy):
    """A locomotion policy of the wheel."""

    observations = OBSERVATIONS | {
        "sin_phase": Observation(2, lambda now: np.sin(feet_phase(now))),
        "cos_phase": Observation(2, lambda now: np.cos(feet_phase(now))),
    }
    file = ""

    def __init__(self, robot: Robot, num_robots: int):
        network = Network(wheel_folder() / "models" / "loco" / "g1_29dof" / self.file)
        metadata = {key: json.loads(network.metadata[key]) for key in ("dof_names", "kp", "kd")}
        interface = Interface(
            source=self.file,
            joints=tuple(metadata["dof_names"]),
            stiffness=np.array(metadata["kp"]),
            damping=np.array(metadata["kd"]),
            default_pose=DEFAULT_POSE,
            action_scale=0.25,
            terms=TERMS,
            rate_hz=50,
            action_clip=(-100.0, 100.0),
        )
        super().__init__(robot, num_robots, network, interface)


class FastSAC(HolosomaPolicy):
    """Learned by FastSAC."""

    file = "fastsac_g1_29dof.onnx"


class PPO(HolosomaPolicy):
    """Learned by PPO."""

    file = "ppo_g1_29dof.onnx"


def wheel_folder() -> Path:
    """Where the wheel is installed; its code is not imported."""
    spec = importlib.util.find_spec("holosoma_inference")
    if spec is None or not spec.submodule_search_locations:
        raise UserError("holosoma's policies are not installed: pip install --no-deps holosoma-inference==0.1.3")
    return Path(spec.submodule_search_locations[0])
