"""Curriculum stages: one command learns all of them, skips what is done, and each begins with the one before."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest
from conftest import tiny

from surefoot.agents.load import load_policy
from surefoot.cli.train import Train
from surefoot.errors import UserError
from surefoot.learning import preset_file
from surefoot.learning.config import TrainConfig
from surefoot.learning.run_folder import RunFolder
from surefoot.learning.selection import files
from surefoot.learning.stages import begin_stages, has_stages, read_stages, run_folders

pytestmark = pytest.mark.slow


@pytest.fixture
def small_presets(monkeypatch: pytest.MonkeyPatch) -> None:
    """All presets with few robots and small batches, but their own pushes and penalties."""
    read = preset_file.preset

    def small(name: str, algorithm: str) -> TrainConfig:
        config, few = read(name, algorithm), tiny(algorithm)
        hyper = {key: few.hyper.get(key, value) for key, value in config.hyper.items()}
        return dataclasses.replace(config, num_envs=8, hyper=hyper, minutes=5.0)

    monkeypatch.setattr(preset_file, "preset", small)


@pytest.mark.usefixtures("small_presets")
def test_one_command_learns_all_stages_and_goes_on_where_it_was(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = tmp_path / "run"
    command = Train(algorithm="ppo", preset="complete", run=run, steps=100)
    dataclasses.replace(command, stage="pushes").main()
    assert not (run / "standing").exists()
    command.main()
    said = capsys.readouterr().err
    assert "stage pushes: done before" in said.replace("\n", " ")
    # 13 policy steps of 8 robots are the first that use up a budget of 100.
    records = [load_policy(run / stage).contract.training for stage in ("pushes", "standing", "harder-pushes")]
    assert [record["policy_steps"] for record in records] == [104, 208, 312]
    assert [record["preset"] for record in records] == [f"complete/{stage.name}" for stage in read_stages(run)]
    assert records[2]["after"]["preset"] == "complete/standing"
    assert records[2]["after"]["after"]["preset"] == "complete/pushes"
    # The same again does nothing; a larger budget goes on with every stage.
    Train(resume=run).main()
    assert load_policy(run / "harder-pushes").contract.training["policy_steps"] == 312
    Train(resume=run, steps=180).main()
    assert RunFolder(run / "pushes").curve()[-1]["steps"] == 184
    # Six policies compete to be the best of the run.
    assert len(files([run])) == 6
    assert run_folders(tmp_path / "other") == [tmp_path / "other"]


@pytest.mark.usefixtures("small_presets")
def test_a_stage_that_was_cut_short_is_resumed(tmp_path: Path) -> None:
    run = tmp_path / "run"
    command = Train(algorithm="ppo", preset="complete", run=run, steps=60, stage="pushes")
    command.main()
    stage = dataclasses.replace(read_stages(run)[0], config=dataclasses.replace(read_stages(run)[0].config, steps=300))
    assert read_stages(run)[0].is_done
    assert not stage.is_done
    stage.run()
    assert stage.is_done
    assert [row["steps"] for row in RunFolder(stage.folder).curve()] == [64, 304]


@pytest.mark.usefixtures("small_presets")
def test_a_stage_killed_before_its_first_checkpoint_begins_anew(tmp_path: Path) -> None:
    command = Train(algorithm="ppo", preset="complete", run=tmp_path / "run", steps=60, stage="pushes")
    (tmp_path / "run" / "pushes").mkdir(parents=True)
    begin_stages(tmp_path / "other", {"pushes": tiny("ppo")})
    (tmp_path / "run" / "stages.json").write_text((tmp_path / "other" / "stages.json").read_text())
    (tmp_path / "run" / "pushes" / "config.json").write_text("{}")
    (stage,) = read_stages(tmp_path / "run")
    dataclasses.replace(stage, config=dataclasses.replace(stage.config, steps=60)).run()
    assert stage.folder.joinpath("last.onnx").exists()
    with pytest.raises(UserError, match=r"was begun with other settings; go on with --resume"):
        command.main()


def test_a_stage_before_which_nothing_was_learned_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"the stage before has not been learned: .*pushes has no checkpoint"):
        Train(preset="complete", stage="standing", run=tmp_path / "run").main()
    with pytest.raises(UserError, match="unknown stage 'flying' of complete for ddpg; valid: pushes, standing, every"):
        Train(preset="complete", stage="flying", run=tmp_path / "run").main()
    with pytest.raises(UserError, match="unknown stage 'pushes' of fast for ddpg; valid: none"):
        Train(preset="fast", stage="pushes", run=tmp_path / "run").main()
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "thesis.tex").write_text("years of work")
    with pytest.raises(UserError, match="exists already and holds no stages; give another --run"):
        Train(preset="complete", run=tmp_path / "thesis").main()


@pytest.mark.usefixtures("small_presets")
def test_the_words_of_version_0_1_still_work_and_name_the_new_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    few = {"algorithm": "ppo", "steps": 60}
    Train(preset="wide", **few).main()
    Train(preset="steady", run=tmp_path / "steady", **few).main()
    Train(preset="complete", warm_start=tmp_path / "steady", run=tmp_path / "complete", **few).main()
    said = capsys.readouterr().err
    assert "--preset wide is now called --preset complete --stage pushes" in said
    assert "--preset steady is now called --preset complete --stage standing" in said
    assert not has_stages(tmp_path / "complete")
    assert RunFolder(tmp_path / "runs" / "wide-ppo-0").config().env.drop_share == 0.1
    record = load_policy(tmp_path / "complete").contract.training
    assert record["preset"] == "complete/harder-pushes"
    assert record["after"]["preset"] == "complete/standing"
    # In the new words, and in the folder of its own that it has by default.
    Train(preset="complete", stage="harder-pushes", warm_start=tmp_path / "steady", **few).main()
    assert (tmp_path / "runs" / "complete-harder-pushes-ppo-0" / "best.onnx").exists()
