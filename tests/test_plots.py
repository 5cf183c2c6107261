"""Plots: what is drawn stands where the numbers say, read back from the pixels."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image

from surefoot.errors import UserError
from surefoot.report import plot_style
from surefoot.report.learning_plots import learning_curves
from surefoot.report.plot_style import color_of
from surefoot.report.threshold_plots import BarRow, bars_beside_paper, polar_map

FORWARD, LEFT, BACKWARD, RIGHT = 0.0, 0.5 * np.pi, np.pi, 1.5 * np.pi
BOUND = [(FORWARD, 20.0), (LEFT, 20.0), (BACKWARD, 20.0), (RIGHT, 20.0)]


def pixels_of(path: Path, name: str) -> np.ndarray:
    """Where the picture has the colour of this algorithm: (num_pixels, 2) column from the left, row from the top."""
    picture = np.asarray(Image.open(path).convert("RGB"), float)
    distance = np.abs(picture - 255.0 * np.array(to_rgb(color_of(name, [name])))).max(axis=2)
    return np.argwhere(distance < 3.0)[:, ::-1]


def test_polar_map_puts_forward_up_and_left_at_the_left(tmp_path):
    thresholds = {"trpo": [(FORWARD, 100.0), (LEFT, 50.0), (BACKWARD, 25.0), (RIGHT, 75.0)]}
    polar_map(thresholds, BOUND, tmp_path / "map.png", title="")
    # 7.0 x 7.6 inch at 150 dpi = 1050 x 1140 pixels; the plot is centred at 50 % and 51 % from below, with 38 % of
    # the width as radius; the outer ring is at 100 Ns, so that 100 Ns is 399 pixels. Markers reach 7.3 pixels beyond.
    across, down = pixels_of(tmp_path / "map.png", "trpo").T
    in_plot = down < 1000
    x, y = (across - 525)[in_plot] / 3.99, (0.49 * 1140 - down)[in_plot] / 3.99
    assert y.max() == pytest.approx(100.0, abs=3.0)
    assert -x.min() == pytest.approx(50.0, abs=3.0)
    assert -y.min() == pytest.approx(25.0, abs=3.0)
    assert x.max() == pytest.approx(75.0, abs=3.0)


def test_the_papers_number_is_a_ring_around_its_place(tmp_path):
    thresholds = {"trpo": [(FORWARD, 40.0), (LEFT, 40.0), (BACKWARD, 40.0), (RIGHT, 40.0)]}
    polar_map(thresholds, BOUND, tmp_path / "map.png", title="", paper={"trpo": [(FORWARD, 100.0)]})
    # The place as above: 399 pixels above the centre at (525, 0.49 * 1140).
    offset = pixels_of(tmp_path / "map.png", "trpo") - [525, 0.49 * 1140 - 399]
    distance = np.hypot(*offset.T)
    near = distance[distance < 30]
    assert len(near) > 50
    assert near.min() > 5


def test_bars_are_as_long_as_their_numbers(tmp_path):
    rows = [BarRow("trpo", 150.0, 30.0, 60.0, 60.0), BarRow("ddpg", 100.0, 90.0, 60.0, 60.0)]
    bars_beside_paper(rows, tmp_path / "bars.png")
    lengths = {}
    for name in ("trpo", "ddpg"):
        for side, (low, high) in {"sagittal": (0, 750), "lateral": (750, 1500)}.items():
            across, down = pixels_of(tmp_path / "bars.png", name).T
            inside = (across >= low) & (across < high)
            # The filled bar is what has many pixels in each of its rows; the paper's has four, but for its edges.
            rows_of_bar, counts = np.unique(down[inside], return_counts=True)
            middle = rows_of_bar[counts > 20][len(rows_of_bar[counts > 20]) // 3]
            lengths[name, side] = counts[rows_of_bar == middle][0]
    per_ns = lengths["trpo", "sagittal"] / 150.0
    assert lengths["ddpg", "sagittal"] == pytest.approx(100.0 * per_ns, abs=4)
    assert lengths["ddpg", "lateral"] == pytest.approx(90.0 * per_ns, abs=4)
    assert lengths["trpo", "lateral"] == pytest.approx(30.0 * per_ns, abs=4)


def test_the_thick_learning_curve_is_the_mean_of_its_seeds(tmp_path):
    def run(share: float) -> list[dict[str, float]]:
        return [{"minutes": m, "steps": 1000 * m, "recovered": share} for m in (1.0, 5.0, 10.0)]

    learning_curves({"trpo": [run(0.2), run(0.6)], "ddpg": [run(0.0)], "ppo": [run(1.0)]}, tmp_path / "curves.png")
    # Full colour is only in the thick lines and, above the plots, in the legend.
    height = {name: np.median(pixels_of(tmp_path / "curves.png", name)[:, 1]) for name in ("trpo", "ddpg", "ppo")}
    assert (height["ddpg"] - height["trpo"]) / (height["ddpg"] - height["ppo"]) == pytest.approx(0.4, abs=0.01)


def test_a_curve_ends_where_its_shortest_seed_does(tmp_path):
    long = [{"minutes": m, "steps": 1000 * m, "recovered": 0.5} for m in (1.0, 9.0, 19.0)]
    learning_curves({"ppo": [long], "trpo": [long, long[:2]]}, tmp_path / "curves.png")
    ends = {}
    for name in ("ppo", "trpo"):
        pixels = pixels_of(tmp_path / "curves.png", name)
        in_first_panel = pixels[(pixels[:, 0] < 790) & (pixels[:, 1] > 100)]
        ends[name] = in_first_panel[:, 0].min(), in_first_panel[:, 0].max()
    # TRPO is drawn over PPO from minute 1 to 9, PPO alone from 9 to 19.
    assert (ends["ppo"][1] - ends["trpo"][1]) / (ends["trpo"][1] - ends["trpo"][0]) == pytest.approx(10 / 8, abs=0.05)


def test_an_algorithm_has_the_same_colour_in_every_plot_and_strangers_differ():
    names = ["mine", "TRPO", "yours", "trpo-paper-0"]
    assert color_of("TRPO", names) == color_of("trpo-paper-0", ["trpo-paper-0"])
    assert len({color_of(name, names) for name in ("mine", "TRPO", "yours")}) == 3


@pytest.mark.parametrize("suffix", [".svg", ".png"])
def test_same_numbers_give_the_same_file(tmp_path, suffix):
    files = [tmp_path / f"{i}{suffix}" for i in range(2)]
    for file in files:
        polar_map({"trpo": BOUND}, BOUND, file)
    assert files[0].read_bytes() == files[1].read_bytes()


def test_plots_leave_matplotlibs_global_state_alone(tmp_path):
    before = dict(matplotlib.rcParams)
    polar_map({"trpo": BOUND}, BOUND, tmp_path / "map.png")
    assert dict(matplotlib.rcParams) == before
    code = "import sys, surefoot.report.threshold_plots; sys.exit('matplotlib.pyplot' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_an_unknown_suffix_is_answered_with_the_valid_ones(tmp_path):
    with pytest.raises(
        UserError, match=r"cannot write '.*map\.bmp': unknown suffix '\.bmp'; valid: \.png, \.svg, \.pdf"
    ):
        polar_map({"trpo": BOUND}, BOUND, tmp_path / "map.bmp")


def test_a_folder_that_does_not_exist_is_named(tmp_path):
    with pytest.raises(UserError, match=r"cannot write .*nowhere/map\.png: No such file or directory"):
        polar_map({"trpo": BOUND}, BOUND, tmp_path / "nowhere" / "map.png")


@pytest.mark.parametrize(
    ("draw", "message"),
    [
        (lambda path: polar_map({}, BOUND, path), "no thresholds to draw"),
        (lambda path: polar_map({"trpo": []}, BOUND, path), "no thresholds to draw"),
        (lambda path: learning_curves({"trpo": [[]]}, path), "no learning curves to draw"),
        (lambda path: bars_beside_paper([], path), "no rejected impulses to draw"),
    ],
)
def test_nothing_to_draw_is_said_and_no_file_is_written(tmp_path, draw, message):
    with pytest.raises(UserError, match=message):
        draw(tmp_path / "picture.png")
    assert not (tmp_path / "picture.png").exists()


def test_all_colours_differ():
    colours = [*plot_style._COLORS.values(), *plot_style._SPARE_COLORS]
    assert len(set(colours)) == len(colours)
