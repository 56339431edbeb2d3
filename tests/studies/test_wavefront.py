"""The study wavefront: pictures by kernels over queues against the chapter's loop, and counters against known paths."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from chapters.ch12.studies.wavefront import Settings, passes
from chapters.ch12.studies.wavefront.layout import ROUNDS, wave_tiles
from common.errors import SettingError, UnsupportedError
from common.scene import FogBox, Material, Medium
from common.settings import apply_overrides
from tests.support.path_cases import WITHIN, chamber, lamp, metal, scene_of
from tests.support.shadows import PLAIN, placed, point

WHICH, SIZE = "12/wavefront", (24, 16)
WHITE = metal(1.0, 1.0, 1.0, 0.9)
HALF_SEEN = Material(base_color=(0.2, 0.5, 0.9, 0.5), metallic=0.0, alpha_mode="blend", double_sided=True)

pytestmark = pytest.mark.parametrize(
    "stage", ["vulkan", pytest.param("gl", marks=pytest.mark.long)], indirect=True, scope="module"
)
"""A cold driver of OpenGL takes 30 s for the kernels of a scene."""


def room():
    """Return a room that is open to the front, with a lamp, a light, and a pane that half of all rays pass through."""
    paint = [metal(*color, roughness) for *color, roughness in ((0.7, 0.7, 0.7, 0.4), (0.8, 0.8, 0.8, 0.9))]
    squares = chamber(paint[0], paint[1], metal(0.8, 0.15, 0.1, 0.9), metal(0.1, 0.6, 0.2, 0.9), paint[0])
    pane = placed((-0.4, 0.8, 0.3), (0.7, 0.9), (0.2, 0.0, 1.0)), HALF_SEEN
    return scene_of(
        [*squares, lamp(0.5, (9.0, 7.0, 5.0)), pane], lights=[point((0.3, 1.2, 0.7), candela=1.0)]
    )


def opened(stage, kernel, scene, size=SIZE, **turned):
    knobs = {**PLAIN, "path_kernel": kernel, "path_samples": 2, "path_bounces": 3, "path_roulette": 2}
    settings = Settings(**{**knobs, **turned})
    return stage.open(WHICH, size, scene, settings=settings, outputs={"color_linear"})


@pytest.fixture(scope="module")
def both(stage):
    """Return renderers of the room by both kernels; the picture takes several tiles, the last ones not whole."""
    with opened(stage, "loop", room()) as loop, opened(stage, "wave", room(), wave_paths=192) as wave:
        yield loop, wave


def light(renderer, frames=1):
    for _ in range(frames):
        frame = renderer.render(WITHIN, 0.0)
    return np.asarray(frame.image("color_linear"), np.float64)


def agree(stage, loop, wave):
    """Hold pictures to be the same: to the bit on a software driver; others may round in two kernels apart."""
    if stage.device.capabilities.is_software:
        assert (loop == wave).all()
    else:
        apart = np.abs(loop - wave).max(axis=-1) > 1e-3 * loop.mean()
        assert apart.mean() < 0.1
        assert abs(loop.mean() / wave.mean() - 1) < 0.05


@pytest.mark.feature("path-tracer/core")
def test_both_kernels_trace_the_same_picture(stage, both):
    """Sums of frames, knobs that change the number of rounds and of paths, and a part of a larger picture."""
    pictures = []
    for knobs in ({}, {"path_bounces": 1}, {"path_samples": 1, "path_seed": 3}, {"path_strategy": "bsdf"}):
        shown = []
        for renderer in both:
            for name, value in knobs.items():
                setattr(renderer.settings.paths, name, value)
            renderer.reset_history("test")
            shown.append(light(renderer, 2))
        agree(stage, *shown)
        pictures.append(shown[0])
    for renderer in both:
        renderer.techniques["paths"].crop = (10, 6, 48, 32)
    shown = [light(renderer, 2) for renderer in both]
    agree(stage, *shown)
    pictures.append(shown[0])
    assert all(np.abs(other - pictures[0]).max() > 0.1 * pictures[0].mean() for other in pictures[1:])
    for renderer in both:
        renderer.techniques["paths"].crop = None
        for name, value in {
            "path_bounces": 3,
            "path_samples": 2,
            "path_seed": 0,
            "path_strategy": "mis",
        }.items():
            setattr(renderer.settings.paths, name, value)


def counted(renderer, **knobs):
    """Return the live paths (ROUNDS,) of a frame, and the lanes of the kernels and of a loop."""
    for name, value in knobs.items():
        setattr(renderer.settings.paths, name, value)
    renderer.reset_history("test")
    work = renderer.render(WITHIN, 0.0)
    work.image("color_linear")
    told = work.work
    return [told[f"wave_live_{turn}"] for turn in range(ROUNDS)], told["wave_lanes"], told["loop_lanes"]


def test_counters_are_those_of_paths_of_a_known_length(stage, both):
    """Without roulette nothing ends a path but the open front, and a limit that leaves earlier rounds as they are."""
    _, wave = both
    pixels = SIZE[0] * SIZE[1]
    free, lanes, loop = counted(wave, path_samples=1, path_roulette=1024)
    assert free[0] == pixels and free[3] > 0 and free[4:] == [0] * (ROUNDS - 4)
    assert all(free[turn] > free[turn + 1] for turn in range(3))
    cut, *_ = counted(wave, path_bounces=2)
    assert cut[:3] == free[:3] and cut[3:] == [0] * (ROUNDS - 3)
    seen, few, as_many = counted(wave, path_bounces=0)
    assert seen[:2] == [pixels, 0] and few == as_many == pixels  # blocks of 8 x 8 are whole groups of 32
    assert loop % 32 == 0 and sum(free) <= lanes < loop <= 4 * pixels
    twice, *_ = counted(wave, path_bounces=3, path_samples=2)
    assert twice[0] == 2 * pixels
    ended, *_ = counted(wave, path_samples=1, path_roulette=1)
    assert ended[:2] == free[:2] and ended[2] < 0.9 * free[2]
    counted(wave, path_samples=2, path_roulette=2)


def test_tiles_have_no_more_paths_than_fit(stage):
    for extent, count, paths in (
        ((24, 16), 1, 192),
        ((1920, 1080), 4, 2**18),
        ((9, 9), 1, 64),
        ((7, 100), 3, 128),
    ):
        parts = wave_tiles(extent, count, paths)
        shown = np.zeros(extent, int)
        for x, y, columns, rows in parts:
            shown[x : x + columns, y : y + rows] += 1
            assert -(-columns // 8) * -(-rows // 8) * 64 <= paths
        assert (shown == 1).all() and len(parts) >= count


def test_what_has_no_room_is_refused_in_one_sentence(stage, monkeypatch):
    foggy = replace(
        room(), medium=Medium(boxes=(FogBox((0.0, 1.0, 0.0), (1.0, 1.0, 1.0), 1.0, (0.9, 0.9, 0.9)),))
    )
    with pytest.raises(SettingError, match=r"wavefront .* fog=off") as found:
        opened(stage, "wave", foggy)
    assert "\n" not in str(found.value)
    monkeypatch.setattr(passes, "PATH_BYTES", 2**24)
    with pytest.raises(
        UnsupportedError, match=r"wave_paths=65536 takes .* MiB.* set wave_paths=\d+ or less"
    ) as found:
        opened(stage, "wave", room(), wave_paths=65536)
    assert "\n" not in str(found.value)


@pytest.mark.parametrize(
    "asked", ["ray_way=pipeline", "path_lights=all", "wave_paths=63", "path_kernel=both"]
)
def test_what_is_no_choice_is_refused_in_one_sentence(stage, asked):
    with pytest.raises(SettingError, match=asked.partition("=")[0]) as found:
        apply_overrides(Settings(), [asked])
    assert "\n" not in str(found.value)
