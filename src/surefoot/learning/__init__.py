"""Learning: TRPO, PPO and DDPG from stable-baselines3 on the batched environment; needs torch."""

import os

# Physics and torch take turns on the same cores. A thread of torch's that spins while it waits would keep the
# physics, or another process, from its core; it has to be told before torch is loaded.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
