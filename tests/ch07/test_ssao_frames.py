"""Ambient occlusion in frames: planes, the float64 twin, the blur, what it dims, and what it costs when it is off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from backends.contract import Access
from chapters.ch07.pipelines.description import PipelineDescription
from chapters.ch07.post.fullscreen import FullscreenPass
from chapters.ch07.settings import Settings
from chapters.ch07.ssao import model
from common.errors import UserError
from common.scene import Material
from common.settings import replaced
from common.view.camera import Orthographic, Perspective
from tests.support.bounds import codes_off
from tests.support.jumble import CAMERA, jumble
from tests.support.occluded import (
    ACROSS,
    EYE_VIEW,
    FLAT_VIEW,
    METHODS,
    RAW,
    RESULT,
    STEP,
    codes,
    room,
    slanted,
)
from tests.support.scenes import facing, moved, quad_scene, scaled, translated
from tests.twins import ambient_occlusion as twin

pytestmark = pytest.mark.variants("vulkan", "gl")

SIZE = (48, 32)
BASE = Settings(ambient=0.5, anisotropy=1.0, graph="deferred", tone_curve="none", ssao_radius=0.15)
OUTPUTS = {"color", "color_linear", "depth"}


@pytest.fixture
def open_(chapter):
    """Return a function that opens a renderer with inspected passes, closed at the end."""
    opened = []

    def open_renderer(scene, size=SIZE, inspect=True, **turned):
        settings = replaced(BASE, **turned)
        opened.append(chapter.open(scene, size, settings, outputs=OUTPUTS, inspect=inspect))
        return opened[-1]

    yield open_renderer
    for renderer in opened:
        renderer.close()


def linear(frame):
    return frame.image("color_linear").astype(np.float64)[..., :3]


# --- planes ---


@pytest.mark.feature("ssao/depth-only")
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    "projection", [Perspective(0.8, 0.1), Orthographic(1.0, 0.1, 9.0)], ids=["eye", "flat"]
)
def test_a_plane_that_faces_the_eye_is_lit_in_full_and_so_is_the_sky(open_, method, projection):
    """A square before the sky: depth 0 behind it divides nothing, occludes nothing and is not occluded."""
    view = replace(facing(4.0), projection=projection)
    frame = open_(quad_scene(Material()), ssao=method).render(view)
    sky = frame.image("depth") == 0
    assert 0.2 < sky.mean() < 0.9
    for name in (RAW, ACROSS, RESULT):
        assert (codes(frame, name) == 255).all()
    assert np.isfinite(linear(frame)).all()


@pytest.mark.feature("ssao/depth-only")
@pytest.mark.parametrize("view", [facing(9.0, 2.0), replace(facing(9.0), projection=Perspective(0.6, 0.05))])
def test_rays_of_a_normal_find_no_occluder_on_a_slanted_plane(open_, view):
    """Depth alone takes the nearer half of any slope for occluders; rays above the surface's plane do not."""
    scene = slanted()
    found = codes(open_(scene, ssao="normals", ssao_radius=0.05).render(view), RESULT)
    assert (found == 255).all()
    assert codes(open_(scene, ssao="depth", ssao_radius=0.05).render(view), RAW).mean() < 230


@pytest.mark.feature("ssao/depth-only")
def test_light_along_a_wall_falls_to_half_as_it_does_in_closed_form(open_):
    """The foot of a long wall sees half of a hemisphere; far from the wall, beyond the radius, all of it."""
    scene = room()
    radius = 0.15 * scene.length_scale
    renderer = open_(scene, (64, 48), ssao="normals")
    frame = renderer.render(EYE_VIEW)
    found, depth = codes(frame, RAW) * STEP, frame.image("depth").astype(np.float64)
    inverse = np.linalg.inv(EYE_VIEW.clip_from_view(64 / 48))
    x, y = np.meshgrid((np.arange(64) + 0.5) / 32 - 1, (np.arange(48) + 0.5) / 24 - 1)
    places = np.stack([x, y, depth, np.ones_like(depth)], axis=-1) @ inverse.T
    places = (places / places[..., 3:]) @ EYE_VIEW.world_from_view.T
    floor = (np.abs(places[..., 1]) < 1e-3) & (np.abs(places[..., 0]) < 2)
    away = places[..., 2] / radius
    far, foot = floor & (away > 1.1) & (places[..., 2] < 3), floor & (away > 0.02) & (away < 0.15)
    assert far.sum() > 100 and foot.sum() > 20
    assert (found[far] == 1).all()
    # Of rays with a density of cos / pi, those that meet x = -a within a radius of 1: an integral over the hemisphere.
    rng = np.random.default_rng(2)
    squared, turn = rng.random(200_000), 2 * np.pi * rng.random(200_000)
    towards = np.sqrt(squared) * np.cos(turn)
    for low, high in ((0.02, 0.15), (0.15, 0.4), (0.4, 0.8)):
        band = floor & (away > low) & (away < high)
        truth = np.mean([(towards < a).mean() for a in away[band]])
        # Eight rays in sixteen turns leave a mean well within 0.02; four points on each ray miss some of the wall.
        assert truth - 0.03 < found[band].mean() < truth + 0.1, (low, high)


