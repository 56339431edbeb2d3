"""The study any-hit-alpha: the texels that rays go through against planes and the mask in float64, on every way."""

from __future__ import annotations

import numpy as np
import pytest

import chapters
from chapters.ch12.studies.any_hit_alpha import (
    FLOOR,
    GROUND,
    LEAVES,
    TEXELS,
    Settings,
    cards,
    mask,
    mask_words,
    meshes,
)
from common.errors import SettingError
from common.settings import apply_overrides
from tests.support.pixel_rays import pixel_rays

pytestmark = pytest.mark.feature("ray-tracing/any-hit-and-intersection")
WHICH, SIZE = "12/any-hit-alpha", (64, 48)
TO_LIGHT = np.array([0.4558, 0.7975, 0.3960])
FEW = 40
NONE = 0xFFFFFFFF


@pytest.fixture(params=["driver", "hierarchy"])
def without(request, stage):
    """What is switched off: nothing, or ray pipelines, which OpenGL does not have."""
    if request.param == "driver" and (stage.backend == "gl" or not stage.device.has("ray-tracing")):
        pytest.skip("no ray pipelines here")
    return ("ray-tracing",) if request.param == "hierarchy" and stage.backend == "vulkan" else ()


def drawn(stage, without=(), size=SIZE, **knobs):
    """Return what rays found (H, W), the picture, the counters, and the view."""
    settings = Settings(**{"leaves": FEW, **knobs})
    with stage.open(WHICH, size, settings=settings, without=without) as renderer:
        view = chapters.view_of(renderer)
        frame = renderer.render(view)
        return renderer.pixels(), frame.image("color"), frame.work, view


