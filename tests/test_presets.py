"""Presets: the paper's figures in `paper`, and every one of them as a file."""

import pytest

from surefoot.errors import UserError
from surefoot.learning.config import HALF_LIFE_GAMMA, PRESETS, TrainConfig, preset
from surefoot.task.environment import EnvConfig


def test_the_paper_preset_has_the_papers_hyperparameters() -> None:
    ppo, trpo = preset("paper", "ppo"), preset("paper", "trpo")
    for config in (ppo, trpo):
        assert config.num_envs * config.hyper["n_steps"] == 4096
        assert config.hyper["gamma"] == config.hyper["gae_lambda"] == HALF_LIFE_GAMMA == 0.95
        assert config.hyper["learning_rate"] == 3e-4
        assert config.hyper["batch_size"] == 256
        assert config.env == EnvConfig()
    assert ppo.hyper["clip_range"] == 0.2
    assert ppo.hyper["n_epochs"] == 10
    assert trpo.hyper["target_kl"] == 0.01
    assert trpo.hyper["cg_max_steps"] == 10
    # Section III-B: the discount halves a reward's weight after 0.5 s, 13 steps at 25 Hz, rounded to 0.95.
    assert pytest.approx(HALF_LIFE_GAMMA, abs=0.005) == 0.5 ** (1 / 13)


def test_unknown_names_are_named_with_the_valid_ones() -> None:
    with pytest.raises(UserError, match="unknown algorithm 'sac'; valid: trpo, ppo, ddpg"):
        preset("fast", "sac")
    with pytest.raises(UserError, match="unknown preset 'slow'; valid: paper, fast, wide, steady, complete"):
        preset("slow", "ppo")


@pytest.mark.parametrize(("name", "algorithm"), [(name, algorithm) for name in PRESETS for algorithm in PRESETS[name]])
def test_every_preset_survives_its_json(name: str, algorithm: str) -> None:
    config = preset(name, algorithm)
    assert TrainConfig.from_json(config.to_json()) == config
