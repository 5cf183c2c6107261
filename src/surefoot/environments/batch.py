"""A batch of robots as gymnasium's vector environment: ``gymnasium.make_vec("surefoot/PushRecovery-v0", num_envs=8)``.

Learning uses the bare `PushRecoveryVectorEnv`. This one adds what others expect of gymnasium: all three autoreset
modes, and pictures.
"""

from __future__ import annotations

import dataclasses
from typing import Any, Literal

import numpy as np
from gymnasium.vector import AutoresetMode

from surefoot.errors import UserError
from surefoot.learning.robot_scale import default_config
from surefoot.physics.pushes import NEVER, Push
from surefoot.rates import CONTROL_DT
from surefoot.rendering.moment import Moment
from surefoot.task.environment import EnvConfig, PushRecoveryVectorEnv

RenderMode = Literal["rgb_array"]
RENDER_MODES = ("rgb_array",)


class PushRecoveryBatch(PushRecoveryVectorEnv):
    """N robots that are pushed and must not fall, see `PushRecoveryVectorEnv`.

    Args:
        num_envs: number of robots N.
        config: the task. The default is that of the preset `fast`.
        robot: a shipped robot's name or the path of a description, to which the default task is scaled. It cannot
            be given together with `config`, which names its robot.
        render_mode: "rgb_array" for pictures, None for none.
        autoreset_mode: when the next episode of a robot starts. NEXT_STEP: in the step after the end, whose action is
            ignored (most of gymnasium's wrappers need this). SAME_STEP: in the step of the end, whose last
            observation is `final_obs` of the info. DISABLED: when the caller resets it by
            ``reset(options={"reset_mask": ...})``, bool (N,); until then its reward is 0.
        width: width of each robot's picture [pixels].
        height: height of each robot's picture [pixels].
        num_threads: number of threads of the physics; 0 for one per core.

    Raises:
        UserError: there is no such robot, render mode or autoreset mode.
    """

    def __init__(
        self,
        num_envs: int = 1,
        config: EnvConfig | None = None,
        robot: str | None = None,
        render_mode: RenderMode | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        width: int = 640,
        height: int = 480,
        num_threads: int = 0,
    ):
        if render_mode not in (None, *RENDER_MODES):
            raise UserError(f"unknown render_mode '{render_mode}'; valid: None, {', '.join(RENDER_MODES)}")
        if config is not None and robot is not None:
            raise UserError(f"robot '{robot}' stands beside a config, which names its robot already: '{config.robot}'")
        super().__init__(num_envs, config or default_config(robot), num_threads)
        self.autoreset_mode = _checked_mode(autoreset_mode)
        self.metadata = self.metadata | {"render_modes": list(RENDER_MODES), "autoreset_mode": self.autoreset_mode}
        self.render_mode = render_mode
        self._picture_size = width, height
        self._renderer: Any = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start every robot anew, or those of `options["reset_mask"]`, bool (N,), alone.

        Raises:
            UserError: the mask has another shape or type.
        """
        mask = (options or {}).get("reset_mask")
        if mask is None:
            self._waiting[:] = False
            return super().reset(seed=seed, options=options)
        if np.shape(mask) != (self.num_envs,) or np.asarray(mask).dtype != bool:
            raise UserError(f"reset_mask must be bool of shape ({self.num_envs},), not {mask!r}")
        self._reset(np.flatnonzero(mask))
        self._waiting &= ~np.asarray(mask)
        return self.loop.observation.astype(np.float32), {}

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Advance every robot by one policy step of 40 ms."""
        waiting = self._waiting.copy()
        observations, rewards, terminated, truncated, info = super().step(actions)
        rewards = np.where(waiting, 0.0, rewards)
        if self.autoreset_mode == AutoresetMode.NEXT_STEP and waiting.any():
            ids = np.flatnonzero(waiting)
            self._reset(ids)
            observations[ids] = self.loop.observe(ids)
            self._waiting[ids] = False
        return observations, rewards, terminated, truncated, info if self._is_same_step else {}

    def render(self) -> tuple[np.ndarray, ...] | None:
        """Draw every robot with its push, CoM, capture point and foot forces.

        Returns:
            A picture of each, uint8 (height, width, 3); None without a render mode.

        Raises:
            UserError: there is no OpenGL to draw with.
        """
        if self.render_mode is None:
            return None
        if self._renderer is None:
            from surefoot.rendering.renderer import Renderer

            self._renderer = Renderer(self.robot, *self._picture_size)
        return tuple(self._draw(i) for i in range(self.num_envs))

    def close_extras(self, **kwargs: Any) -> None:
        """Free the OpenGL context of the pictures."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    @property
    def _is_same_step(self) -> bool:
        return self.autoreset_mode == AutoresetMode.SAME_STEP

    def _after_end(self, ids: np.ndarray, observations: np.ndarray) -> None:
        if self._is_same_step:
            super()._after_end(ids, observations)
        else:
            self._waiting[ids] = True

    def _draw(self, robot: int) -> np.ndarray:
        push, since = self._latest_push(robot)
        moment = dataclasses.replace(Moment.of(self.loop.engine.read(np.array([robot]))), time=since)
        picture: np.ndarray = self._renderer.draw(moment, push)
        return picture

    def _latest_push(self, robot: int) -> tuple[Push | None, float]:
        """Return the push of a robot that began last, and the time since then [s]."""
        pushes, tick = self.loop.pushes, self.loop.tick[robot]
        begun = np.flatnonzero((pushes.start[robot] <= tick) & (pushes.start[robot] != NEVER))
        if not len(begun):
            return None, 0.0
        slot = begun[np.argmax(pushes.start[robot, begun])]
        force, size = pushes.force[robot, slot], float(np.linalg.norm(pushes.force[robot, slot]))
        duration = float(pushes.end[robot, slot] - pushes.start[robot, slot]) * CONTROL_DT
        name = self.robot.body_names[pushes.body[robot, slot]]
        body = next(word for word, pushed in self.robot.pushable.items() if pushed == name)
        x, y, z = (force / max(size, 1e-9)).tolist()
        return Push(body, (x, y, z), size * duration, 0.0, duration), float(
            tick - pushes.start[robot, slot]
        ) * CONTROL_DT


def _checked_mode(mode: AutoresetMode | str) -> AutoresetMode:
    """Return an autoreset mode by itself, its name or its value."""
    modes = {name: each for each in AutoresetMode for name in (each.name, each.value)}
    found = mode if isinstance(mode, AutoresetMode) else modes.get(mode)
    if found is None:
        raise UserError(f"unknown autoreset_mode '{mode}'; valid: {', '.join(each.name for each in AutoresetMode)}")
    return found
