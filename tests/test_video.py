"""Video: what is recorded is the trial that was judged, and what is drawn is what was recorded."""

from __future__ import annotations

import subprocess
from dataclasses import replace

import imageio_ffmpeg
import mujoco
import numpy as np
import pytest
from PIL import Image

from surefoot.agents.load import usual_robot
from surefoot.agents.nominal import NominalAgent
from surefoot.errors import UserError
from surefoot.evaluation.trials import Trial, run_list
from surefoot.physics.pushes import Push
from surefoot.rendering.film import frames, save_video
from surefoot.rendering.image_files import save_picture
from surefoot.rendering.moment import Moment
from surefoot.rendering.opengl import gl_backend
from surefoot.rendering.recording import Recording, record
from surefoot.rendering.renderer import Renderer
from surefoot.rendering.strip import filmstrip
from surefoot.rendering.words import push_words

pytestmark = pytest.mark.slow

FALL = Trial(Push(impulse=240.0), seed=3)
STAY = Trial(Push(impulse=24.0), seed=3, full_length=False)


@pytest.fixture(scope="module")
def fall() -> Recording:
    """The nominal pose does not survive 240 Ns."""
    return record(NominalAgent(usual_robot()), FALL)


@pytest.fixture(scope="module")
def stay() -> Recording:
    """The nominal pose survives 24 Ns."""
    return record(NominalAgent(usual_robot()), STAY)


@pytest.fixture(scope="module")
def needs_opengl() -> None:
    try:
        gl_backend()
    except UserError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def scene(needs_opengl, robot):
    with Renderer(robot, 320, 240) as scene:
        yield scene


def pixels_like(picture: np.ndarray, red: tuple[int, int], green: tuple[int, int], blue: tuple[int, int]) -> np.ndarray:
    """Where all channels are within their ranges: (num_pixels, 2) column, row."""
    ranges = np.array([red, green, blue])
    return np.argwhere(((picture >= ranges[:, 0]) & (picture <= ranges[:, 1])).all(axis=2))[:, ::-1]


def orange(picture: np.ndarray) -> np.ndarray:
    return pixels_like(picture, (200, 255), (50, 140), (0, 60))


# Recording.


@pytest.mark.parametrize("name", ["fall", "stay"])
def test_the_recorded_trial_has_the_outcome_of_the_evaluated_one(name, request):
    recording = request.getfixturevalue(name)
    assert recording.outcome == run_list(NominalAgent(usual_robot()), [recording.trial], num_slots=1)[recording.trial]
    assert recording.outcome.recovered == (name == "stay")


def test_recorded_positions_put_the_models_com_and_feet_where_they_were(fall):
    model = fall.robot.model()
    data = mujoco.MjData(model)
    for moment in fall.moments[::7]:
        data.qpos = moment.qpos
        mujoco.mj_forward(model, data)
        assert data.subtree_com[1] == pytest.approx(moment.com_position, abs=1e-9)
    standing = fall.at(-0.1)
    # At rest the feet carry the weight, under the CoM: sum of force * point = weight * CoM.
    assert standing.foot_force.sum() == pytest.approx(fall.robot.weight, rel=0.01)
    pressure = standing.foot_force @ standing.foot_pressure_point[:, :2] / standing.foot_force.sum()
    assert pressure == pytest.approx(standing.com_position[:2], abs=0.01)


def test_time_zero_is_the_beginning_of_the_push(fall, stay):
    # Two pushes of different size after the same start: alike up to time 0 and at no time after.
    for time in fall.times[fall.times <= 0.0]:
        assert (fall.at(time).qpos == stay.at(time).qpos).all()
    for time in fall.times[fall.times > 0.004]:
        assert (fall.at(time).qpos != stay.at(time).qpos).any()


def test_a_recording_reaches_from_the_settling_time_to_the_verdict(fall):
    assert np.diff(fall.times) == pytest.approx(1 / 50)
    assert -1.04 < fall.times[0] <= -1.0
    assert 0.0 <= fall.outcome.seconds - fall.times[-1] <= 1 / 50 + 0.002


