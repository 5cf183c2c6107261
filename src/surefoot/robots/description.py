"""Description: the TOML file of the facts that a robot's MJCF file lacks, checked key by key."""

from __future__ import annotations

import fnmatch
import importlib.util
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from surefoot.checks import check_path, is_number, parse_toml, read_text, shortened
from surefoot.errors import UserError

_KEYS = {
    "model": str, "title": str, "root": str, "torso": dict, "feet": dict, "motors": dict, "held": dict, "poses": dict,
    "default_pose": str, "pushable": dict, "load_unit": float, "floor": dict, "own_floor": str, "own_actuators": bool,
    "symmetric": bool, "contacts": str,
    "cone": str, "impratio": float, "package": str, "install": str, "ranges": dict, "collision_group": int,
}  # fmt: skip
_NEEDED = ("model", "root", "feet", "motors", "poses")
CONTACTS = ("file", "legs")
"""What touches what: as the MJCF file says, or everything the floor and each leg the other leg, and nothing else."""
CONES = ("pyramidal", "elliptic")
_LARGE = 1e12
"""No number of a robot is as large."""
_T = TypeVar("_T")
_WORDS = {str: "a text", dict: "a table", float: "a number", bool: "true or false", int: "a whole number"}


@dataclass(frozen=True)
class Motor:
    """The joint law of a motor and its limits; None where the MJCF's own actuator says it.

    Attributes:
        stiffness: [Nm/rad].
        damping: [Nms/rad].
        torque: its limit [Nm].
        speed: its limit [rad/s].
        armature: reflected inertia, in place of the MJCF's [kg m^2].
    """

    stiffness: float | None = None
    damping: float | None = None
    torque: float | None = None
    speed: float | None = None
    armature: float | None = None


@dataclass(frozen=True)
class Floor:
    """The floor that is added to the model.

    Attributes:
        friction: sliding friction coefficient.
        solref: MuJoCo's time constant [s] and damping ratio of its contacts.
    """

    friction: float = 1.0
    solref: tuple[float, float] = (0.01, 1.0)


@dataclass(frozen=True)
class Description:
    """A robot as its TOML file describes it. Joints are named exactly or by a pattern such as ``"*_hip_roll"``.

    Attributes:
        file: the TOML file, for errors.
        model: path of the MJCF file.
        title: how people call the robot.
        root: the floating body.
        torso: body that is kept upright.
        torso_site: site that stands for the torso's position; the torso's CoM in the sagittal plane without it.
        feet: bodies of the left and the right foot.
        motors: joint name or pattern -> motor; these are the controlled joints, in the model's order.
        held: joint name or pattern -> angle [rad] at which a joint that is not controlled is welded.
        poses: name -> joint name or pattern -> angle [rad]; joints that are not named are at 0.
        default_pose: name of the pose that is used where none is asked for.
        pushable: word -> body that may be pushed under this word.
        load_unit: unit of the foot forces in the observation [N]; 0.6 of the weight without it.
        floor: of the model, unless `own_floor` is given.
        own_floor: geom of the MJCF file that is the floor; otherwise planes in its world are removed.
        own_actuators: motors take what they do not say from the MJCF's position actuators.
        symmetric: true if the robot must be its own mirror image, false if it need not; without it, one that is not
            is told of and goes without a mirror.
        ranges: joint name or pattern -> smallest and largest angle [rad], in place of the MJCF's.
        collision_group: shapes of this group can touch, even if the MJCF takes them out of all contacts.
        contacts: which shapes touch each other: one of `CONTACTS`.
        cone: shape of the friction cones, one of `CONES`; the MJCF's without it.
        impratio: stiffness of friction over that of the normal force, MuJoCo's option; the MJCF's without it.
    """

    file: Path
    model: Path
    title: str
    root: str
    torso: str
    torso_site: str
    feet: tuple[str, str]
    motors: Mapping[str, Motor]
    held: Mapping[str, float]
    poses: Mapping[str, Mapping[str, float]]
    default_pose: str
    pushable: Mapping[str, str]
    load_unit: float | None = None
    floor: Floor = field(default_factory=Floor)
    own_floor: str = ""
    own_actuators: bool = False
    symmetric: bool | None = None
    contacts: str = CONTACTS[0]
    cone: str = ""
    impratio: float | None = None
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    collision_group: int | None = None

    def motor(self, joint: str) -> Motor | None:
        """The motor of a joint; None if it is not controlled."""
        return lookup(self.motors, joint)


def lookup(table: Mapping[str, _T], joint: str) -> _T | None:
    """Return a table's value for a joint: by its name, else by the first pattern that fits."""
    if joint in table:
        return table[joint]
    return next((value for pattern, value in table.items() if fnmatch.fnmatchcase(joint, pattern)), None)


def read_description(file: Path) -> Description:
    """Read a robot's TOML file.

    Raises:
        UserError: the file is missing, is not TOML, or has a wrong key or value; the message names it.
    """
    values = _read_table(file)
    model = _model_folder(values, file) / values["model"]
    check_path(f"{file}: model", model)
    if not model.is_file():
        raise UserError(f"{file}: model: there is no file {model}")
    torso = values.get("torso", {"body": values["root"]})
    _check_texts(torso, f"{file}: torso", ("body", "site"), ("body",))
    feet = values["feet"]
    _check_texts(feet, f"{file}: feet", ("left", "right"), ("left", "right"))
    poses, default_pose = _poses(values, file)
    return Description(
        file=file,
        model=model,
        title=values.get("title", file.stem),
        root=values["root"],
        torso=torso["body"],
        torso_site=torso.get("site", ""),
        feet=(feet["left"], feet["right"]),
        motors={name: _motor(motor, f"{file}: motor {name}") for name, motor in values["motors"].items()},
        held=_angles(values.get("held", {}), f"{file}: held"),
        poses=poses,
        default_pose=default_pose,
        pushable=_texts(values.get("pushable", {}), f"{file}: pushable"),
        load_unit=values.get("load_unit"),
        floor=_floor(values.get("floor", {}), f"{file}: floor"),
        own_floor=values.get("own_floor", ""),
        own_actuators=values.get("own_actuators", False),
        symmetric=values.get("symmetric"),
        contacts=_one_of(values, "contacts", CONTACTS, file) or CONTACTS[0],
        cone=_one_of(values, "cone", CONES, file),
        impratio=values.get("impratio"),
        ranges={name: _range(pair, f"{file}: ranges: {name}") for name, pair in values.get("ranges", {}).items()},
        collision_group=values.get("collision_group"),
    )


