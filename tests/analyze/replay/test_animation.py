"""Animation of a strike: lines over the images, growing curves, and files in three formats below a limit."""

from __future__ import annotations

import dataclasses

import av
import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from analyze.cli import main
from analyze.progress import no_progress
from analyze.reading.recording import open_recording
from analyze.reading.recording_file import RecordingFile
from analyze.replay import animation_file
from analyze.replay.animated_strike import read_animated_strike
from analyze.replay.animation import speed_text
from analyze.replay.animation_file import HOLD_S, RATE_HZ, write_animation
from analyze.replay.palette import ORANGE, SKY
from analyze.replay.tip_drawing import HEIGHT_PX, WIDTH_PX, TipDrawing
from tests.places import FIRST_SAMPLE


@pytest.fixture(scope="module")
def strike():
    with open_recording(FIRST_SAMPLE) as recording:
        return read_animated_strike(recording, "s2.2", None, no_progress)


def noise(count: int = 4) -> list[np.ndarray]:
    rng = np.random.default_rng(3)
    return [rng.integers(0, 255, (40, 60, 3), dtype=np.uint8) for _ in range(count)]


def test_line_through_the_centre_of_mass_is_upright_at_balance(strike):
    """The line crosses the plumb line within 0.05 degrees of the balance angle, and never turns back."""
    lean = np.array([each.balance[1, 0] - each.plumb[1, 0] for each in strike.lines])
    theta = np.interp(strike.time_ns, strike.fitted.time_ns, strike.fitted.theta)
    fitted = np.array([each.fitted for each in strike.lines])
    behind = np.sign(lean[-1]) * lean
    crossing = np.interp(0.0, behind[fitted], theta[fitted])
    assert np.degrees(abs(crossing - strike.fit.phi)) < 0.05
    assert np.all(np.diff(behind[fitted]) > 0)
    for each in strike.lines:
        np.testing.assert_allclose(each.balance[0], each.plumb[0])


def test_outline_encloses_the_tags_of_every_image(strike):
    assert len(strike.lines) == len(strike.images) > 40
    assert sum(bool(each.tags) for each in strike.lines) > 0.95 * len(strike.lines)
    for each in strike.lines:
        points = np.concatenate(each.outline)
        for tag in each.tags:
            assert np.all((tag > points.min(axis=0) - 1) & (tag < points.max(axis=0) + 1))


def test_curve_grows_and_the_balance_appears_when_it_is_passed(strike):
    drawing = TipDrawing(strike, "1/6 speed")
    last = len(strike.images) - 1
    passage = next(i for i in range(last) if strike.lines[i].fitted and _passed(strike, i))
    begin, before, after, end = (drawing.picture(i) for i in (0, passage - 2, passage + 2, last))
    assert begin.shape == (HEIGHT_PX, WIDTH_PX, 3)
    curves = [_pixels(each, SKY) for each in (begin, before, after, end)]
    assert curves == sorted(curves)
    assert curves[0] < 0.5 * curves[1] < 0.5 * curves[3]
    assert _pixels(after, ORANGE) > 1.5 * _pixels(before, ORANGE)


def _passed(strike, i: int) -> bool:
    return np.interp(strike.time_ns[i], strike.fitted.time_ns, strike.fitted.theta) > strike.fit.phi


