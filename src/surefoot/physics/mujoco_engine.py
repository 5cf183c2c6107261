"""MuJoCo as an engine: many robots on all cores at 500 Hz.

Joint targets and wrenches go in, one call advances every robot by one policy step (20 ticks), and a `StepRecord` comes
out. Quantities are in the world frame and in SI units unless their name says otherwise. A tick is recorded at its
start, before the physics step that it begins.
"""

from __future__ import annotations

import mujoco
import numpy as np
from mujoco.batch import Batch

from surefoot.physics.engine import WHOLE_STEP
from surefoot.physics.mujoco_sensors import model_with_sensors
from surefoot.physics.rotations import sole_corners, stance_quaternion, z_axis
from surefoot.physics.step_record import StepRecord
from surefoot.rates import CONTROL_HZ, TICKS_PER_STEP
from surefoot.robots import Robot
from surefoot.robots.domain import NOMINAL_DOMAIN, DomainParameters
from surefoot.robots.model import DAMPING_COLUMN, FLOOR, STIFFNESS_COLUMN

_CONTROL_SPEC = int(mujoco.mjtState.mjSTATE_CTRL) | int(mujoco.mjtState.mjSTATE_XFRC_APPLIED)
_UPRIGHT = (1.0, 0.0, 0.0, 0.0)
_AT_REST = ("qvel", "qacc_warmstart", "xfrc_applied")
_DIVERGENCE_WARNINGS = slice(int(mujoco.mjtWarning.mjWARN_BADQPOS), int(mujoco.mjtWarning.mjNWARNING))
_TOUCH = 1e-6
"""A robot is put down so deep [m]: with soles at exactly zero, rounding would decide whether they touch."""
_RELAX_S, _RELAX_TIMES = 0.08, 4
"""A robot that is put on the floor holds its pose for this time [s], so many times, and is stopped after each: by then
its weight is on its feet to within 1 %. The time is a quarter of the period of a joint that swings at 20 rad/s."""

ENGINE_NAME = f"mujoco {mujoco.__version__}"
"""The engine and its version, which every result is kept with."""