def test_the_capture_point_leaves_the_support_when_the_robot_falls_and_stays_otherwise(fall, stay):
    assert all(moment.is_captured for moment in stay.moments[25:])
    assert fall.at(-0.02).is_captured
    assert not fall.at(0.3).is_captured


def test_a_capture_point_is_within_a_square_up_to_its_border(fall):
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    moment = replace(fall.moments[0], support_polygon=square)
    inside = {point: replace(moment, capture_point=np.array(point)).is_captured for point in [(0.5, 0.9), (0.5, 1.1)]}
    assert inside == {(0.5, 0.9): True, (0.5, 1.1): False}
    assert not replace(moment, support_polygon=np.zeros((0, 2))).is_captured


def test_frames_that_do_not_divide_the_ticks_are_refused():
    with pytest.raises(UserError, match="cannot record 30 frames per second; valid: 1, 2, 4, 5, 10, 20, 25, 50, 100"):
        record(NominalAgent(usual_robot()), FALL, fps=30)


@pytest.mark.parametrize(
    ("push", "words"),
    [
        (Push(impulse=240.0), "240 Ns forward"),
        (Push(impulse=78.0, direction=(0, 1, 0)), "78 Ns left"),
        (Push(impulse=78.5, direction=(0, -1, 0)), "78.5 Ns right"),
        (Push(impulse=60.0, direction=(-1, 1e-17, 0)), "60 Ns backward"),
        (Push(impulse=60.0, direction=(np.sqrt(0.5), -np.sqrt(0.5), 0)), "60 Ns forward right"),
        (Push(impulse=60.0, direction=(np.cos(np.pi / 6), 0.5, 0)), "60 Ns at 30°"),
        (Push(impulse=500.0, direction=(0, 0, 1)), "500 Ns up"),
        (Push(impulse=108.0, body="left_shank"), "108 Ns forward at the left shank"),
    ],
)
def test_a_push_is_put_into_words(push, words):
    assert push_words(push) == words


# Drawing.


def test_the_push_is_an_arrow_from_its_beginning_until_a_little_after_its_end(scene, fall):
    drawn = {t: len(orange(scene.draw(fall.at(t), FALL.push))) > 100 for t in (-0.1, 0.02, 0.3, 0.5)}
    assert drawn == {-0.1: False, 0.02: True, 0.3: True, 0.5: False}
    no_push = scene.draw(fall.at(0.02), Push(impulse=0.0))
    assert (no_push == scene.draw(fall.at(0.02))).all()


def test_the_arrow_is_as_long_as_the_force_and_points_at_the_body(scene, stay):
    moment = replace(stay.at(-0.1), time=0.0)
    # The arrow is 0.36 m/kN * 240 Ns / 0.12 s = 0.72 m long and ends 0.13 m behind the root, which is at the middle
    # of the picture: from 0.85 to 0.13 m. At 3.1 m a metre is 240 / (2 * 3.1 * tan(45 deg / 2)) = 93.5 pixels, and
    # the view is 22 deg off square, so that what lies behind is farther: in pixels from the middle,
    # 93.5 * 0.85 * cos(22 deg) / (1 + 0.85 * sin(22 deg) / 3.1) = 66.8 and, in the same way, 11.1.
    columns = orange(scene.draw(moment, Push(impulse=240.0)))[:, 0]
    assert 160 - columns.min() == pytest.approx(66.8, abs=2.0)
    assert 160 - columns.max() == pytest.approx(11.1, abs=2.0)
    half = orange(scene.draw(moment, Push(impulse=120.0)))[:, 0]
    assert np.ptp(half) == pytest.approx(0.5 * np.ptp(columns), abs=2.0)


def test_a_push_from_the_side_is_seen_from_the_front(scene, stay):
    moment = replace(stay.at(-0.1), time=0.0)
    columns = orange(scene.draw(moment, Push(impulse=240.0, direction=(0.0, 1.0, 0.0))))[:, 0]
    # The robot's left is at the right: the arrow comes from the left of the picture.
    assert np.ptp(columns) > 50
    assert columns.max() < 160


