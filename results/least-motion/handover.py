"""Measure what handing over from a specialist to `ppo` costs: handover.py SPECIALIST LOW HIGH VARIANT...

512 robots stand for a second and get one push of LOW to HIGH Ns at the pelvis in a random direction; no student acts,
but the teachers themselves. Printed are the shares that fall and that step within 4.8 s of their start. How far the
specialist holds the capture point is measured first.

ppo         `ppo` does everything
reach=S     `ppo` takes over where the capture point is beyond S times what the specialist holds
soon=M      as reach=1, or where it would be M metres beyond at the next policy step
rest=R      as soon=0.05, and `ppo` also acts while the capture point is within R metres of its place
"""

import sys

import numpy as np

from surefoot.agents.load import load_policy
from surefoot.learning import teachers
from surefoot.learning.capture_points import from_feet, held_capture_points
from surefoot.learning.teachers import STEPPED_SHIFT, Teacher, Teachers
from surefoot.task.environment import EnvConfig, PushRecoveryVectorEnv
from surefoot.task.random_pushes import DisturbanceConfig

NUM_ROBOTS = 512


def task(low, high):
    """Return the robots' task: one push of low to high Ns."""
    pushes = DisturbanceConfig(impulse=(low, high), first=(1.0, 1.1), interval=(30.0, 30.0))
    return EnvConfig("valkyrie", "bent", action_scale=0.6, episode_s=5.0, disturbance=pushes)


def shares(specialist, held, config, kind, value):
    """Return the shares of robots that fall and that step."""
    env = PushRecoveryVectorEnv(NUM_ROBOTS, config)
    first, second = load_policy("ppo" if kind == "ppo" else specialist), load_policy("ppo")
    teachers.FAR = {"soon": value, "rest": 0.05}.get(kind, 10.0)
    reach = np.array(held) * (value if kind == "reach" else 1.0)
    taught = Teachers([Teacher(first), Teacher(second, {"root": [200.0]}, capture_point=list(reach))], env)
    env.reset(seed=5)
    clear = env.loop.observe(slice(None), with_errors=False)
    taught.begin(clear)
    home = np.median(from_feet(env.robot, clear), axis=0)
    stands, shift = np.ones(NUM_ROBOTS, bool), np.zeros(NUM_ROBOTS)
    for step in range(120):
        actions, _ = taught.labels(clear, np.zeros((NUM_ROBOTS, env.robot.num_joints)), 0.0)
        if kind == "rest" and step > 2:
            away = np.linalg.norm(from_feet(env.robot, clear) - home, axis=1)
            rows = np.flatnonzero((taught.level == 0) & (away < value))
            actions[rows] = taught._ask(1, clear, rows)
        _, _, terminated, truncated, _ = env.step(actions)
        stands &= ~terminated
        clear = env.loop.observe(slice(None), with_errors=False)
        taught.update(clear, terminated | truncated)
        feet = np.abs(taught._feet(clear) - taught._home).max(axis=1)
        shift = np.where(stands, np.maximum(shift, feet), 1.0)
    return 1.0 - stands.mean(), (shift > STEPPED_SHIFT).mean()


if __name__ == "__main__":
    specialist, low, high, *variants = sys.argv[1:]
    config = task(float(low), float(high))
    held = held_capture_points(load_policy(specialist), config)
    for variant in variants:
        kind, _, value = variant.partition("=")
        fell, stepped = shares(specialist, held, config, kind, float(value or 0.0))
        print(f"{variant}, {low} to {high} Ns: {fell:.3f} fall, {stepped:.3f} step or fall", flush=True)