def _pixels(picture: np.ndarray, colour: tuple[int, int, int]) -> int:
    """Number of pixels of a colour in the right half, where the curves are."""
    right = picture[:, WIDTH_PX // 2 :].astype(int)
    return int(np.count_nonzero(np.abs(right - np.array(colour)).max(axis=-1) < 12))


def test_strange_names_are_drawn(strike):
    odd = dataclasses.replace(strike, object_name="$x^{_$ [b] 茶 " * 5)
    assert TipDrawing(odd, "").picture(0).any()


@pytest.mark.parametrize("suffix", [".webp", ".gif", ".mp4"])
def test_every_format_plays_all_pictures(suffix, tmp_path):
    path = tmp_path / f"out{suffix}"
    ramp = [np.full((40, 60, 3), 20 * i, dtype=np.uint8) for i in range(5)]
    size = write_animation(ramp, path, no_progress)
    assert size == path.stat().st_size
    assert [each.name for each in tmp_path.iterdir()] == [path.name]
    if suffix == ".mp4":
        with av.open(path) as container:
            grey = [frame.to_ndarray(format="gray").mean() for frame in container.decode(video=0)]
        assert len(grey) == 5 + HOLD_S * RATE_HZ
    else:
        with Image.open(path) as found:
            assert found.info["loop"] == 0
            assert found.n_frames == 5
            grey = []
            for i in range(5):
                found.seek(i)
                grey.append(np.asarray(found.convert("L")).mean())
            assert found.info["duration"] == 1000 * HOLD_S
    np.testing.assert_allclose(grey[:5], [0, 20, 40, 60, 80], atol=4)


def test_size_stays_below_the_limit(tmp_path):
    best = write_animation(noise(), tmp_path / "best.webp", no_progress)
    assert write_animation(noise(), tmp_path / "small.webp", no_progress, best // 3) <= best // 3


def test_speed_is_that_of_the_pictures():
    every = np.arange(10) * round(1e9 / 240)
    assert speed_text(every) == "1/12 speed"
    assert speed_text(np.arange(10) * 50_000_000) == "full speed"
    assert speed_text(every[:1]) == "still picture"


def test_command_writes_the_first_good_strike(tmp_path, monkeypatch):
    monkeypatch.setattr("analyze.replay.animated_strike.MAX_FRAMES", 6)
    path = tmp_path / "tip.webp"
    done = CliRunner().invoke(main, ["replay", str(FIRST_SAMPLE), "--animation", str(path)])
    assert done.exit_code == 0, done.output
    assert done.stdout.startswith(f"animation: {path}: strike s1.1, 6 pictures, full speed")
    with Image.open(path) as found:
        assert (found.size, found.n_frames) == ((WIDTH_PX, HEIGHT_PX), 6)


@pytest.mark.parametrize(
    ("name", "more", "message"),
    [
        ("tip.avi", [], "an animation is .gif, .mp4, .webp, by its suffix: name it tip.webp"),
        ("tip.webp", ["--page", "answer"], "has no strike 'answer' to animate: choose one of s1.1, s2.2"),
        ("no/tip.webp", [], "create it first"),
    ],
)
def test_wrong_options_give_a_one_line_error(name, more, message, tmp_path):
    done = CliRunner().invoke(main, ["replay", str(FIRST_SAMPLE), "--animation", str(tmp_path / name), *more])
    assert done.exit_code == 1
    (line,) = done.stderr.splitlines()
    assert message in line
    assert not list(tmp_path.iterdir())


def test_recording_that_still_grows_is_refused(tmp_path, monkeypatch):
    growing = RecordingFile(FIRST_SAMPLE, growing=True)
    monkeypatch.setattr("analyze.reading.recording_file.find_recording", lambda path: growing)
    done = CliRunner().invoke(main, ["replay", str(FIRST_SAMPLE), "--animation", str(tmp_path / "t.webp")])
    assert done.exit_code == 1
    assert "is still being recorded: animate it when the session has ended" in done.stderr


def test_missing_mp4_encoder_is_named(tmp_path, monkeypatch):
    from av.codec.codec import UnknownCodecError

    def unknown(*args, **kwargs):
        raise UnknownCodecError(1, "unknown")

    monkeypatch.setattr("av.container.OutputContainer.add_stream", unknown, raising=False)
    monkeypatch.setattr(animation_file, "HOLD_S", 0.1)
    with pytest.raises(animation_file.ReplayError, match="no encoder libx264"):
        write_animation(noise(), tmp_path / "t.mp4", no_progress)