def test_the_capture_point_is_green_within_the_support_and_red_outside(scene, fall):
    def colours(moment: Moment) -> tuple[bool, bool]:
        picture = scene.draw(moment)
        green = pixels_like(picture, (0, 110), (180, 255), (50, 150))
        red = pixels_like(picture, (190, 255), (0, 60), (0, 80))
        return len(green) > 5, len(red) > 5

    assert colours(fall.at(-0.1)) == (True, False)
    assert colours(fall.at(0.4)) == (False, True)


def test_the_camera_follows_the_robot(scene, stay):
    moment = stay.at(-0.1)
    far = np.array([40.0, -3.0, 0.0])
    moved = replace(
        moment,
        qpos=moment.qpos + np.concatenate([far, np.zeros(len(moment.qpos) - 3)]),
        com_position=moment.com_position + far,
        capture_point=moment.capture_point + far[:2],
        support_polygon=moment.support_polygon + far[:2],
        foot_pressure_point=moment.foot_pressure_point + far,
    )
    here, there = (scene.draw(m).astype(int) for m in (moment, moved))
    assert (np.abs(here - there).max(axis=2) > 40).mean() < 0.02


def test_a_picture_depends_on_neither_the_last_one_nor_another_scene(scene, robot, stay):
    before = scene.draw(stay.moments[0])
    scene.draw(stay.moments[0], Push(direction=(0.0, 1.0, 0.0)))
    with Renderer(robot, 160, 120) as other:
        assert other.draw(stay.moments[0]).shape == (120, 160, 3)
        assert (scene.draw(stay.moments[0]) == before).all()
    assert (scene.draw(stay.moments[0]) == before).all()


def test_a_size_beyond_the_buffer_is_refused(robot):
    with pytest.raises(UserError, match="cannot draw 4000 x 300 pixels; valid: up to 1920 x 1080"):
        Renderer(robot, 4000, 300)


# Strips and films.


def test_a_strip_shows_a_fall_once_and_then_nothing(needs_opengl, fall, stay):
    strip = filmstrip([fall, stay], times=[0.1, 3.0, 4.0], cell=(120, 150))
    assert strip.shape == (2 * 154 + 48, 260 + 3 * 124, 3)
    cells = [[strip[r * 154 : r * 154 + 150, 260 + c * 124 : 380 + c * 124] for c in range(3)] for r in range(2)]
    is_blank = [[bool((cell == 255).all()) for cell in row] for row in cells]
    # The fall ends before 3 s; the other trial ends as recovered after 2 s of quiet.
    assert is_blank == [[False, False, True], [False, False, True]]
    captions = [strip[r * 154 : r * 154 + 150, :200] for r in range(2)]
    assert len(pixels_like(captions[0], (170, 210), (30, 70), (30, 70))) > 20, "a fall is written in red"
    assert len(pixels_like(captions[1], (20, 60), (110, 140), (50, 90))) > 20, "a recovery is written in green"


def test_a_strip_of_nothing_is_refused(fall):
    with pytest.raises(UserError, match="a strip needs recordings and times, not 1 and 0 of them"):
        filmstrip([fall], times=[])


def test_a_film_runs_in_real_time_and_rests_on_its_last_picture(needs_opengl, fall):
    pictures = list(frames(fall, fps=10, size=(160, 120), begin=0.0))
    moving = int(fall.times[-1] * 10) + 1
    assert len(pictures) == moving + 8
    assert all((a != b).any() for a, b in zip(pictures[: moving - 1], pictures[1:moving], strict=True))
    assert all((picture == pictures[-1]).all() for picture in pictures[moving:])


def test_half_speed_takes_twice_the_frames(needs_opengl, fall):
    count = {speed: len(list(frames(fall, 10, (64, 48), 0.0, 0.5, speed))) - 8 for speed in (1.0, 0.5)}
    assert count == {1.0: 6, 0.5: 11}


