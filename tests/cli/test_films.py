"""Animations: what is written is what Pillow reads again, one frame at a time, and limits are said before the work."""

from __future__ import annotations

import weakref

import numpy as np
import pytest
from PIL import Image, ImageSequence

from common.errors import UserError
from tools.run.films import FILMS, check_film, durations_ms, write_film

RNG = np.random.default_rng(3)
FRAMES = [RNG.integers(0, 256, (10, 14, 3)).astype(np.uint8) for _ in range(7)]
LOSSLESS = [".webp", ".png"]


def frames_of(path) -> tuple[list[np.ndarray], list[float], int]:
    """Return the frames of a film, for how long each is shown in ms, and how often (0: for ever)."""
    with Image.open(path) as film:
        found, shown = [], []
        for frame in ImageSequence.Iterator(film):
            found.append(np.asarray(frame.convert("RGB")))
            shown.append(frame.info.get("duration", 0))
        return found, shown, film.info.get("loop", -1)


@pytest.mark.parametrize("suffix", LOSSLESS)
@pytest.mark.parametrize("channels", [3, 4])
def test_every_code_of_every_frame_comes_back(tmp_path, suffix, channels):
    path = tmp_path / f"a{suffix}"
    pictures = [
        np.concatenate([f, np.full((10, 14, 1), 255, np.uint8)], axis=2)[..., :channels] for f in FRAMES
    ]
    write_film(path, pictures, 7, 25.0)
    found, shown, loop = frames_of(path)
    assert len(found) == 7 and all(np.array_equal(a, b) for a, b in zip(found, FRAMES, strict=True))
    assert loop == 0 and set(shown[1:]) == {40}
    assert [one.name for one in tmp_path.iterdir()] == [path.name]


def test_a_gif_has_all_frames_in_256_colours(tmp_path):
    few = [np.repeat(np.repeat(frame[:2, :2], 5, axis=0), 7, axis=1) for frame in FRAMES]
    write_film(tmp_path / "a.gif", few, 7, 25.0)
    found, shown, loop = frames_of(tmp_path / "a.gif")
    assert (
        all(np.abs(a.astype(int) - b).max() <= 1 for a, b in zip(found, few, strict=True)) and len(found) == 7
    )
    assert (set(shown), loop) == ({40}, 0)


@pytest.mark.parametrize("suffix", FILMS)
def test_one_frame_is_a_film_too(tmp_path, suffix):
    write_film(tmp_path / f"a{suffix}", FRAMES[:1], 1, 30.0)
    found, _, _ = frames_of(tmp_path / f"a{suffix}")
    assert len(found) == 1 and (suffix == ".gif" or np.array_equal(found[0], FRAMES[0]))


@pytest.mark.parametrize("suffix", FILMS)
def test_frames_are_taken_while_the_film_is_written(tmp_path, suffix):
    """At no time more than three frames are alive, however many there are: this one, the next one, and a copy."""
    alive: list[weakref.ref] = []
    most = 0

    def made():
        nonlocal most
        for index in range(40):
            picture = np.full((8, 8, 3), 6 * index, np.uint8)
            alive.append(weakref.ref(picture))
            most = max(most, sum(one() is not None for one in alive))
            yield picture

    write_film(tmp_path / f"a{suffix}", made(), 40, 30.0)
    assert len(alive) == 40 and most <= 3


@pytest.mark.parametrize("suffix", FILMS)
def test_an_error_while_frames_are_made_leaves_nothing(tmp_path, suffix):
    def made():
        yield from FRAMES[:3]
        raise UserError("no more.")

    with pytest.raises(UserError, match="no more"):
        write_film(tmp_path / f"a{suffix}", made(), 7, 30.0)
    assert not list(tmp_path.iterdir())


def test_a_film_lasts_as_long_as_its_frames_and_no_frame_is_a_tick_off():
    for rate, tick in ((60.0, 1), (24.0, 1), (25.0, 10), (30.0, 10), (0.7, 10)):
        found = durations_ms(600, rate, tick)
        assert abs(sum(found) - 600_000 / rate) <= tick / 2 + 1e-9
        assert max(found) - min(found) <= tick and all(one % tick == 0 for one in found)
    assert durations_ms(4, 60.0) == [17, 16, 17, 17]


@pytest.mark.parametrize(
    ("name", "frames", "size", "rate", "says"),
    [
        ("a.jpg", 2, (8, 8), 30.0, "name .webp, .gif or .png"),
        ("nowhere/a.webp", 2, (8, 8), 30.0, "there is no folder"),
        ("", 2, (8, 8), 30.0, "is a folder"),
        ("a.webp", 2, (16384, 8), 30.0, "a side has at most 16383 pixels"),
        ("a.gif", 2, (8, 8), 60.0, "cannot show 60 frames a second: --fps is at most 50 for .gif"),
        ("a.webp", 2, (8, 8), 0.01, "cannot show a frame for 100 s"),
        ("a.gif", 10_000, (1280, 720), 30.0, "would be too large with 10000 frames of 1280x720"),
        ("a.webp", 10**9, (1280, 720), 30.0, "a-%04d.png"),
    ],
)
def test_what_no_film_can_be_is_said_before_the_work(tmp_path, name, frames, size, rate, says):
    with pytest.raises(UserError) as caught:
        check_film(tmp_path / name, frames, size, rate)
    assert says in str(caught.value)


def test_a_disk_that_refuses_is_a_sentence(tmp_path):
    with pytest.raises(UserError, match="cannot be written"):
        write_film(tmp_path / "gone" / "a.webp", FRAMES, 7, 30.0)
