"""What a training run logs: every figure that is promised, in TensorBoard and in Weights & Biases."""

from __future__ import annotations

import dataclasses
import io
from pathlib import Path

import pytest
from conftest import tiny
from PIL import Image
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from surefoot.agents.load import load_policy
from surefoot.errors import UserError
from surefoot.learning import budget, validation
from surefoot.learning import train as training
from surefoot.learning.training_log import Film, LogConfig, hyperparameters
from surefoot.rendering.training_film import SIZE, film_of

pytestmark = pytest.mark.slow

FIGURES = (
    "rollout/episode_return", "rollout/episode_length", "time/steps_per_s", "validation/recovered", "validation/calm",
    "rejected_Ns/forward", "rejected_Ns/45", "rejected_Ns/left", "rejected_Ns/135", "rejected_Ns/backward",
    "rejected_Ns/225", "rejected_Ns/right", "rejected_Ns/315", "reward/com_height", "train/actor_loss",
    "train/critic_loss",
)  # fmt: skip


def small_film(policy: object) -> Film:
    """A film that is quickly drawn: one grey picture."""
    buffer = io.BytesIO()
    Image.new("RGB", (8, 6), "grey").save(buffer, "GIF")
    return Film(buffer.getvalue(), 8, 6)


@pytest.fixture
def often(monkeypatch: pytest.MonkeyPatch) -> None:
    """Something is logged before every rollout, and every 256 steps are validated, by few pushes."""
    monkeypatch.setattr(training, "LOG_S", 0.0)
    monkeypatch.setattr(budget, "MIN_VALIDATION_STEPS", 256)
    monkeypatch.setattr(validation, "NUM_IMPULSES", 1)


def learn(folder: Path, log: LogConfig) -> None:
    training.train(dataclasses.replace(tiny("ddpg"), steps=400), folder, log=log)


def test_tensorboard_has_every_figure_the_hyperparameters_and_a_film(often: None, tmp_path: Path) -> None:
    learn(tmp_path / "run", LogConfig(film=small_film))
    events = EventAccumulator(str(tmp_path / "run"))
    events.Reload()
    tags = events.Tags()
    assert set(FIGURES) <= set(tags["scalars"])
    assert events.Scalars("rejected_Ns/forward")[-1].value % 36.0 == 0.0
    assert "_hparams_/session_start_info" in events.summary_metadata
    (film,) = [events.Images(tag)[0] for tag in tags["images"]]
    assert Image.open(io.BytesIO(film.encoded_image_string)).size == (8, 6)


def test_weights_and_biases_keeps_a_run_offline(often: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("wandb")
    monkeypatch.setenv("WANDB_MODE", "offline")
    monkeypatch.setenv("WANDB_SILENT", "true")
    learn(tmp_path / "run", LogConfig("wandb", small_film))
    (file,) = (tmp_path / "run").glob("wandb/offline-run-*/*.wandb")
    content = file.read_bytes()
    assert all(
        figure.encode() in content for figure in ("validation/recovered", "rejected_Ns/135", "hyper.gamma", "film")
    )


def test_hyperparameters_are_named_as_the_options_that_set_them() -> None:
    found = hyperparameters(tiny("ddpg"))
    assert (found["hyper.batch_size"], found["num_envs"], found["env.disturbance.duration"]) == (32, 8, 0.12)
    assert found["env.disturbance.impulse"] == "(30.0, 300.0)"


def test_the_film_of_a_policy_moves() -> None:
    try:
        film = film_of(load_policy("ppo"))
    except UserError as error:
        pytest.skip(str(error))
    with Image.open(io.BytesIO(film.data)) as gif:
        assert gif.size == (film.width, film.height) == SIZE
        assert gif.n_frames > 40