def meet(origins, along, whole=False):
    """Return of rays (N, 3) the nearest t, the surface (-1 none, -2 ground, else the card), the triangle, and how sure.

    A card is the plane through its corner 0 along its edges; the mask decides by the texel, or all of it is leaf.
    """
    corners = cards(Settings(leaves=FEW)).astype(np.float64)
    a, right, up = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0]
    normal = np.cross(right, up)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = ((a - origins[:, None]) * normal).sum(axis=2) / (along[:, None] * normal).sum(axis=2)
    inside = origins[:, None] + t[..., None] * along[:, None] - a
    uv = np.stack([(inside * edge).sum(axis=2) / (edge * edge).sum(axis=1) for edge in (right, up)], axis=2)
    on = (t > 0) & (uv >= 0).all(axis=2) & (uv < 1).all(axis=2)
    texel = np.clip(np.floor(uv * TEXELS), 0, TEXELS - 1)
    texel = np.where(np.isfinite(texel), texel, 0).astype(int)
    leaf = on & (whole | mask()[texel[..., 1], texel[..., 0]])
    grid = 1 if whole else TEXELS
    beside = np.abs(uv * grid - np.round(uv * grid)) < 5e-3
    near = (t > 0) & (uv > -0.02).all(axis=2) & (uv < 1.02).all(axis=2)
    grazing = np.abs((along[:, None] * normal).sum(axis=2)) < 0.03 * np.linalg.norm(normal, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        down = -origins[:, 1] / along[:, 1]
    at = origins + np.where(np.isfinite(down), down, 0)[:, None] * along
    floor = (down > 1e-6) & (np.abs(at[:, [0, 2]]) < GROUND).all(axis=1)
    every = np.concatenate([np.where(leaf, t, np.inf), np.where(floor, down, np.inf)[:, None]], axis=1)
    first, best = every.argmin(axis=1), every.min(axis=1)
    surface = np.where(np.isinf(best), -1, np.where(first == FEW, -2, first))
    at_uv = uv[np.arange(len(uv)), np.minimum(first, FEW - 1)]
    triangle = np.where(surface == -2, 0, 2 * np.maximum(surface, 0) + (at_uv[:, 1] > at_uv[:, 0]))
    doubt = ((beside.any(axis=2) | grazing) & near & (t <= best[:, None] + 1e-3)).any(axis=1)
    doubt |= (np.abs(np.abs(at[:, [0, 2]]) - GROUND) < 1e-2).any(axis=1)
    order = np.sort(every, axis=1)
    with np.errstate(invalid="ignore"):
        doubt |= order[:, 1] - order[:, 0] < 1e-4
    doubt |= (surface >= 0) & (np.abs(at_uv[:, 1] - at_uv[:, 0]) < 1e-4)
    return best, surface, triangle, ~doubt


def surfaces(found):
    """Return the same numbers of surfaces from what the shaders wrote."""
    instance, primitive = (
        found["what"][..., 0].ravel().astype(np.int64),
        found["what"][..., 1].ravel().astype(np.int64),
    )
    return np.where(instance == NONE, -1, np.where(instance == FLOOR, -2, primitive // 2))


@pytest.mark.parametrize("whole", [False, True])
def test_exactly_the_transparent_texels_are_removed(stage, without, whole):
    """With cards flagged opaque nothing is: rays stop at holes."""
    found, _, work, view = drawn(stage, without, opaque=whole)
    eye, along = pixel_rays(view, SIZE)
    t, surface, triangle, sure = meet(np.broadcast_to(eye, along.shape), along, whole)
    got = surfaces(found)
    assert sure.mean() > 0.85 and ((surface >= 0) & sure).sum() > 150
    assert (got == surface)[sure].all()
    cards_ = sure & (surface >= 0)
    assert (found["what"][..., 1].ravel() == triangle)[cards_].all()
    hit = sure & (surface != -1)
    assert np.abs(found["color"][..., 3].ravel() / t - 1)[hit].max() < 1e-5
    assert (work["asked"] > 0) == (not whole) and work["ignored"] <= work["asked"]
    other = meet(np.broadcast_to(eye, along.shape), along, not whole)[1]
    assert ((other != surface) & sure).sum() > 50, "the mask must matter in this picture"


def test_shadows_have_the_holes_of_the_leaves(stage, without):
    """Rays from the ground to the light, from the exact place on it."""
    found, _, _, view = drawn(stage, without)
    eye, along = pixel_rays(view, SIZE)
    t, surface, _, sure = meet(np.broadcast_to(eye, along.shape), along)
    ground = np.flatnonzero(sure & (surface == -2))
    places = eye + t[ground, None] * along[ground]
    places[:, 1] = 1e-4
    _, above, _, clear = meet(places, np.broadcast_to(TO_LIGHT, places.shape))
    lit = found["what"][..., 2].ravel()[ground]
    assert clear.sum() > 800 and ((above >= 0) & clear).sum() > 60
    assert (lit == (above == -1))[clear].all()
    whole = meet(places, np.broadcast_to(TO_LIGHT, places.shape), True)[1]
    assert ((whole >= 0) & (above == -1) & clear).sum() > 30, "light must fall through holes"


def test_the_shader_runs_only_for_what_is_not_opaque(stage, without):
    """A ray that meets no card does not ask, and a flag stops all questions."""
    asked, opaque = drawn(stage, without)[2], drawn(stage, without, opaque=True)[2]
    assert (opaque["asked"], opaque["ignored"]) == (0, 0) and asked["asked"] > asked["ignored"] > 0
    alone, _, work, _ = drawn(stage, without, leaves=1)
    assert 0 < work["asked"] < asked["asked"]
    assert work["asked"] - work["ignored"] >= (alone["what"][..., 0] == LEAVES).sum()


@pytest.mark.parametrize("stage", ["vulkan"], indirect=True, scope="module")
def test_both_ways_of_vulkan_find_the_same(stage):
    if not stage.device.has("ray-tracing"):
        pytest.skip("no ray pipelines here")
    there, here = (drawn(stage, without) for without in ((), ("ray-tracing",)))
    differ = (there[0]["what"] != here[0]["what"]).any(axis=-1)
    assert differ.mean() < 2e-3  # at edges of texels
    assert (np.abs(there[1].astype(int) - here[1]).max(axis=-1) > 1).mean() < 2e-3


def test_the_mask_is_a_leaf_and_its_words_are_its_bits():
    leaf = mask()
    assert 0.25 < leaf.mean() < 0.7 and not leaf[0].all() and leaf[2, TEXELS // 2]
    words = mask_words()
    for y, x in np.random.default_rng(3).integers(0, TEXELS, (200, 2)):
        bit = int(y) * TEXELS + int(x)
        assert bool(words[bit >> 5] >> np.uint32(bit & 31) & np.uint32(1)) == leaf[y, x]


def test_cards_are_squares_and_their_triangles_share_the_diagonal():
    corners = cards(Settings(leaves=FEW)).astype(np.float64)
    edges = np.roll(corners, -1, axis=1) - corners
    lengths = np.linalg.norm(edges, axis=2)
    assert np.abs(lengths / lengths[:, :1] - 1).max() < 1e-5
    assert np.abs((edges[:, 0] * edges[:, 1]).sum(axis=1) / lengths[:, 0] ** 2).max() < 1e-5
    (positions, indices), floor = meshes(Settings(leaves=FEW))
    assert (
        positions[indices.reshape(-1, 6)[:, [0, 2, 3, 4]]]
        == positions[indices.reshape(-1, 6)[:, [0, 2, 0, 2]]]
    ).all()
    assert len(indices) == 2 * FEW and floor[0][:, 1].tolist() == [0.0] * 4


@pytest.mark.parametrize("asked", ["leaves=0", "leaves=2001", "opaque=perhaps"])
def test_what_is_no_choice_is_refused_in_one_sentence(asked):
    with pytest.raises(SettingError, match=asked.partition("=")[0]) as found:
        apply_overrides(Settings(), [asked])
    assert "\n" not in str(found.value)
