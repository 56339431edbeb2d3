"""The study types-16bit: all 65,536 numbers of each kind against numpy's int16 and float16."""

from __future__ import annotations

import numpy as np
import pytest

import chapters
from backends.gl import api as gl
from chapters.ch06.studies.types_16bit import WAYS, Settings, decoded, encoded, halves, integers
from chapters.ch06.studies.types_16bit import vulkan as on_vulkan
from tests.support.hazards import find_hazards
from tests.support.kernel_calls import events_of, gl_calls, owed, use, without_each

types = pytest.mark.feature("precision/16-bit-types")
only_vulkan = pytest.mark.parametrize("stage", ["vulkan"], indirect=True, scope="module")
only_gl = pytest.mark.parametrize("stage", ["gl"], indirect=True, scope="module")
WHICH = "6/types-16bit"
EVERY = np.arange(1 << 16).astype(np.uint16)
"""The bits of all numbers of 16 bits."""


def ways_of(stage):
    """Return the ways that a device can go; on OpenGL none has 16-bit types."""
    native = stage.backend == "vulkan" and stage.device.has("types-16bit")
    return WAYS if native else WAYS[1:]


def results(stage, monkeypatch, settings, bits=EVERY, time=0.0):
    """Return y and g that the kernel makes of the numbers with these bits, and the bytes of its buffers."""
    module = chapters.renderer_module(WHICH, stage.backend)
    monkeypatch.setattr(module.Renderer, "integers", staticmethod(lambda settings: bits.view(np.int16)))
    monkeypatch.setattr(module.Renderer, "halves", staticmethod(lambda settings: bits.view(np.float16)))
    with stage.open(WHICH, (8, 8), settings=settings) as renderer:
        frame = renderer.render(chapters.view_of(renderer), time)
        assert renderer.way == settings.way
        return *renderer.results(), frame.work["bytes"]


def same_halves(one, other):
    """Whether halves have the same bits. What is not a number has many, and devices choose among them."""
    return ((one.view(np.uint16) == other.view(np.uint16)) | (np.isnan(one) & np.isnan(other))).all()


# --- arithmetic -------------------------------------------------------------------------------------------------------


@types
@pytest.mark.parametrize(("a", "b", "shift"), [(3, 500, 1), (-32768, 32767, 15), (12345, -1, 0), (-7, 0, 4)])
def test_integers_wrap_around_and_keep_their_sign_as_numpy_s(stage, monkeypatch, a, b, shift):
    with np.errstate(over="ignore"):
        expected = (np.int16(a) * EVERY.view(np.int16) + np.int16(b)) >> np.int16(shift)
    for way in ways_of(stage):
        assert (results(stage, monkeypatch, Settings(len(EVERY), way, a, b, shift))[0] == expected).all()


@types
@pytest.mark.parametrize(
    ("c", "d"), [(1.1, 1000.0), (3.7, -0.001), (-65504.0, 1.0), (0.3, 0.0), (2**-14, 0.0)]
)
def test_halves_are_rounded_to_the_nearest_twice_as_numpy_s(stage, monkeypatch, c, d):
    """Also what overflows, and infinities, and subnormal numbers if words are used."""
    h = EVERY.view(np.float16)
    with np.errstate(all="ignore"):
        product = np.float16(c) * h
        expected = product + np.float16(d)
    for way in ways_of(stage):
        compared = np.ones(len(h), bool)
        if way == "types":
            if not on_vulkan.rounds_to_nearest(stage.device):
                continue  # such a device does not promise how it rounds
            for one in (h, product, expected):  # subnormal operands and results of 16 bits may be 0
                compared &= (np.abs(one) >= 2.0**-14) | (one == 0) | np.isnan(one)
        _, g, _ = results(stage, monkeypatch, Settings(len(EVERY), way, c=c, d=d))
        assert same_halves(g[compared], expected[compared]) and compared.mean() > 0.3


@types
def test_an_operation_in_single_precision_and_a_second_rounding_are_one_rounding():
    """What the packed way relies on, in double precision, which holds each product and near sum exactly."""
    random = np.random.default_rng(16)
    one, other = random.integers(0, 1 << 16, (2, 200_000)).astype(np.uint16).view(np.float16)
    finite = np.isfinite(one) & np.isfinite(other)
    one, other = one[finite], other[finite]
    with np.errstate(over="ignore"):
        for exact, single in (
            (one.astype(float) * other, one.astype(np.float32) * other.astype(np.float32)),
            (one.astype(float) + other, one.astype(np.float32) + other.astype(np.float32)),
        ):
            assert (exact.astype(np.float16) == single.astype(np.float16)).all()


# --- memory -----------------------------------------------------------------------------------------------------------


