"""Exchange: actors of stable-baselines3, rsl_rl and skrl as policy files, and policies as their networks.

A checkpoint is read without its pickled parts: of a zip of stable-baselines3 the weights alone, of the other two what
torch loads with `weights_only`.
"""

from __future__ import annotations

import io
import re
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from surefoot.agents.network import NetworkAgent
from surefoot.agents.policy_file import ACTIVATIONS, network_bytes
from surefoot.checks import check_path
from surefoot.errors import UserError
from surefoot.learning.actor import Layers
from surefoot.learning.robot_scale import default_config
from surefoot.robots import load_robot
from surefoot.task.contract import Contract
from surefoot.task.environment import EnvConfig

MAX_BYTES = 512_000_000
"""Of a checkpoint, and of the weights in a zip."""
State = Mapping[str, Any]
"""Name -> tensor, as `state_dict` gives them."""


@dataclass(frozen=True)
class Layout:
    """How a library names the layers of its actors.

    Attributes:
        words: its name, and of which algorithms if it has several layouts.
        key: of the actor's tensors in a checkpoint; empty if they are the whole.
        hidden: beginning of the names of the numbered layers.
        last: beginning of the name of the last layer, if it is not a numbered one.
        squash: does a tanh follow the last layer?
        activation: between the layers, unless somebody has chosen another one.
        mean, spread: keys to the observation's mean and to its deviation or variance, if there are any.
        is_variance: is the spread a variance?
        least: what the library adds to the deviation.
    """

    words: str
    key: str
    hidden: str
    last: str = ""
    squash: bool = False
    activation: str = "elu"
    mean: tuple[str, ...] = ()
    spread: tuple[str, ...] = ()
    is_variance: bool = False
    least: float = 0.0


def _skrl(words: str, last: str) -> Layout:
    mean, spread = (("observation_preprocessor", f"running_{what}") for what in ("mean", "variance"))
    return Layout(words, "policy", "net_container", last, mean=mean, spread=spread, is_variance=True, least=1e-8)


def _rsl_rl(words: str, key: str, hidden: str, normaliser: str) -> Layout:
    mean, spread = ((key, f"{normaliser}.{what}") for what in ("_mean", "_std"))
    return Layout(words, key, hidden, mean=mean, spread=spread, least=1e-2)


LAYOUTS = {
    "sb3": Layout("stable-baselines3 (PPO, A2C, TRPO)", "", "mlp_extractor.policy_net", "action_net", False, "tanh"),
    "sb3-td3": Layout("stable-baselines3 (DDPG, TD3)", "", "actor.mu", "", True, "relu"),
    "sb3-sac": Layout("stable-baselines3 (SAC)", "", "actor.latent_pi", "actor.mu", True, "relu"),
    "rsl_rl": _rsl_rl("rsl_rl", "actor_state_dict", "mlp", "obs_normalizer"),
    "rsl_rl-3": _rsl_rl("rsl_rl until 3", "model_state_dict", "actor", "actor_obs_normalizer"),
    "skrl-shared": _skrl("skrl (one network for policy and value)", "policy_layer"),
    "skrl": _skrl("skrl", ""),
}
"""By the word that a user gives."""


@dataclass(frozen=True, eq=False)
class Actor:
    """A network from observations to actions: (observation - mean) / deviation through linear layers.

    Attributes:
        source: the library that it comes from.
        layers: (weight (out, in), bias (out,)) of every layer.
        activation: between the layers, one of `ACTIVATIONS`.
        squash: does a tanh follow the last layer?
        mean, deviation: of the observation (num_inputs,).
    """

    source: str
    layers: Layers
    activation: str
    squash: bool
    mean: np.ndarray
    deviation: np.ndarray