def _read_table(file: Path) -> dict[str, Any]:
    """The file's table, its keys and the kinds of their values checked."""
    values = parse_toml(read_text(file, "robot"), f"robot {file}")
    _check_keys(values, _KEYS, str(file), _NEEDED)
    for key, value in values.items():
        _check_kind(value, _KEYS[key], f"{file}: {key}")
    return values


def _model_folder(values: dict[str, Any], file: Path) -> Path:
    """The folder from which the model's path counts: the description's, or that of an installed Python package."""
    package = values.get("package")
    if package is None:
        return file.parent
    found = importlib.util.find_spec(package) if package.isidentifier() else None
    if found is None or not found.submodule_search_locations:
        what = values.get("install", package.replace("_", "-"))
        raise UserError(f"{file}: package: '{package}' is not installed; pip install '{what}'")
    return Path(next(iter(found.submodule_search_locations)))


def _poses(values: dict[str, Any], file: Path) -> tuple[dict[str, dict[str, float]], str]:
    """The poses, and the name of the default one."""
    poses = {name: _angles(pose, f"{file}: pose {name}") for name, pose in values["poses"].items()}
    if not poses:
        raise UserError(f"{file}: at least one pose is needed")
    default_pose = values.get("default_pose", next(iter(poses)))
    if default_pose not in poses:
        raise UserError(f"{file}: unknown default_pose '{shortened(default_pose)}'; valid: {', '.join(poses)}")
    return poses, default_pose


def _one_of(values: dict[str, Any], key: str, valid: Sequence[str], file: Path) -> str:
    """The value of a key that takes one of some words; empty without the key."""
    word: str = values.get(key, "")
    if key in values and word not in valid:
        raise UserError(f"{file}: unknown {key} '{shortened(word)}'; valid: {', '.join(valid)}")
    return word


def _motor(values: Any, where: str) -> Motor:
    _check_kind(values, dict, where)
    _check_keys(values, dict.fromkeys(Motor.__annotations__, float), where)
    for key, value in values.items():
        if not _is_number(value) or value < 0.0:
            raise UserError(f"{where}: {key} must be a number that is not negative, not {shortened(value)}")
        if key in ("torque", "speed") and value == 0.0:
            raise UserError(f"{where}: {key} must be above 0, not {value}; a joint without a motor is held")
    return Motor(**{key: float(value) for key, value in values.items()})


def _range(value: Any, where: str) -> tuple[float, float]:
    if not (isinstance(value, list) and len(value) == 2 and all(map(_is_number, value)) and value[0] < value[1]):
        raise UserError(f"{where} must be two numbers [rad], the smaller one first, not {value}")
    return float(value[0]), float(value[1])


def _floor(values: dict[str, Any], where: str) -> Floor:
    _check_keys(values, {"friction": float, "solref": list}, where)
    friction, solref = values.get("friction", Floor.friction), values.get("solref", list(Floor.solref))
    if not _is_number(friction) or friction < 0.0:
        raise UserError(f"{where}: friction must be a number that is not negative, not {shortened(friction)}")
    if not (isinstance(solref, list) and len(solref) == 2 and all(map(_is_number, solref))):
        raise UserError(f"{where}: solref must be two numbers, not {shortened(solref)}")
    return Floor(float(friction), (float(solref[0]), float(solref[1])))


def _angles(values: Any, where: str) -> dict[str, float]:
    _check_kind(values, dict, where)
    for joint, angle in values.items():
        if not _is_number(angle):
            raise UserError(f"{where}: the angle of {joint} must be a number [rad], not {shortened(angle)}")
    return {joint: float(angle) for joint, angle in values.items()}


def _texts(values: dict[str, Any], where: str) -> dict[str, str]:
    for key, value in values.items():
        _check_kind(value, str, f"{where}: {key}")
    return values


def _check_texts(values: dict[str, Any], where: str, valid: Sequence[str], needed: Sequence[str]) -> None:
    _check_keys(values, dict.fromkeys(valid, str), where, needed)
    _texts(values, where)


def _check_keys(values: dict[str, Any], valid: Mapping[str, object], where: str, needed: Sequence[str] = ()) -> None:
    unknown = [key for key in values if key not in valid]
    if unknown:
        raise UserError(f"{where}: unknown key '{shortened(unknown[0])}'; valid: {', '.join(valid)}")
    missing = [key for key in needed if key not in values]
    if missing:
        raise UserError(f"{where}: key '{missing[0]}' is needed")


def _check_kind(value: Any, kind: type, where: str) -> None:
    fits = _is_number(value) if kind is float else isinstance(value, kind) and isinstance(value, bool) == (kind is bool)
    if not fits:
        raise UserError(f"{where} must be {_WORDS[kind]}, not {shortened(value)}")


def _is_number(value: Any) -> bool:
    return is_number(value) and abs(value) < _LARGE
