"""The study shader-chain: copies keep every bit, effects are those of numpy, and a new one is a file and no code."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import chapters
from chapters.ch04.studies.shader_chain import COPY, EFFECTS, Pass, Settings, original, stored, textures
from common.errors import UserError
from tests.support.bounds import codes_off
from tests.support.frame_calls import calls_of_a_frame, labels_of, not_waited_for, views_made

chained = pytest.mark.feature("composition/composite-processor")
WHICH = "4/shader-chain"
SIZE = (37, 23)
BITS = {"rgba8": np.uint8, "rgba16f": np.uint16, "rgba32f": np.uint32}


def opened(stage, monkeypatch, size=SIZE, **replaced):
    """Return a renderer whose chain, original or textures are those of a test."""
    settings = replaced.pop("settings", Settings("none", 1, "rgba32f"))
    module = chapters.renderer_module(WHICH, stage.backend)
    for name, value in replaced.items():
        monkeypatch.setattr(module.Renderer, name, staticmethod(lambda *_, value=value: value))
    return stage.open(WHICH, size, settings=settings, outputs=("color", "result"))


def result(renderer):
    return renderer.render(chapters.view_of(renderer)).image("result")


def numbers(format):
    """Return texels that use every bit of a format: any code, any finite normal float, zeros and infinities."""
    rng, shape = np.random.default_rng(4), (SIZE[1], SIZE[0], 4)
    if format == "rgba8":
        return rng.integers(0, 256, shape, np.uint8) / 255.0
    kind = np.float16 if format == "rgba16f" else np.float32
    size = np.dtype(kind).itemsize * 8
    bits = rng.integers(0, 1 << size, shape, dtype=np.uint64).astype(BITS[format])
    values = bits.view(kind)
    # Of NaN only that it is one is kept, and whether numbers below the smallest normal one live is the device's choice.
    usual = np.isfinite(values) & (np.abs(values) >= np.finfo(kind).tiny)
    values = np.where(usual, values, kind(0.1))
    values[0, :4, 0] = 0.0, -0.0, np.inf, -np.inf
    return values


@chained
@pytest.mark.parametrize("format", BITS)
@pytest.mark.parametrize("copies", [1, 2, 3, 17])
def test_a_chain_of_copies_returns_its_input_bit_for_bit(stage, monkeypatch, format, copies):
    begun = numbers(format)
    with opened(
        stage, monkeypatch, original=begun, chain=[COPY] * copies, settings=Settings("none", 1, format)
    ) as renderer:
        for _ in range(3):
            found = result(renderer)
            assert (found.view(BITS[format]) == stored(begun, format).view(BITS[format])).all()
        assert renderer.render(chapters.view_of(renderer)).work["draws"] == copies + 1


@chained
@pytest.mark.parametrize("format", BITS)
def test_the_picture_is_the_result_and_codes_live_through_any_format(stage, monkeypatch, format):
    begun = numbers("rgba8")
    with opened(
        stage, monkeypatch, original=begun, chain=[COPY] * 2, settings=Settings("none", 1, format)
    ) as renderer:
        picture = renderer.render(chapters.view_of(renderer)).image("color")
    assert (picture == np.rint(255 * begun[..., :3])).all()


def blurred(values, times=1):
    """Return (H, W, 4) float64: the rows and columns of binomial weights, edges repeated."""
    for _ in range(times):
        for axis in (0, 1):
            wide = np.pad(values, [(2, 2) if one == axis else (0, 0) for one in range(3)], "edge")
            length = values.shape[axis]
            parts = [np.take(wide, range(i, i + length), axis) for i in range(5)]
            values = sum(w * part for w, part in zip(np.array([1, 4, 6, 4, 1]) / 16, parts, strict=True))
    return values


def truth(effect):
    """Return what a chain makes of its original, (H, W, 4) float64."""
    begun = original(SIZE)
    if effect == "blur":
        return blurred(begun, 4)
    if effect == "sharpen":
        sharp = 2.5 * begun - 1.5 * blurred(begun)
        sharp[..., 3] = 1.0
        return sharp
    light = begun[..., :3] @ np.array([0.2126, 0.7152, 0.0722])
    made = textures()["ramp"][0][np.floor(255 * light + 0.5).astype(int)] / 255
    made[..., 3] = 1.0
    return made


@chained
@pytest.mark.parametrize("effect", ["blur", "sharpen", "duotone"])
def test_effects_are_those_of_numpy(stage, monkeypatch, effect):
    with opened(stage, monkeypatch, settings=Settings(effect, 2, "rgba32f")) as renderer:
        frame = renderer.render(chapters.view_of(renderer))
        found, expected = frame.image("result"), truth(effect)
        off = np.abs(found - expected).max(axis=-1)
        if effect == "duotone":  # a light that is just between two colours may become either
            assert off.max() <= 1 / 255 and (off > 1e-6).mean() < 0.005
        else:
            assert off.max() <= 1e-6
        shown = 255 * np.clip(expected[..., :3], 0, 1)
        assert (
            np.abs(frame.image("color") - shown).max()
            <= codes_off(stage.device) + (effect == "duotone") + 1e-2
        )


@chained
def test_a_new_effect_with_textures_of_its_own_is_a_file_and_no_code(stage, monkeypatch, tmp_path):
    """Names decide, whatever their numbers; nothing of pipelines, layouts or sets is written for it."""
    (tmp_path / "mine.frag").write_text(
        "// Mine: picks from three textures.\n"
        "layout(BIND(0, 2, 2)) uniform sampler2D stripes;\n"
        "layout(BIND(0, 5, 4)) uniform sampler2D source;\n"
        "layout(BIND(0, 0, 1)) uniform sampler2D dots;\n"
        "layout(location = 0) out vec4 out_color;\n"
        "void main() {\n"
        "    ivec2 here = ivec2(gl_FragCoord.xy);\n"
        "    vec4 one = texelFetch(stripes, here % 4, 0), two = texelFetch(dots, here % 2, 0);\n"
        "    out_color = vec4(one.r, two.g, texelFetch(source, here, 0).b, float(SHADE) / 255.0);\n"
        "}\n"
    )
    rng = np.random.default_rng(5)
    mine = {"stripes": (4, 4), "dots": (2, 2), "unused": (1, 1)}
    mine = {name: rng.integers(0, 256, (*size, 4), np.uint8) for name, size in mine.items()}
    begun = numbers("rgba8")
    with opened(
        stage,
        monkeypatch,
        original=begun,
        textures=mine,
        chain=[COPY, Pass(str(tmp_path / "mine.frag"), (("SHADE", 9),)), COPY],
        settings=Settings("none", 1, "rgba8"),
    ) as renderer:
        found = result(renderer)
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    assert (found[..., 0] == mine["stripes"][y % 4, x % 4, 0]).all()
    assert (found[..., 1] == mine["dots"][y % 2, x % 2, 1]).all()
    assert (found[..., 2] == np.rint(255 * begun[..., 2])).all() and (found[..., 3] == 9).all()


@chained
def test_a_texture_that_nobody_has_is_a_sentence(stage, monkeypatch):
    with pytest.raises(
        UserError, match=r"duotone\.frag reads a texture 'ramp', which .*; did you mean 'ramps'\?"
    ):
        opened(stage, monkeypatch, chain=[Pass("duotone.frag")], textures={"ramps": textures()["ramp"]})
    with pytest.raises(UserError, match=r"does not have; known are 'original', 'source'\.$"):
        opened(stage, monkeypatch, chain=[Pass("duotone.frag")], textures={})


@chained
@pytest.mark.parametrize("stage", ["vulkan"], indirect=True, scope="module")
@pytest.mark.parametrize("copies", [1, 2, 5])
def test_two_targets_are_written_in_turn_and_one_pass_needs_only_one(stage, monkeypatch, copies):
    with views_made(stage.device) as images, opened(stage, monkeypatch, chain=[COPY] * copies) as renderer:
        calls = calls_of_a_frame(stage.device, renderer)
        views = [
            call.arguments[1].pColorAttachments[0].imageView
            for call in calls
            if call.name == "vkCmdBeginRendering"
        ]
        assert views[-1] == renderer.picture.view and len(views) == copies + 1
        written = views[:-1]
        assert len(set(written)) == min(copies, 2)
        assert all(one != other for one, other in itertools.pairwise(written))
        assert labels_of(calls)[1:] == ["copy.frag"] * copies
        assert len(renderer.pipelines) == 2  # one for the targets' format, one for the picture's
    assert not_waited_for(calls, images) == []


@chained
def test_another_size_gives_what_a_fresh_chain_gives(stage, monkeypatch):
    with opened(stage, monkeypatch, (9, 8), settings=Settings("sharpen")) as renderer:
        result(renderer)
        renderer.resize(SIZE)
        found = [result(renderer) for _ in range(3)]
    with opened(stage, monkeypatch, settings=Settings("sharpen")) as renderer:
        fresh = result(renderer)
    assert all((one == fresh).all() for one in found)


def test_every_effect_can_be_chosen(stage):
    pictures = {effect: stage.draw(WHICH, (48, 27), settings=Settings(effect))["color"] for effect in EFFECTS}
    shown = np.stack([one.ravel() for one in pictures.values()])
    assert len(np.unique(shown, axis=0)) == len(EFFECTS)