@types
@pytest.mark.parametrize("count", [1, 2, 511, 1000, 65_536])
def test_buffers_have_half_the_bytes_and_each_way_the_same_bits(stage, monkeypatch, count):
    bits = np.random.default_rng(count).integers(0, 1 << 16, count).astype(np.uint16)
    found = {}
    for way in ways_of(stage):
        found[way] = results(stage, monkeypatch, Settings(count, way, c=0.7, d=3.0), bits)
    y, g, size = found["words"]
    assert len(y) == len(g) == count and size == 4 * 4 * (count + count % 2)
    assert np.isfinite(g).any()
    for way, (other_y, other_g, bytes_) in found.items():
        assert (y == other_y).all()
        if way == "packed":
            assert same_halves(g, other_g)
        assert 2 * bytes_ == size or way == "words"


@types
def test_numbers_go_into_words_and_come_back():
    for numbers in (EVERY.view(np.int16), EVERY.view(np.float16), EVERY[:7].view(np.int16)):
        settings = Settings(len(numbers))
        for way in WAYS:
            content = encoded(numbers, way)
            assert content.nbytes == (4 if way == "words" else 2) * (len(numbers) + len(numbers) % 2)
            back = decoded(content.view(np.uint8), numbers.dtype.type, settings, way)
            assert (back.view(np.uint16) == numbers.view(np.uint16)).all()
    assert encoded(np.array([-2, 1], np.int16), "words").tolist() == [0xFFFFFFFE, 1]  # with its sign
    assert encoded(np.array([-2, 1], np.int16), "packed").tolist() == [0x0001FFFE]
    assert encoded(np.array([1.0, -2.0], np.float16), "packed").tolist() == [0xC0003C00]


@types
def test_without_the_feature_words_are_packed_and_the_picture_is_the_same(stage):
    pictures = {}
    for without in ((), ("types-16bit",)):
        with stage.open(WHICH, (64, 48), without=without) as renderer:
            frame = renderer.render(chapters.view_of(renderer), 0.7)
            pictures[without] = frame.image("color"), renderer.way
    assert [way for _, way in pictures.values()] == [ways_of(stage)[0], "packed"]
    first, second = (picture for picture, _ in pictures.values())
    assert (first == second).all()


@types
@pytest.mark.parametrize("way", WAYS[1:])
def test_the_picture_shows_integers_above_and_errors_of_rounding_below(stage, way):
    """In a way that the device has; types are shown by the test before this one."""
    size = (40, 32)
    settings = Settings(40, way)
    with stage.open(WHICH, size, settings=settings) as renderer:
        picture = renderer.render(chapters.view_of(renderer)).image("color")
        y, g = renderer.results()
    x, h = integers(settings), halves(settings)
    v = (np.arange(32) + 0.5)[:, None] / 32
    height = (1 - 4 * v) * 32768
    colors = np.array([(0.05, 0.05, 0.06), (0.1, 0.45, 0.55), (0.95, 0.75, 0.3), (0.85, 0.35, 0.25)])
    above = np.where(covers(x, height), 2, covers(y, height).astype(int))
    exact = np.float16(settings.c).astype(float) * h.astype(float) + settings.d
    error = g.astype(float) - exact
    assert 0.1 < np.abs(error).max() <= 0.5 + 1 / 16  # two roundings: of the sum, and of the product before
    below = np.where(covers(error, 0.75 * (3 - 4 * v)), 3, 0)
    expected = colors[np.where(v < 0.5, above, below)]
    assert (np.abs(picture / 255 - expected).max(axis=-1) <= 0.6 / 255).mean() > 0.995


def covers(value, height):
    return np.where(height >= 0, height < value, height > value)


# --- who waits --------------------------------------------------------------------------------------------------------


@types
@only_vulkan
def test_each_barrier_is_needed_and_none_is_missing(stage):
    uses = {
        "kernel": [use("kernel", "results", "compute storage_write", fresh=True)],
        "show": [use("show", "results", "fragment storage_read")],
    }
    with stage.open(WHICH, (8, 8)) as renderer:
        view = chapters.view_of(renderer)
        events = events_of(renderer, lambda number: renderer.render(view, 0.1 * number), uses)
    assert find_hazards(events, {}) == []
    own = [hazards for one, hazards in without_each(events) if "compute" in str(one)]
    assert len(own) == 2 and all(own)


@types
@only_gl
def test_opengl_is_told_on_both_sides_of_the_kernel(stage):
    bit = gl.GL_SHADER_STORAGE_BARRIER_BIT
    with stage.open(WHICH, (8, 8)) as renderer:
        view = chapters.view_of(renderer)
        calls = gl_calls(stage.device, renderer, lambda number: renderer.render(view, 0.1 * number), 3)
    assert owed(calls, {"glDrawArrays": bit}, bit) == []
    told = [place for place, one in enumerate(calls) if one == ("glMemoryBarrier", bit)]
    for left_out in told[2:4]:
        assert owed([one for place, one in enumerate(calls) if place != left_out], {"glDrawArrays": bit}, bit)


@types
@pytest.mark.parametrize(
    ("set_", "said"),
    [
        ("way=halves", "setting way must be one of types, packed, words, not 'halves'"),
        ("shift=16", "shift must be 0 to 15"),
    ],
)
def test_what_cannot_be_is_one_sentence(strata, set_, said):
    code, _, err = strata("run", WHICH, "--set", set_)
    assert code == 2 and said in err and err.count("\n") == 1, err