# --- the whole estimate, and the blur ---


@pytest.mark.feature("ssao/depth-only", "ssao/rotation-pattern")
@pytest.mark.parametrize("view", [CAMERA, replace(CAMERA, projection=Orthographic(1.6, 0.1, 9.0))])
def test_the_estimate_from_depth_is_that_of_its_twin(open_, view):
    scene = jumble(3)
    frame = open_(scene, ssao="depth").render(view)
    depth = frame.image("depth")
    clip = view.clip_from_view(SIZE[0] / SIZE[1])
    truth = twin.from_depth(depth, clip, 0.15 * scene.length_scale)
    found = codes(frame, RAW) * STEP
    assert truth.std() > 0.05
    # A sample on the border of two pixels may be read in either: of 8 x 1536 samples few are within a rounding of one.
    assert (np.abs(found - truth) > STEP).mean() < 0.005


@pytest.mark.long
@pytest.mark.feature("postprocess/separable-blur")
@pytest.mark.parametrize("method", [METHODS[0], pytest.param(METHODS[1], marks=pytest.mark.long)])
@pytest.mark.parametrize("view", [EYE_VIEW, FLAT_VIEW], ids=["eye", "flat"])
def test_the_blur_is_that_of_its_twin_at_edges_too(open_, chapter, method, view):
    scene = room(translated(0.5, 0.8, 1.2))
    frame = open_(scene, ssao=method).render(view)
    depth, clip = frame.image("depth"), view.clip_from_view(SIZE[0] / SIZE[1])
    tolerance = model.BLUR_TOLERANCE * 0.15 * scene.length_scale
    for source, target, axis in ((RAW, ACROSS, 1), (ACROSS, RESULT, 0)):
        before, after = codes(frame, source) * STEP, codes(frame, target) * STEP
        truth = twin.blurred(before, depth, clip, tolerance, axis)
        assert np.abs(truth - before).max() > 0.05
        # A rounding to a step; and a slope whose two sides are equal but for rounding may be that of either.
        rounding = (codes_off(chapter.device) + 0.01) * STEP
        assert (np.abs(after - truth) > rounding).mean() < 0.005
    nearer = depth > np.roll(depth, 1, axis=1) * 1.05
    assert nearer.any(), "there are edges"


IMPULSE = """
layout(location = 0) out float out_visibility;
layout(BIND(1, 0, 3)) uniform sampler2D depth;
void main() {
    bool there = ivec2(gl_FragCoord.xy) == ivec2(24, 16);
    out_visibility = FLAT > 0.0 ? FLAT : there ? 1.0 : 0.0;
}
"""


