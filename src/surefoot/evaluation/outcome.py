"""The outcome of a trial."""

from __future__ import annotations

from dataclasses import dataclass

from surefoot.robots import Robot


@dataclass(frozen=True)
class Outcome:
    """The outcome of a trial.

    Attributes:
        recovered: whether the robot recovered, by the one definition of success (`docs/method.md`).
        reason: "recovered", "fell", "restless" (CoM too fast at the end), "tilted" or "diverged"; or the failure of
            its controller: "raised", "not finite", "wrong shape" or "too late".
        seconds: time from the beginning of the disturbance to the end of the trial; negative if the trial ended first.
        foot_shift: largest distance of a foot from its place at the disturbance [m].
        com_speed: mean speed over the judged time [m/s]; NaN if the trial ended before.
        root_tilt: largest angle of the root from upright since the disturbance began [rad].
        ankle, hip, foot_tilt, steps: the strategies (`surefoot.evaluation.strategies`); steps are counted.
        quiet_drift: largest horizontal distance of the CoM from its place at the beginning of the quiet time [m].
        quiet_power: mean of sum |torque * velocity| over the quiet time [W].
        quiet_steps: steps in the quiet time. These three are NaN for a trial that ended before its horizon.
        torque_ratio, speed_ratio: largest used share of a joint's torque and speed limit.
        sustained_speed_ratio: the same share for the mean speed over 10 ms.
        torque_peaks, speed_peaks: largest torque [Nm] and speed [rad/s] by joint group.
        saturated_s: time that the most saturated joint of each group was at its torque limit [s].
    """

    recovered: bool
    reason: str
    seconds: float
    foot_shift: float
    com_speed: float
    root_tilt: float
    ankle: bool
    hip: bool
    foot_tilt: bool
    steps: int
    quiet_drift: float
    quiet_power: float
    quiet_steps: float
    torque_ratio: float
    speed_ratio: float
    sustained_speed_ratio: float
    torque_peaks: tuple[float, ...]
    speed_peaks: tuple[float, ...]
    saturated_s: tuple[float, ...]

    def is_without_step(self, step_length: float) -> bool:
        """Whether it recovered while no foot came farther than a step's length [m] from its place."""
        return self.recovered and self.foot_shift <= step_length

    def is_within_limits(self, speed_share: float) -> bool:
        """Whether no joint's speed exceeded this share of its limit as a mean over 10 ms."""
        return self.sustained_speed_ratio <= speed_share


def joint_groups(robot: Robot) -> tuple[str, ...]:
    """Names of the joint groups in the order of their peaks: a joint's name without its side."""
    return tuple(dict.fromkeys(robot.joint_groups))


def group_columns(robot: Robot) -> list[list[int]]:
    """The joints of each joint group, as columns of arrays over the joints."""
    return [[i for i, group in enumerate(robot.joint_groups) if group == name] for name in joint_groups(robot)]
