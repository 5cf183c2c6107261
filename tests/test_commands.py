"""Commands that show robots: films, pictures and clips as files that can be read back; and the page as a process."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import imageio.v3 as imageio
import imageio_ffmpeg
import numpy as np
import pytest
from page_client import PageClient, until
from PIL import Image

from surefoot.agents.load import usual_robot
from surefoot.agents.nominal import NominalAgent
from surefoot.cli.shown_trial import push_trial, scenario_trial
from surefoot.cli.video import Picture, Video
from surefoot.errors import UserError
from surefoot.evaluation.scenarios import Scenario
from surefoot.physics.pushes import Drop, horizontal_push
from surefoot.rendering.film import draw_moment
from surefoot.rendering.opengl import gl_backend
from surefoot.rendering.recording import record
from surefoot.rendering.renderer import Renderer
from surefoot.rendering.words import trial_words
from surefoot.robots import load_robot
from surefoot.viewer.clip import SIZE, ClipRecorder, save_clip
from surefoot.viewer.session import Session

pytestmark = pytest.mark.slow

VALKYRIE = load_robot("valkyrie")


@pytest.fixture(scope="module")
def needs_opengl() -> None:
    try:
        gl_backend()
    except UserError as error:
        pytest.skip(str(error))


def test_a_film_shows_the_push_that_was_asked_for(needs_opengl, tmp_path):
    film = tmp_path / "push.gif"
    Video("nominal", out=film, impulse=240.0, begin=0.0, end=0.2, fps=10.0, size=(160, 120)).main()
    frames = imageio.imread(film)
    assert frames.shape[1:] == (120, 160, 3)
    orange = ((frames >= (200, 50, 0)) & (frames <= (255, 140, 60))).all(axis=-1)
    assert orange[0].sum() > 20, "the arrow"


def test_a_picture_has_a_row_for_each_impulse_and_a_column_for_each_time(needs_opengl, tmp_path):
    strip, single = tmp_path / "strip.png", tmp_path / "single.png"
    Picture("nominal", out=strip, impulse=(24.0, 240.0), times=(0.1, 0.3, 0.6), size=(80, 100)).main()
    with Image.open(strip) as picture:
        assert picture.size == (260 + 3 * 84, 2 * 104 + 48)
    Picture("nominal", out=single, impulse=(60.0,), times=(0.1,), size=(80, 100)).main()
    with Image.open(single) as picture:
        assert picture.size == (80, 100)


@pytest.mark.parametrize(
    ("words", "direction"),
    [("forward", (1, 0, 0)), ("left", (0, 1, 0)), ("backward", (-1, 0, 0)), ("right", (0, -1, 0)), ("90", (0, 1, 0))],
)
def test_directions_are_words_or_degrees_to_the_left(words, direction):
    assert push_trial(VALKYRIE, "torso", words, 60.0, 0.12, 0).push.direction == pytest.approx(direction, abs=1e-12)


def test_a_scenario_is_shown_as_it_is_tested():
    line = {
        line.name: line
        for line in Scenario(
            "combined", preceding_impulse=500.0, preceding_upward=True, push_interval=(0.24, 0.24)
        ).lines()
    }
    assert scenario_trial(VALKYRIE, "combined", "left", 72.0, 3) == line["left"].trial(12, 3, full_length=True)
    assert scenario_trial(VALKYRIE, "drop_055", "forward", 120.0, 1).drop == Drop(0.55)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("flight", "forward", 6.0, 0), "unknown scenario 'flight'; valid: root_push, "),
        (("combined", "up", 6.0, 0), "combined has no direction 'up'; valid: forward, left, backward, right"),
        (("combined", "left", 7.0, 0), "combined has no size 7; valid: multiples of 6 up to 900 Ns"),
        (("combined", "left", float("nan"), 0), "combined has no size nan"),
        (("combined", "left", 6.0, -1), "seed must be a whole number from 0 to 4294967295, not -1"),
        (("drop_055", "forward", 6.0, 8), "seed of drop_055 must be 0 to 7, not 8"),
        (("no.toml:mine", "forward", 6.0, 0), "unknown suite 'no.toml'"),
    ],
)
def test_a_trial_that_is_not_there_is_refused(arguments, message):
    with pytest.raises(UserError, match=message):
        scenario_trial(VALKYRIE, *arguments)


def test_trials_are_told_in_words():
    assert trial_words(scenario_trial(VALKYRIE, "combined", "left", 72.0, 0)) == "500 Ns up, then 72 Ns left"
    assert trial_words(scenario_trial(VALKYRIE, "landing_tilt", "left", 5.0, 0)) == "drop from 0.4 m, leaning"
    assert trial_words(scenario_trial(VALKYRIE, "standing", "forward", 6.0, 0)) == "no push"


def test_the_push_in_the_air_is_drawn_when_it_comes(needs_opengl):
    trial = scenario_trial(VALKYRIE, "combined", "forward", 300.0, 0)
    recording = record(NominalAgent(usual_robot()), trial)
    with Renderer(recording.robot, 320, 240) as canvas:
        lift, push = (draw_moment(canvas, trial, recording.at(time)) for time in (0.1, 0.3))
    orange = [((p >= (200, 50, 0)) & (p <= (255, 140, 60))).all(axis=-1) for p in (lift, push)]
    rows, columns = zip(*(np.ptp(np.argwhere(o), axis=0) for o in orange), strict=True)
    assert rows[0] > columns[0], "upwards"
    assert columns[1] > rows[1], "forwards"


def test_a_clip_replays_what_was_played_with_its_push(needs_opengl, tmp_path):
    session, recorder = Session(NominalAgent(usual_robot()), 1), ClipRecorder()
    session.push(horizontal_push("root", 0.0, 120.0))
    for _ in range(4):
        session.step()
        recorder.add(session, 0)
    pushes = [shot.push.impulse if shot.push else 0.0 for shot in recorder.shots()]
    assert pushes == pytest.approx([40.0] * 4), "1000 N in each policy step"
    save_clip(tmp_path / "clip.mp4", session.robot, recorder.shots())
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-i", tmp_path / "clip.mp4", "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    shown = subprocess.run(command, capture_output=True, check=True).stdout
    frames = np.frombuffer(shown, np.uint8).reshape(-1, SIZE[1], SIZE[0], 3)
    assert len(frames) == 4
    orange = ((frames >= (190, 40, 0)) & (frames <= (255, 150, 80))).all(axis=-1)
    assert (orange.sum(axis=(1, 2)) > 200).all(), "the arrow"


def test_an_empty_clip_is_refused(robot, tmp_path):
    with pytest.raises(UserError, match="nothing has been recorded yet"):
        save_clip(tmp_path / "clip.mp4", robot, ())


def films_of(process: int) -> list[str]:
    """Processes that draw a film for another one."""
    return subprocess.run(["pgrep", "-P", str(process)], capture_output=True, text=True).stdout.split()


def test_play_says_where_it_is_and_ends_by_ctrl_c(tmp_path: Path):
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [sys.executable, "-m", "surefoot", "play", "nominal", "--port", str(port)]
    (tmp_path / "browser").write_text(f"#!/bin/sh\necho $1 > {tmp_path}/opened\n")
    (tmp_path / "browser").chmod(0o755)
    with_screen = os.environ | {"DISPLAY": ":0", "BROWSER": f"{tmp_path}/browser %s"}
    # A shell without job control has its background jobs ignore Ctrl-C, and their children inherit that.
    with subprocess.Popen(
        command,
        cwd=tmp_path,
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=with_screen,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:
        try:
            assert process.stderr
            said = process.stderr.readline()
            assert re.fullmatch(rf"push it at http://127.0.0.1:{port}/\?token=[\w-]{{24}} \(Ctrl-C ends\)\n", said)
            for _ in range(100):
                if (tmp_path / "opened").exists():
                    break
                time.sleep(0.05)
            assert (tmp_path / "opened").read_text().strip() in said, "the browser opens the address that was printed"
            second = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60)
            assert second.returncode == 2
            assert f"surefoot: cannot listen on 127.0.0.1:{port}: address already in use; valid:" in second.stderr
            with PageClient(said.split()[3]) as viewer:
                while not (save := [label for label in viewer.controls if label.startswith("Save the last")]):
                    viewer.listen(30.0)
                assert all(viewer.skip(30.0) for _ in range(20)), "it plays, so that there is something to draw"
                viewer.set(save[0], True)
                assert until(lambda: bool(films_of(process.pid)))
                (film,) = films_of(process.pid)
                process.send_signal(signal.SIGINT)
                output, error = process.communicate(timeout=20)
            assert (process.returncode, output, error) == (0, "", "closed\n"), "though a film was being drawn"
            assert until(lambda: not Path(f"/proc/{film}").exists()), "and what drew it has ended"
        finally:
            process.kill()


def test_pictures_have_all_colours_of_the_robot(needs_opengl, tmp_path):
    Picture("nominal", out=tmp_path / "robot.png", impulse=(30.0,), times=(0.5,), size=(300, 400)).main()
    picture = np.asarray(Image.open(tmp_path / "robot.png").convert("RGB"), int)
    assert (picture.min(axis=-1) > 190).sum() > 500, "white shell"
    assert (picture.max(axis=-1) < 60).sum() > 300, "dark joints and visor"
