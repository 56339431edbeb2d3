"""The study callables: blocks and materials against slabs in float64, and one picture on every way."""

from __future__ import annotations

import numpy as np
import pytest

import chapters
from backends.vulkan import api as vk
from chapters.ch12.pipelines.vulkan_rays import LIBRARY
from chapters.ch12.studies.callables import CALLABLES, MATERIALS, Settings, boxes, faces, triangles
from common.errors import SettingError, UnsupportedError
from common.settings import apply_overrides
from tests.support.pixel_rays import pixel_rays

WHICH, SIZE = "12/callables", (64, 48)
TO_LIGHT = np.array([0.2857, 0.8571, 0.4286])

pytestmark = [
    pytest.mark.feature("ray-tracing/callable-and-libraries"),
    pytest.mark.parametrize("stage", ["vulkan"], indirect=True, scope="module"),
]
"""Callables belong to ray pipelines, which OpenGL does not have."""


@pytest.fixture(autouse=True)
def _rays(stage):
    if not stage.device.has("ray-tracing"):
        pytest.skip("this device has no ray-tracing")


def drawn(stage, **knobs):
    """Return what rays found (H, W), the picture, and the view."""
    with stage.open(WHICH, SIZE, settings=Settings(**knobs)) as renderer:
        view = chapters.view_of(renderer)
        picture = renderer.render(view).image("color")
        return renderer.pixels(), picture, view


def looked_up(view):
    """Return t, the block (-1 none), the axis of the face and its side, and the place, of each pixel (N,): by slabs."""
    eye, along = pixel_rays(view, SIZE)
    corners = boxes()
    ends = np.sort((corners[None] - eye) / along[:, None, None], axis=2)
    near, far = ends[:, :, 0].max(axis=2), ends[:, :, 1].min(axis=2)
    t = np.where((near < far) & (near > 0), near, np.inf)
    block, best = t.argmin(axis=1), t.min(axis=1)
    axis = ends[np.arange(len(t)), block, 0].argmax(axis=1)
    side = -np.sign(along[np.arange(len(t)), axis])
    order = np.sort(t, axis=1)
    with np.errstate(invalid="ignore"):
        sure = (np.abs(near - far).min(axis=1) > 2e-3) & ~(order[:, 1] - order[:, 0] < 1e-4)
    place = eye + np.where(np.isfinite(best), best, 0)[:, None] * along
    return best, np.where(np.isfinite(best), block, -1), axis, side, place, sure


def colors_of(material, axis, place):
    """Return the colour (N, 3) of places by materials, and how far (N,) the nearest edge of a pattern is."""
    flat = np.stack([
        np.choose(axis, [place[:, 2], place[:, 0], place[:, 0]]),
        np.choose(axis, [place[:, 1], place[:, 2], place[:, 1]]),
    ], axis=1)  # fmt: skip

    def pick(inside, yes, no):
        return np.where(inside[:, None], yes, no)

    def edge(x):
        return np.abs(x - np.round(x))

    cell = flat * 8
    checks = (
        pick(np.floor(cell).sum(axis=1) % 2 < 0.5, (0.75, 0.72, 0.65), (0.12, 0.13, 0.16)),
        edge(cell).min(axis=1),
    )
    whole = flat * 2.5
    ring = np.linalg.norm(whole % 1 - 0.5, axis=1) * 5
    rings = (
        pick(ring % 1 < 0.5, (0.65, 0.12, 0.08), (0.85, 0.75, 0.55)),
        np.minimum(edge(2 * ring), edge(whole).min(axis=1)),
    )
    wave = np.abs(2 * (place.sum(axis=1) * 5 % 1) - 1)[:, None]
    stripes = (1 - wave) * (0.05, 0.2, 0.45) + wave * (0.3, 0.65, 0.8), np.ones(len(place))
    dots = flat * 9
    spot = ((dots % 1 - 0.5) ** 2).sum(axis=1)
    spots = (
        pick(spot < 0.09, (0.95, 0.8, 0.1), (0.1, 0.35, 0.12)),
        np.minimum(np.abs(spot - 0.09), edge(dots).min(axis=1)),
    )
    every = (checks, rings, stripes, spots)
    rows = np.arange(len(place))
    return np.stack([one for one, _ in every])[material, rows], np.stack([far for _, far in every])[
        material, rows
    ]


