"""Measure what a third teacher brings: third_teacher.py SPECIALIST TASK...

256 robots do what their teachers say; no student acts. Printed is the share that falls within 5.8 s of the start, for
`ppo` alone, for `ddpg` alone, for the specialist and `ppo`, and for these two with `ddpg` beyond what `ppo` survives
within the joints' speed limits and for robots that fall or rise faster than 2.4, 3.0 and 3.8 m/s.

push   a push of 240 to 450 Ns at the pelvis in a random direction
low    a drop of 0.5 to 1.3 m
high   a drop of 1.3 to 2.5 m
lift   500 Ns upwards, and a push of up to 120 Ns 0.24 s later
lean   a drop of 0.2 m, leaning by up to 17 degrees
"""

import sys

import numpy as np

from surefoot.agents.load import load_policy
from surefoot.learning.preset_file import preset
from surefoot.learning.teachers import Teacher, Teachers
from surefoot.task.environment import EnvConfig, PushRecoveryVectorEnv
from surefoot.task.random_pushes import DisturbanceConfig

NUM_ROBOTS, NUM_STEPS = 256, 145
HELD = [0.112, 0.131, 0.165, 0.181, 0.180, 0.172, 0.177, 0.147, 0.146, 0.147, 0.177, 0.172, 0.180, 0.181, 0.165, 0.131]
"""How far the specialist of the fourth day holds the capture point, in 16 directions [m]."""
FREE = {"interval": (30.0, 30.0)}
UNPUSHED = FREE | {"first": (30.0, 31.0)}
TASKS = {
    "push": ({}, FREE | {"impulse": (240.0, 450.0), "first": (0.6, 0.7)}),
    "low": ({"drop_height": (0.5, 1.3), "drop_share": 1.0}, UNPUSHED),
    "high": ({"drop_height": (1.3, 2.5), "drop_share": 1.0}, UNPUSHED),
    "lift": ({}, FREE | {"impulse": (6.0, 240.0), "first": (0.6, 0.7), "lift": (500.0, 500.0), "lift_share": 1.0}),
    "lean": ({"drop_height": (0.2, 0.2), "drop_share": 1.0, "drop_lean": 0.3}, UNPUSHED),
}


def third(speed):
    """Return `ddpg` with the borders of the preset, and for robots that fall or rise faster than this [m/s]."""
    beyond = preset("best/student", "trpo").hyper["teachers"][2]["beyond"]
    return Teacher(load_policy("ddpg"), beyond, falling=speed, rising=speed)


def fallen(task, teachers, action_scale=0.6):
    """Return the share of robots that fall."""
    settings, pushes = TASKS[task]
    pushes = DisturbanceConfig(**pushes)
    config = EnvConfig("valkyrie", "bent", action_scale=action_scale, episode_s=6.0, disturbance=pushes, **settings)
    env = PushRecoveryVectorEnv(NUM_ROBOTS, config)
    taught, stands = Teachers(teachers, env), np.ones(NUM_ROBOTS, bool)
    env.reset(seed=5)
    clear = env.loop.observe(slice(None), with_errors=False)
    taught.begin(clear)
    for _ in range(NUM_STEPS):
        actions, _ = taught.labels(clear, np.zeros((NUM_ROBOTS, env.robot.num_joints)), 0.0)
        _, _, terminated, truncated, _ = env.step(actions)
        stands &= ~terminated
        clear = env.loop.observe(slice(None), with_errors=False)
        taught.update(clear, terminated | truncated)
    return 1.0 - stands.mean()


if __name__ == "__main__":
    specialist, *tasks = sys.argv[1:]
    for task in tasks:
        alone = {name: [Teacher(load_policy(name)) for _ in range(2)] for name in ("ppo", "ddpg")}
        borders = {"root": [200.0], "torso": [42.0, 54.0, 66.0, 66.0, 42.0, 66.0, 66.0, 54.0]}
        two = [Teacher(load_policy(specialist)), Teacher(load_policy("ppo"), borders, capture_point=HELD)]
        print(f"{task}: ppo {fallen(task, alone['ppo']):.3f}", flush=True)
        print(f"{task}: ddpg {fallen(task, alone['ddpg'], 0.8):.3f}", flush=True)
        print(f"{task}: specialist, ppo {fallen(task, two):.3f}", flush=True)
        for speed in (2.4, 3.0, 3.8):
            print(
                f"{task}: specialist, ppo, ddpg from {speed} m/s {fallen(task, [*two, third(speed)]):.3f}", flush=True
            )