@pytest.mark.feature("postprocess/separable-blur")
@pytest.mark.parametrize("scene", ["facing", "slanted"])
def test_an_impulse_becomes_the_kernel_and_constants_stay(open_, chapter, tmp_path, scene):
    """On a plane every tap counts, also where the plane recedes; the picture's edge loses none of a constant.

    A tap of 11.504 may become the code 11 on a GPU: software drivers alone round to the nearest.
    """
    rounding = codes_off(chapter.device) + 1e-3
    view = replace(facing(9.0), projection=Perspective(0.6, 0.05))
    shown = slanted() if scene == "slanted" else quad_scene(Material(), matrices=(np.diag((9.0, 9, 1, 1)),))
    renderer = open_(shown, ssao="depth")
    file = tmp_path / "impulse.frag"
    file.write_text(IMPULSE, "utf-8")

    class Impulse(FullscreenPass):
        name = "ssao"
        reads = (Access("depth", "sampled"),)
        writes = (Access(model.RAW, "color", format=model.FORMAT),)
        value = 0.0

        def describe(self):
            return PipelineDescription(
                shaders=("post/fullscreen.vert", str(file)),
                defines=(("FLAT", self.value),),
                color=model.FORMAT,
                depth=None,
                name=f"impulse {self.value}",
            )

    class Constant(Impulse):
        value = 100.0 / 255.0

    renderer.swap_pass("ssao", renderer.make_pass(Impulse))
    frame = renderer.render(view)
    assert codes(frame, RAW).sum() == 255 == codes(frame, RAW)[16, 24]
    line = np.zeros(SIZE[0])
    line[19:30] = 255 * twin.BINOMIAL
    across = codes(frame, ACROSS)
    assert np.abs(across[16] - line).max() <= rounding and across.sum() == across[16].sum()
    # Rounded once more: the column through the impulse is the kernel of what stands there.
    column = across[16, 24] * twin.BINOMIAL
    assert np.abs(codes(frame, RESULT)[11:22, 24] - column).max() <= rounding
    assert codes(frame, RESULT)[:11].max() == 0
    renderer.swap_pass("ssao", renderer.make_pass(Constant))
    frame = renderer.render(view)
    assert (codes(frame, RESULT) == 100).all()


# --- what it dims ---


@pytest.mark.feature("ssao/combine")
@pytest.mark.parametrize(("graph", "method"), [("deferred", "depth"), ("compute", "normals")])
def test_occlusion_dims_light_from_everywhere_and_nothing_else(open_, method, graph):
    """The picture with occlusion is the one without, less the occluded part of what ambient light alone adds to it.

    Lamps and emission stay, unlit surfaces too; the materials' own occlusion is a factor of both.
    """
    kinds = jumble(3).materials
    solid = tuple(kind for kind in kinds if kind.alpha_mode != "blend")
    scene = jumble(3, solid)
    exact = {"graph": graph, "color_format": "rgba32f", "gbuffer_format": "full"}
    dimmed = open_(scene, ssao=method, ssao_scale=0.8, ssao_bias=0.1, **exact).render(CAMERA)
    plain, dark = (
        linear(open_(scene, inspect=False, ambient=ambient, **exact).render(CAMERA)) for ambient in (0.5, 0.0)
    )
    bias = 0.1 if method == "depth" else 0.0
    visible = np.clip(codes(dimmed, RESULT) * STEP + bias, 0, 1)[..., None]
    truth = dark + (1 - 0.8 * (1 - visible)) * (plain - dark)
    assert np.abs(linear(dimmed) - truth).max() < 2e-5 * plain.max()
    assert np.abs(linear(dimmed) - plain).max() > 0.02


@pytest.mark.feature("ssao/depth-only", "ssao/combine")
def test_what_has_nothing_to_dim_makes_nothing_and_shows_the_same_bits(open_):
    """Off, with scale or radius 0, without light from everywhere, in a scene of nothing, in a view of a quantity."""
    scene = jumble(3)

    def parts(renderer):
        work = renderer.render(CAMERA).work
        assert not {step.name for step in renderer.graph.steps} & {"ssao", "ssao_blur_x", "ssao_blur"}
        assert not [name for name in renderer.graph.resources if "occlusion" in name]
        return len(renderer.graph.steps), len(renderer.graph.resources), work["pipelines"]

    plain = open_(scene, inspect=False)
    made, before = parts(plain), linear(plain.render(CAMERA))
    for turned in ({"ssao_scale": 0.0}, {"ssao_radius": 0.0}):
        renderer = open_(scene, inspect=False, ssao="normals", **turned)
        assert parts(renderer) == made
        assert np.array_equal(linear(renderer.render(CAMERA)), before)
    dark = open_(scene, inspect=False, ssao="depth", ambient=0.0)
    assert parts(dark)[0] == made[0]
    parts(open_(quad_scene(matrices=()), inspect=False, ssao="depth"))
    parts(open_(scene, inspect=False, ssao="depth", view="normal", graph="auto"))
    occluded = open_(scene, inspect=False, ssao="depth")
    assert not np.array_equal(linear(occluded.render(CAMERA)), before)
    assert len(occluded.graph.steps) == made[0] + 3
    # Once the estimate is 1 everywhere, dimmed light is the light itself.
    square = quad_scene(Material())
    lit, with_occlusion = (
        linear(open_(square, inspect=False, ssao=ssao).render(facing(4.0))) for ssao in ("off", "depth")
    )
    assert np.array_equal(lit, with_occlusion)