def policy_from(
    source: str | Path | State | Any,
    robot: str | None = None,
    config: EnvConfig | None = None,
    activation: str | None = None,
) -> NetworkAgent:
    """Make a policy from an actor that another library trained in this package's environment.

    Args:
        source: a checkpoint of stable-baselines3 (.zip), rsl_rl or skrl (.pt); the result of `torch.load` on one; or a
            model of stable-baselines3.
        robot: the robot that it moves, if there is no config. The default is Valkyrie.
        config: the task that it learned, for its robot, pose and action scale. The default is that of
            `gymnasium.make("surefoot/PushRecovery-v0")`.
        activation: activation between its layers. The default is the library's usual one, or a model's own.

    Returns:
        The policy; its attribute `data` holds the bytes of its file.

    Raises:
        UserError: the source is none of these, or the actor does not fit the robot.
    """
    config = config or default_config(robot)
    actor = read_actor(source, activation)
    contract = Contract.of(load_robot(config.robot), config.pose, config.action_scale, {"algorithm": actor.source})
    sizes = actor.layers[0][0].shape[1], actor.layers[-1][0].shape[0]
    expected = contract.num_inputs, len(contract.joints)
    if sizes != expected:
        raise UserError("the actor maps {} numbers to {}; {} has {} and {}".format(*sizes, contract.robot, *expected))
    data = network_bytes(actor.layers, actor.mean, actor.deviation, actor.squash, contract, actor.activation)
    return NetworkAgent(data, Path(source).stem if isinstance(source, str | Path) else "policy")


def read_actor(source: str | Path | State | Any, activation: str | None = None) -> Actor:
    """Read an actor, as `policy_from` takes it.

    Raises:
        UserError: the source is no such thing.
    """
    if activation is not None and activation not in ACTIVATIONS:
        raise UserError(f"unknown activation '{activation}'; valid: {', '.join(ACTIVATIONS)}")
    what = str(source) if isinstance(source, str | Path) else "the checkpoint"
    if isinstance(source, str | Path):
        source = _loaded(Path(source))
    elif not isinstance(source, Mapping):
        activation = activation or _activation_of(source)
        source = source.policy.state_dict()
    for layout in LAYOUTS.values():
        state = source.get(layout.key) if layout.key else source
        layers = _layers(state, layout) if isinstance(state, Mapping) else []
        if layers:
            mean, deviation = _normalisation(source, layout, layers[0][0].shape[1])
            return Actor(layout.words, layers, activation or layout.activation, layout.squash, mean, deviation)
    valid = ", ".join(layout.words for layout in LAYOUTS.values())
    raise UserError(f"{what} holds no actor of linear layers that is known; valid: {valid}")


def state_dict(policy: NetworkAgent, layout: str) -> dict[str, Any]:
    """Return a policy's network as a checkpoint of another library, with the actor alone.

    The normalisation of the observation is inside the first layer, so the library must not normalise.

    Args:
        policy: the policy with the network.
        layout: a key of `LAYOUTS`.

    Raises:
        UserError: the layout is unknown, or only one of the policy and the layout's actors has a tanh behind its last
            layer.
    """
    if layout not in LAYOUTS:
        raise UserError(f"unknown layout '{layout}'; valid: {', '.join(LAYOUTS)}")
    names = LAYOUTS[layout]
    if names.squash != policy.squash:
        has = "a tanh" if policy.squash else "no tanh"
        fitting = ", ".join(name for name, other in LAYOUTS.items() if other.squash == policy.squash)
        raise UserError(f"{policy.name} has {has} behind its last layer, unlike {names.words}; valid: {fitting}")
    found = {}
    for number, (weight, bias) in enumerate(policy.stored_layers()):
        is_last = names.last and number == len(policy.hidden)
        name = names.last if is_last else f"{names.hidden}.{2 * number}"
        found[f"{name}.weight"], found[f"{name}.bias"] = torch.from_numpy(weight), torch.from_numpy(bias)
    return {names.key: found} if names.key else found


def put_policy(policy: NetworkAgent, model: Any) -> None:
    """Copy the network of a policy into a model of stable-baselines3, which keeps its critic.

    Raises:
        UserError: the model's actor has other layers.
    """
    known = model.policy.state_dict()
    layout = next((name for name, names in LAYOUTS.items() if not names.key and _layers(known, names)), "")
    if not layout:
        raise UserError("the model's actor is not one of linear layers")
    activation = _activation_of(model)
    if activation != policy.activation:
        raise UserError(f"the model's activation is {activation}, that of {policy.name} is {policy.activation}")
    new = state_dict(policy, layout)
    ours, theirs = ({name: tuple(state[name].shape) for name in state if name in new} for state in (new, known))
    if ours != theirs or _sizes(known, layout) != len(policy.hidden) + 1:
        raise UserError(f"the model's actor has other layers than {policy.name}, which has {policy.hidden}")
    model.policy.load_state_dict({**known, **new})
    if hasattr(model.policy, "actor_target"):
        model.policy.actor_target.load_state_dict(model.policy.actor.state_dict())