@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize("shading", ["callable", "inline"])
def test_each_hit_has_the_colour_of_its_material(stage, shading, first):
    found, _, view = drawn(stage, shading=shading, first=first)
    t, block, axis, side, place, sure = looked_up(view)
    got = found["color"].reshape(-1, 4).astype(np.float64)
    assert ((got[:, 3] >= 0) == (block >= 0))[sure].all() and sure.mean() > 0.7
    material = (np.maximum(block, 0) + first) % len(MATERIALS)
    color, far = colors_of(material, axis, place)
    light = 0.25 + 0.75 * np.maximum(side * TO_LIGHT[axis], 0)
    clear = sure & (block >= 0) & (far > 5e-3)
    assert np.abs(got[:, 3] / t - 1)[clear].max() < 1e-5
    assert np.abs(got[:, :3] - light[:, None] * color)[clear].max() < 1e-3
    seen = np.bincount(material[clear], minlength=len(MATERIALS))
    assert (seen > 40).all(), "every material is seen"
    other = colors_of((material + 1) % len(MATERIALS), axis, place)[0]
    assert (np.abs(got[:, :3] - light[:, None] * other)[clear].max(axis=1) > 0.05).mean() > 0.95


def test_callables_inline_code_and_libraries_are_one_picture(stage):
    """A compiler may contract a product and a sum in one of them: an edge of a pattern may move by a rounding."""
    expected, picture, _ = drawn(stage)
    for knobs in ({"shading": "inline"}, {"linked": True}, {"shading": "inline", "linked": True}):
        found, same, _ = drawn(stage, **knobs)
        differ = np.abs(found["color"] - expected["color"]).max(axis=-1) > 1e-5
        assert differ.mean() < 1e-3, knobs
        assert (np.abs(same.astype(int) - picture).max(axis=-1) > 1).mean() < 1e-3
    moved = drawn(stage, first=1)[0]["color"]
    assert (np.abs(moved - expected["color"]).max(axis=-1) > 0.05).mean() > 0.3


@pytest.mark.parametrize("linked", [False, True])
@pytest.mark.parametrize("shading", ["callable", "inline"])
def test_the_table_has_a_record_for_each_material(stage, shading, linked):
    """Without callables the fourth region is empty. A linked pipeline has a library for each group."""
    if linked and LIBRARY not in stage.device.extensions:
        pytest.skip(f"this device has no {LIBRARY}")
    log = []
    stage.device.fn.trace(log)
    try:
        with stage.open(WHICH, SIZE, settings=Settings(shading=shading, linked=linked)) as renderer:
            region = renderer._trace.table.arguments[3]
            records = region.size // region.stride if region.size else 0
    finally:
        stage.device.fn.trace(None)
    assert records == (len(MATERIALS) if shading == "callable" else 0)
    calls = [arguments for name, arguments in log if name == "vkCreateRayTracingPipelinesKHR"]
    libraries = [bool(one[4][0].flags & vk.VK_PIPELINE_CREATE_LIBRARY_BIT_KHR) for one in calls]
    assert libraries == ([True] * (3 + records) if linked else []) + [False]


def test_without_ray_tracing_a_sentence_says_so(stage):
    with pytest.raises(UnsupportedError, match=r"callables needs ray-tracing, but .* --without") as found:
        stage.open(WHICH, SIZE, without=["ray-tracing"])
    assert "\n" not in str(found.value)


def test_faces_look_outwards_and_materials_take_turns(stage):
    positions, indices = triangles()
    rows, corners = faces(Settings()), positions.astype(np.float64)[indices]
    middle = np.repeat(boxes().mean(axis=1), 12, axis=0)
    assert (((corners.mean(axis=1) - middle) * rows[:, :3]).sum(axis=1) > 0).all()
    assert (rows[:, 3] == np.arange(len(rows)) // 12 % 4).all() and len(CALLABLES) == len(MATERIALS)


@pytest.mark.parametrize("asked", ["shading=both", "first=4", "linked=2"])
def test_what_is_no_choice_is_refused_in_one_sentence(stage, asked):
    with pytest.raises(SettingError, match=asked.partition("=")[0]) as found:
        apply_overrides(Settings(), [asked])
    assert "\n" not in str(found.value)
