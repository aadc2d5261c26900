"""Films of a run: as long as asked for, with something moving, whole or not at all."""

import shutil
from itertools import pairwise

import numpy as np
import pytest
from PIL import Image

from auvplan.errors import AuvplanError
from auvplan.plot import animate_run
from auvplan.plot.animation import _Film
from auvplan.runtime.files import OutputError
from tests.io.sample_run import make_run, refused_leg

SENSORS = {"sensors": {"range": 250.0}}


@pytest.fixture(scope="module")
def run():
    made = make_run()
    made.legs.insert(1, refused_leg(made))
    made.scenario |= SENSORS
    return made


@pytest.fixture(scope="module")
def film(run, tmp_path_factory):
    return animate_run(run, tmp_path_factory.mktemp("film") / "new" / "mission.gif", seconds=1.5, fps=6)


def test_a_gif_is_as_long_as_asked_for_and_moves(film):
    with Image.open(film) as picture:
        assert picture.width == 640
        assert picture.n_frames == 9
        shown, lasts = [], []
        for number in range(picture.n_frames):
            picture.seek(number)
            lasts.append(picture.info["duration"])
            shown.append(np.asarray(picture.convert("RGB")))
    assert sum(lasts) == pytest.approx(1500 + 2000, abs=10)
    assert all((one != other).any() for one, other in pairwise(shown))
    assert [path.name for path in film.parent.iterdir()] == ["mission.gif"]


def test_the_same_run_makes_the_same_film(run, film, tmp_path):
    again = animate_run(run, tmp_path / "again.gif", seconds=1.5, fps=6)
    assert again.read_bytes() == film.read_bytes()


def test_parts_are_where_the_mission_is(run):
    film = _Film(run, 640, 100.0)
    leg = run.done[1]
    before, after = leg.plans
    film.at(leg.times[3])
    parts = film.moving
    np.testing.assert_allclose(parts["vehicle"].get_offsets()[0], leg.positions[3, [1, 0]])
    np.testing.assert_allclose(parts["reach"].get_center(), leg.positions[3, [1, 0]])
    assert parts["reach"].radius == 250.0
    np.testing.assert_allclose(parts["track"].get_xydata()[-1], leg.positions[3, [1, 0]])
    np.testing.assert_allclose(parts["plan"].get_xydata(), before.positions[:, [1, 0]])
    np.testing.assert_allclose(parts["obstacles"][1].get_offsets(), leg.obstacle_positions[3][:, [1, 0]])
    assert len(parts["past"].get_segments()) == 1, "that of the leg that was refused: older ones have faded"
    film.at(after.made_at + 50.0)
    np.testing.assert_allclose(parts["plan"].get_xydata(), after.positions[:, [1, 0]])
    assert parts["past"].get_colors()[-1][3] == pytest.approx(0.375), "half faded"
    film.at(film.ends)
    assert f"priority {run.total_priority:.3g}; arrived at 2" in parts["title"].get_text()


def test_a_leg_in_open_water_and_a_plan(tmp_path):
    run = make_run((0, 1), chart=False, obstacles=False)
    run.simulated, run.routes = False, []
    assert animate_run(run, tmp_path / "plan.gif", seconds=0.5, fps=4, width=400).stat().st_size > 5000


@pytest.mark.parametrize(
    ("name", "settings", "stated"),
    [
        ("film.avi", {}, "a film is a .gif"),
        ("film.gif", {"seconds": 0.0}, "seconds"),
        ("film.gif", {"seconds": float("nan")}, "seconds"),
        ("film.gif", {"fps": 31}, "fps"),
        ("film.gif", {"width": 10}, "width"),
    ],
)
def test_what_cannot_be_is_refused(run, tmp_path, name, settings, stated):
    with pytest.raises(AuvplanError, match=stated):
        animate_run(run, tmp_path / "none" / name, **settings)
    assert not list(tmp_path.iterdir())


def test_nothing_executed_is_stated(tmp_path):
    run = make_run()
    run.legs = [refused_leg(run)]
    with pytest.raises(AuvplanError, match="nothing to animate"):
        animate_run(run, tmp_path / "film.gif")


def test_without_ffmpeg_a_film_is_a_gif(run, tmp_path, monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda _: None)
    with pytest.raises(OutputError, match=r"ffmpeg.*write a \.gif"):
        animate_run(run, tmp_path / "film.mp4")


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="ffmpeg is not installed")
def test_an_mp4_is_written_or_what_is_wrong_stated(run, tmp_path, monkeypatch):
    film = animate_run(run, tmp_path / "film.mp4", seconds=0.5, fps=4, width=401)
    assert film.read_bytes()[4:8] == b"ftyp"
    monkeypatch.setattr(_Film, "size", (0, 0))
    with pytest.raises(OutputError, match=r"bad\.mp4: ffmpeg: "):
        animate_run(run, tmp_path / "bad.mp4", seconds=0.5, fps=4)
    assert [path.name for path in tmp_path.iterdir()] == ["film.mp4"]
