"""surefoot export: write a policy for another runtime or library, and import actors of other libraries."""

from __future__ import annotations

import dataclasses
import io
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from surefoot.cli.terminal import say, working
from surefoot.errors import UserError
from surefoot.whole_file import write_whole

if TYPE_CHECKING:
    from surefoot.agents.network import NetworkAgent

_CHECKPOINTS = (".zip", ".pt", ".pth")


@dataclass(frozen=True)
class Export:
    """Write a policy for a runtime (surefoot docs policy-file) or a library, or import one (surefoot docs exchange)."""

    policy: Annotated[str, tyro.conf.Positional]
    """A shipped policy's name, a policy file (.onnx), a run folder, or a checkpoint of stable-baselines3 (.zip), rsl_rl
    or skrl (.pt, .pth)."""
    onnx: Path | None = None
    """Write the policy file with its full contract to this .onnx file; older policy files lack parts of it."""
    weights: Path | None = None
    """Write the network to this .pt file as the actor of another library, in the format given by
    --layout."""
    layout: str = "rsl_rl"
    """Format of --weights: rsl_rl, rsl_rl-3 (until version 3), skrl, skrl-shared, sb3 (PPO, A2C, TRPO), sb3-td3 or
    sb3-sac."""
    activation: str = ""
    """Activation between the layers of a checkpoint's actor: tanh, relu or elu. The default is the library's own."""
    robot: str = ""
    """Robot of a checkpoint's actor: a shipped robot's name, or a description (.toml). The default is Valkyrie."""
    pose: str = ""
    """Pose of the robot that an action of zero means in a checkpoint. The default is the gymnasium environment's."""
    action_scale: float = 0.0
    """Joint angle per unit of a checkpoint's action [rad]. The default is the gymnasium environment's."""
    vectors: Path | None = None
    """Write golden vectors to this .csv file: every intermediate number of a run of two seconds."""

    def main(self) -> None:
        """Write what is asked for."""
        from surefoot.agents.policy_file import with_terms
        from surefoot.evaluation.golden_vectors import golden_vectors

        for name, file, suffix in (
            ("onnx", self.onnx, ".onnx"),
            ("vectors", self.vectors, ".csv"),
            ("weights", self.weights, ".pt"),
        ):
            if file and file.suffix != suffix:
                raise UserError(f"--{name} must be a {suffix} file, not {file}")
        if not (self.onnx or self.vectors or self.weights):
            raise UserError("nothing to export; name a file by --onnx, --vectors or --weights")
        policy = self._policy()
        if self.onnx:
            write_whole(self.onnx, with_terms(policy.data))
            say(f"policy: {self.onnx}")
        if self.vectors:
            with working(f"running {policy.name}"):
                found = golden_vectors(policy)
            found.write(self.vectors)
            say(f"vectors: {self.vectors}, {len(found.rows)} rows of {len(found.columns)} numbers")
        if self.weights:
            self._write_weights(policy, self.weights)

    def _policy(self) -> NetworkAgent:
        """The policy, or that of a checkpoint."""
        from surefoot.agents.load import load_policy

        if Path(self.policy).suffix not in _CHECKPOINTS:
            return load_policy(self.policy)
        from surefoot.cli.terminal import needs_torch

        with needs_torch():
            from surefoot.learning.exchange import policy_from
            from surefoot.learning.robot_scale import default_config
        config = default_config(self.robot or None)
        if self.pose:
            config = dataclasses.replace(config, pose=self.pose)
        if self.action_scale:
            config = dataclasses.replace(config, action_scale=self.action_scale)
        policy = policy_from(self.policy, config=config, activation=self.activation or None)
        training = policy.contract.training["algorithm"]
        say(f"{self.policy}: {training}, layers of {policy.hidden}, {policy.activation} between them")
        return policy

    def _write_weights(self, policy: NetworkAgent, path: Path) -> None:
        from surefoot.cli.terminal import needs_torch

        with needs_torch():
            import torch

            from surefoot.learning.exchange import state_dict
        written = io.BytesIO()
        torch.save(state_dict(policy, self.layout), written)
        write_whole(path, written.getvalue())
        say(f"weights: {path}, laid out for {self.layout}; {policy.activation} between the layers")