@pytest.mark.long
def test_without_the_blur_light_reads_the_estimate(open_):
    scene = jumble(3)
    blurred, raw = (open_(scene, inspect=False, ssao="depth", ssao_blur=blur) for blur in (True, False))
    wanted = linear(raw.render(CAMERA))
    assert len(blurred.graph.steps) == len(raw.graph.steps) + 2
    assert not np.array_equal(linear(blurred.render(CAMERA)), wanted)
    blurred.switch_pass("ssao_blur", False)
    assert np.array_equal(linear(blurred.render(CAMERA)), wanted)
    assert len(blurred.graph.steps) == len(raw.graph.steps), "half a blur is none"


@pytest.mark.feature("ssao/depth-only")
def test_a_graph_that_lights_while_it_draws_says_so(open_):
    for turned in (
        {"graph": "forward"},
        {"graph": "auto", "msaa": 4},
        {"graph": "auto", "culling_overlay": "boxes"},
    ):
        with pytest.raises(
            UserError, match=r"forward\.json .* ssao=depth needs .*: set graph=deferred and msaa=1"
        ):
            open_(jumble(3), ssao="depth", **turned)


# --- stability ---


@pytest.mark.parametrize("method", [METHODS[0], pytest.param(METHODS[1], marks=pytest.mark.long)])
def test_the_result_is_that_of_a_scene_of_any_size_anywhere(open_, method):
    """Lengths are parts of the scene's own. A rounding moves a sample to the next pixel in few places."""
    scene = jumble(3)
    wanted = codes(open_(scene, ssao=method).render(CAMERA), RAW)
    for other, view in (
        scaled(scene, CAMERA, 1e-3),
        scaled(scene, CAMERA, 1e3),
        moved(scene, CAMERA, (1e5, -1e5, 1e5)),
    ):
        found = codes(open_(other, ssao=method).render(view), RAW)
        assert (np.abs(found - wanted) > 1).mean() < 0.01


@pytest.mark.long
@pytest.mark.parametrize("method", [METHODS[0], pytest.param(METHODS[1], marks=pytest.mark.long)])
def test_any_size_and_any_radius_give_numbers(open_, method):
    scene = jumble(3)
    for radius in (1e-6, 10.0):
        renderer = open_(scene, (1, 1), ssao=method, ssao_radius=radius)
        for size in ((1, 1), (17, 9)):
            renderer.resize(size)
            for view in (CAMERA, replace(CAMERA, projection=Perspective(2.8, 1e-4))):
                frame = renderer.render(view)
                assert codes(frame, RESULT).shape == size[::-1]
                assert np.isfinite(linear(frame)).all()


@pytest.mark.long
@pytest.mark.parametrize("method", [METHODS[0], pytest.param(METHODS[1], marks=pytest.mark.long)])
def test_culling_poison_and_submitting_again_change_no_bit(open_, method):
    scene = jumble(3)
    plain = open_(scene, inspect=False, ssao=method, culling="off")
    wanted = linear(plain.render(CAMERA))
    for turned in ({"culling": "occlusion"}, {"poison": "depth 1", "depth_prepass": True}):
        renderer = open_(scene, inspect=False, ssao=method, **turned)
        frames = [renderer.render(CAMERA) for _ in range(4)]
        names = [step.name for step in renderer.graph.steps]
        assert "culling" not in turned or names.index("gbuffer_late") < names.index("ssao")
        assert np.array_equal(linear(frames[-1]), wanted), turned
        assert [frame.work["recorded"] for frame in frames][2:] == [0, 0]