class MujocoEngine:
    """`num_robots` copies of a robot on all cores: an `Engine`.

    Args:
        robot: what is simulated.
        num_robots: how many of it.
        num_threads: 0 for all cores.
        domain: floor, masses, motors and physics rate.

    Attributes:
        wrench: forces and torques on every body (`Robot.body_names`) over the next policy step, (num_robots,
            TICKS_PER_STEP, num_bodies, 6), world frame at the body's CoM [N, Nm]; the caller writes and clears it.
        joint_targets: of the next policy step, (num_robots, TICKS_PER_STEP, num_joints) [rad]; the caller writes them.
        diverged: bool (num_robots,), who became non-finite since the last policy step began (with its first tick) and
            was put back to its default state.
        num_diverged: how many have, ever.
    """

    name = ENGINE_NAME

    def __init__(self, robot: Robot, num_robots: int, num_threads: int = 0, domain: DomainParameters = NOMINAL_DOMAIN):
        _keep_mujoco_quiet()
        self.robot = robot
        self.num_robots = num_robots
        self.model = model_with_sensors(robot, domain)
        self._num_substeps = round(domain.physics_hz / CONTROL_HZ)
        self._floor_normal = z_axis(self.model.geom(FLOOR).quat)
        self.batch = Batch(self.model, num_robots, nthread=num_threads)
        self._qpos = self.batch.bind("qpos")
        self._qvel = self.batch.bind("qvel")
        self._bound = {name: self.batch.bind(name) for name in (*_AT_REST, "ctrl")}
        self._sensordata = self.batch.bind("sensordata")
        self._record = np.zeros((num_robots, TICKS_PER_STEP, self.model.nsensordata))
        num_controls = self.model.nu + 6 * self.model.nbody
        self._control = np.zeros((num_robots, TICKS_PER_STEP, num_controls))
        self.joint_targets = self._control[..., : self.model.nu]
        wrench = self._control[..., self.model.nu :]
        of_bodies = wrench.reshape(num_robots, TICKS_PER_STEP, self.model.nbody, 6)
        self.wrench = of_bodies[:, :, 1:]  # without MuJoCo's world body
        self.diverged = np.zeros(num_robots, bool)
        self.num_diverged = 0
        self._warnings = np.zeros(num_robots, np.int64)
        self._friction: np.ndarray | None = None
        self._motors: np.ndarray | None = None

    def reset(
        self,
        ids: np.ndarray,
        joint_position: np.ndarray,
        yaw: np.ndarray | float = 0.0,
        height: np.ndarray | float = 0.0,
        roll: np.ndarray | float = 0.0,
        pitch: np.ndarray | float = 0.0,
    ) -> StepRecord:
        """Put robots `ids` (n,) at rest, as `Engine.reset` says.

        A pose on the floor is relaxed: the joint impedance holds it while the weight settles on the feet, and the
        robot is stopped again and again, so that it ends at rest before it can sway.
        """
        self._stop(ids)
        self._bound["ctrl"][ids] = joint_position
        self._qpos[ids, :2] = 0.0
        self._qpos[ids, 2] = self.model.qpos0[2]
        self._qpos[ids, 7:] = joint_position
        upright = not (np.any(roll) or np.any(pitch) or np.any(yaw))
        self._qpos[ids, 3:7] = _UPRIGHT if upright else stance_quaternion(roll, pitch, yaw)
        self.batch.forward(ids, stage=int(mujoco.mjtStage.mjSTAGE_POS))
        soles = self.read(ids)
        corners = sole_corners(soles.sole_position, soles.foot_orientation, self.robot.sole_half_size)
        clearance = (corners @ self._floor_normal / self._floor_normal[2]).min(axis=(1, 2, 3))
        self._qpos[ids, 2] += height - _TOUCH - clearance
        on_floor = np.equal(height, 0.0) & np.equal(roll, 0.0) & np.equal(pitch, 0.0)
        self.relax(ids[np.broadcast_to(on_floor, len(ids))])
        self.batch.forward(ids)
        return self.read(ids)

    def relax(self, ids: np.ndarray) -> None:
        """Let the weight of robots `ids` (n,) settle on their feet, and end at rest; bare physics, as `advance`."""
        if not len(ids):
            return
        num_ticks = round(_RELAX_S / self.model.opt.timestep)
        held = np.zeros((len(ids), num_ticks, self._control.shape[2]))
        held[..., : self.model.nu] = self._bound["ctrl"][ids, None]
        for _ in range(_RELAX_TIMES):
            self.batch.rollout(num_ticks, held, _CONTROL_SPEC, ids=ids)
            self._stop(ids)

    def _stop(self, ids: np.ndarray) -> None:
        for name in _AT_REST:  # `Batch.reset` does the same in five times the time
            self._bound[name][ids] = 0.0

    def rest_states(self, ids: np.ndarray) -> np.ndarray:
        """Where robots `ids` (n,) are and what their motors hold, if they are at rest: (n, size)."""
        return np.concatenate([self._qpos[ids], self._bound["ctrl"][ids]], axis=1)

    def restart(self, ids: np.ndarray, states: np.ndarray) -> StepRecord:
        """Put robots `ids` (n,) at rest into states (n, size) of `rest_states`; returns one tick of each."""
        self._stop(ids)
        self._qpos[ids], self._bound["ctrl"][ids] = np.split(states, [self.model.nq], axis=1)
        self.batch.forward(ids)
        return self.read(ids)

    def read(self, ids: np.ndarray) -> StepRecord:
        """One tick (n, 1, ...) of robots `ids`: their state at the last reset or at the last physics step."""
        return StepRecord(self.robot, self._sensordata[ids][:, None])

    def step(self, ids: np.ndarray | None = None, ticks: slice = WHOLE_STEP) -> StepRecord:
        """Advance robots under what `joint_targets` and `wrench` hold for them.

        Args:
            ids: the robots (n,); all of them without it.
            ticks: which ticks of the policy step; all of them without it.

        Returns:
            The record of these robots and ticks. That of a whole step lies in a buffer that the next whole step
            overwrites.
        """
        record = self.advance(ids, ticks)
        self._find_diverged(record, ids, begins=not ticks.start)
        return StepRecord(self.robot, record)

    def advance(self, ids: np.ndarray | None = None, ticks: slice = WHOLE_STEP) -> np.ndarray:
        """Advance robots as `step` does, without a look for non-finite numbers: the bare physics.

        Returns:
            The record (n, num_ticks, num_sensor_values).
        """
        if ticks == WHOLE_STEP:
            control = self._control if ids is None else self._control[ids]
            record = self._record if ids is None else self._record[: len(ids)]
        else:
            control = np.ascontiguousarray(self._control[slice(None) if ids is None else ids, ticks])
            record = np.empty((*control.shape[:2], self.model.nsensordata))
        if self._num_substeps > 1:
            return self._advance_finely(control, record, ids)
        num_ticks = control.shape[1]
        self.batch.rollout(
            num_ticks, control, _CONTROL_SPEC, record=["sensordata"], ids=ids, out={"sensordata": record}
        )
        return record

    def _advance_finely(self, control: np.ndarray, record: np.ndarray, ids: np.ndarray | None) -> np.ndarray:
        fine = np.repeat(control, self._num_substeps, axis=1)
        all_substeps = self.batch.rollout(fine.shape[1], fine, _CONTROL_SPEC, record=["sensordata"], ids=ids)
        record[:] = all_substeps["sensordata"][:, :: self._num_substeps]
        return record

    def _find_diverged(self, record: np.ndarray, ids: np.ndarray | None, begins: bool) -> None:
        warnings = self.batch.warning[:, _DIVERGENCE_WARNINGS, 1].sum(axis=1)
        found = warnings > self._warnings
        self.diverged = found if begins else self.diverged | found
        if found.any():
            self.num_diverged += int(found.sum())
            rows = found if ids is None else found[ids]
            record[rows] = np.nan_to_num(record[rows], posinf=0.0, neginf=0.0)
            self.batch.reset(np.flatnonzero(found))
            self._warnings = np.where(found, 0, warnings)

    def set_friction(self, friction: float) -> None:
        """Give every pair of bodies this coefficient of sliding friction from now on."""
        if self._friction is None:
            self._friction = self.batch.expand("geom_friction")
        self._friction[..., 0] = friction

    def set_gains(self, stiffness: np.ndarray, damping: np.ndarray) -> None:
        """Drive all robots' joints by this impedance (num_joints,) [Nm/rad, Nms/rad]; the motors' limits stay."""
        if self._motors is None:
            if np.array_equal([stiffness, damping], [self.robot.stiffness, self.robot.damping]):
                return  # the model has them already
            self._motors = self.batch.expand("actuator_gainprm").reshape(self.num_robots, self.model.nu, -1)
        self._motors[..., STIFFNESS_COLUMN] = stiffness
        self._motors[..., DAMPING_COLUMN] = damping

    @property
    def state(self) -> tuple[np.ndarray, np.ndarray]:
        """Live qpos (num_robots, nq) and qvel (num_robots, nv), in MuJoCo's order."""
        return self._qpos, self._qvel

    def copy_state(self, other: MujocoEngine) -> None:
        """Take over the states of another simulation of as many robots."""
        self._qpos[:], self._qvel[:] = other.state
        self.batch.bind("qacc_warmstart")[:] = other.batch.bind("qacc_warmstart")

    def copy_control(self, other: MujocoEngine) -> None:
        """Take over the joint targets and wrenches of another simulation's last step."""
        self._control[:] = other._control


def _keep_mujoco_quiet() -> None:
    """Keep MuJoCo from telling of every divergence on standard error and in a file: `diverged` says the same."""
    log = mujoco.MjLogConfig.get()
    log.logto_console = log.logto_file = False
    log.set()