def test_an_mp4_can_be_read_back_as_it_was_drawn(needs_opengl, fall, tmp_path):
    save_video(tmp_path / "fall.mp4", fall, fps=10, size=(160, 120), begin=0.0, end=0.3)
    drawn = list(frames(fall, 10, (160, 120), 0.0, 0.3))
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-i", tmp_path / "fall.mp4", "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    read = subprocess.run(command, capture_output=True, check=True)
    assert b" 10 fps" in read.stderr
    shown = np.frombuffer(read.stdout, np.uint8).astype(int).reshape(-1, 120, 160, 3)
    assert len(shown) == len(drawn)
    assert max(np.abs(a - b).mean() for a, b in zip(shown, drawn, strict=True)) < 8


def test_a_gif_loops_at_its_frame_rate_and_keeps_the_colours(needs_opengl, fall, tmp_path):
    save_video(tmp_path / "fall.gif", fall, fps=10, size=(160, 120), begin=0.0, end=0.3)
    drawn = list(frames(fall, 10, (160, 120), 0.0, 0.3))
    with Image.open(tmp_path / "fall.gif") as gif:
        assert gif.info["loop"] == 0
        assert gif.info["duration"] == 100
        shown = np.asarray(gif.convert("RGB"), int)
    assert np.abs(shown - drawn[0]).mean() < 3
    assert len(orange(shown)) > 0.7 * len(orange(drawn[0])) > 20


def test_a_picture_can_be_read_back(tmp_path):
    image = np.random.default_rng(0).integers(0, 255, (6, 5, 3), np.uint8)
    save_picture(tmp_path / "picture.png", image)
    assert (np.asarray(Image.open(tmp_path / "picture.png")) == image).all()


@pytest.mark.parametrize(
    ("save", "message"),
    [
        (lambda folder, r: save_video(folder / "a.avi", r), r"a\.avi': unknown suffix '\.avi'; valid: \.mp4, \.gif"),
        (lambda folder, r: save_picture(folder / "a", r), r"a': unknown suffix ''; valid: \.png, \.jpg"),
        (lambda folder, r: save_video(folder / "a.mp4", r, size=(161, 120)), "161 x 120 pixels; valid: even numbers"),
        (lambda folder, r: save_video(folder / "a.mp4", r, fps=0), "fps and speed must be positive, not 0 and 1"),
        (lambda folder, r: save_picture(folder / "no" / "a.png", np.zeros((2, 2, 3), np.uint8)), "there is no folder"),
        (lambda folder, r: save_video(folder / "no" / "a.mp4", r), "there is no folder"),
    ],
)
def test_what_cannot_be_written_is_named_before_anything_is_drawn(tmp_path, fall, save, message):
    with pytest.raises(UserError, match=message):
        save(tmp_path, fall)
    assert not list(tmp_path.iterdir())


# OpenGL.


@pytest.fixture
def fresh_choice():
    gl_backend.cache_clear()
    yield
    gl_backend.cache_clear()


def test_the_wish_in_mujoco_gl_is_respected(fresh_choice, monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    try:
        answer = gl_backend()
    except UserError as error:
        answer = str(error)
    assert answer == "osmesa" or "MUJOCO_GL=osmesa" in answer


def test_without_any_opengl_the_error_says_what_to_install(fresh_choice, monkeypatch, robot):
    # PyOpenGL refuses EGL and OSMesa under this name, and GLFW needs a display.
    monkeypatch.setenv("PYOPENGL_PLATFORM", "none")
    for name in ("MUJOCO_GL", "DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(UserError, match=r"no OpenGL to draw with \(egl, osmesa, glfw\); try: apt install libegl1"):
        Renderer(robot, 64, 48)


def test_a_strip_shows_a_push_only_while_it_acts(needs_opengl, stay):
    """The push lasts from 0 to 0.12 s; its arrow is orange."""
    strip = filmstrip([stay], times=[0.06, 0.2], cell=(200, 240))
    acting, after = strip[:240, 260:460], strip[:240, 464:664]
    arrow = [len(orange(picture)) for picture in (acting, after)]
    assert arrow[0] > 40
    assert arrow[1] == 0