def _sizes(state: State, layout: str) -> int:
    return len(_layers(state, LAYOUTS[layout]))


def _loaded(path: Path) -> State:
    """The tensors of a checkpoint, without any pickle.

    Raises:
        UserError: the file is missing, too large, or is none.
    """
    check_path("checkpoint", path)
    try:
        if path.stat().st_size > MAX_BYTES:
            raise UserError(f"{path} has more than {MAX_BYTES:,} bytes")
        found = torch.load(_weights(path), map_location="cpu", weights_only=True)
    except OSError as error:
        raise UserError(f"cannot read checkpoint {path}: {error.strerror or error}") from error
    except UserError:
        raise
    except Exception as error:  # torch raises a family of types for a file that is no checkpoint or holds pickles
        raise UserError(f"{path} is no checkpoint that can be read without running code in it") from error
    if not isinstance(found, Mapping):
        raise UserError(f"{path} holds no named tensors")
    return found


def _weights(path: Path) -> io.BytesIO | Path:
    """Of a zip of stable-baselines3 the weights; any other file is for torch itself."""
    if not zipfile.is_zipfile(path):
        return path
    with zipfile.ZipFile(path) as archive:
        if _SB3_WEIGHTS not in archive.namelist():
            return path
        if archive.getinfo(_SB3_WEIGHTS).file_size > MAX_BYTES:
            raise UserError(f"the weights in {path} have more than {MAX_BYTES:,} bytes")
        return io.BytesIO(archive.read(_SB3_WEIGHTS))


_SB3_WEIGHTS = "policy.pth"


def _layers(state: State, layout: Layout) -> Layers:
    """The linear layers of an actor in order; none if it is another layout's."""
    pattern = re.compile(re.escape(layout.hidden) + r"\.(\d+)\.weight")
    numbers = sorted(int(match[1]) for name in state if isinstance(name, str) and (match := pattern.fullmatch(name)))
    names = [f"{layout.hidden}.{number}" for number in numbers] + ([layout.last] if layout.last else [])
    keys = [f"{name}.{part}" for name in names for part in ("weight", "bias")]
    if not numbers or not all(isinstance(state.get(key), torch.Tensor) for key in keys):
        return []
    arrays = [state[key].detach().cpu().to(torch.float32).numpy() for key in keys]
    layers = list(zip(arrays[::2], arrays[1::2], strict=True))
    sizes = [layers[0][0].shape[-1], *(len(bias) for _, bias in layers)]
    if [weight.shape for weight, _ in layers] != list(zip(sizes[1:], sizes[:-1], strict=True)):
        return []
    return layers


def _normalisation(checkpoint: State, layout: Layout, num_inputs: int) -> tuple[np.ndarray, np.ndarray]:
    mean, spread = (_found(checkpoint, place) for place in (layout.mean, layout.spread))
    if mean is None or spread is None:
        return np.zeros(num_inputs), np.ones(num_inputs)
    if len(mean) != num_inputs or len(spread) != num_inputs:
        raise UserError(f"the observation's statistics have {len(mean)} numbers, the actor takes {num_inputs}")
    return mean, (np.sqrt(spread) if layout.is_variance else spread) + layout.least


def _found(checkpoint: State, place: tuple[str, ...]) -> np.ndarray | None:
    value: Any = checkpoint
    for key in place:
        value = value.get(key) if isinstance(value, Mapping) else None
    return value.detach().cpu().numpy().astype(float).ravel() if isinstance(value, torch.Tensor) and place else None


def _activation_of(model: Any) -> str:
    name = model.policy.activation_fn.__name__.lower()
    if name not in ACTIVATIONS:
        raise UserError(f"the model's activation is {name}; valid: {', '.join(ACTIVATIONS)}")
    return str(name)
