"""The studies names, barriers and memory: one picture, an order from names, no barrier too few, and less memory."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

import chapters
from chapters.ch04.studies.glow import PASSES, passes
from chapters.ch04.studies.names import Settings, frame
from tests.support.frame_calls import calls_of_a_frame, not_waited_for, views_made
from tests.support.hazards import Barriers, find_hazards
from tests.support.kernel_calls import events_of, use

only_vulkan = pytest.mark.parametrize("stage", ["vulkan"], indirect=True, scope="module")
SIZE = (45, 30)
STEPS = ("4/names", "4/barriers", "4/memory")
REFERENCE_RADIUS, REFERENCE_SIGMA = 12, 5.0


def drawn(stage, which, size=SIZE, **settings):
    kind = chapters.settings_class(which)
    with stage.open(which, size, settings=kind(**settings)) as renderer:
        view = chapters.view_of(renderer)
        pictures = []
        for _ in range(3):
            shown = renderer.render(view)
            pictures.append(shown.image("color"))
        assert all((pictures[0] == other).all() for other in pictures)
        return pictures[0], shown.work


def expected(size):
    """Return the picture of the frame in float64, (H, W, 3) codes: each formula of the shaders, without rounding."""
    width, height = size
    x, y = np.meshgrid((np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height)
    light = (1 - y[..., None]) * [0.02, 0.03, 0.08] + y[..., None] * [0.10, 0.05, 0.06]
    for i in range(7):
        away = np.hypot((x - 0.14 - 0.12 * i) * 1.5, y - 0.5 - 0.28 * np.sin(2.1 * i))[..., None]
        color = 0.5 + 0.5 * np.cos(np.array([0.0, 2.1, 4.2]) + i)
        light = light + 4.0 * color * np.clip((0.030 - away) / 0.006, 0, 1)
        light = light + 0.15 * color * np.clip((0.006 - np.abs(away - 0.07)) / 0.006, 0, 1)
    above = np.maximum(light - 1, 0)
    half = (max(1, round(height / 2)), max(1, round(width / 2)))
    rows = [np.minimum(2 * np.arange(half[0]) + i, height - 1) for i in (0, 1)]
    columns = [np.minimum(2 * np.arange(half[1]) + i, width - 1) for i in (0, 1)]
    halo = sum(above[r][:, c] for r in rows for c in columns) / 4
    offsets = np.arange(-REFERENCE_RADIUS, REFERENCE_RADIUS + 1)
    weights = np.exp(-0.5 * (offsets / REFERENCE_SIGMA) ** 2)
    for axis in (1, 0):
        last = halo.shape[axis] - 1
        halo = sum(
            w * np.take(halo, np.clip(np.arange(last + 1) + o, 0, last), axis)
            for w, o in zip(weights / weights.sum(), offsets, strict=True)
        )
    near = halo[np.minimum(np.arange(height) // 2, half[0] - 1)][
        :, np.minimum(np.arange(width) // 2, half[1] - 1)
    ]
    total = light + 3 * near
    shown = total / (1 + total)
    return 255 * np.where(shown <= 0.0031308, 12.92 * shown, 1.055 * shown ** (1 / 2.4) - 0.055)


@pytest.mark.parametrize("size", [SIZE, (64, 41)])
def test_the_picture_is_that_of_the_formulas(stage, size):
    """Half floats round four times: 4 x 2^-11 of the light, and x / (1 + x) as code has a slope below 1 / x: 0.3."""
    off = np.abs(drawn(stage, "4/names", size)[0] - expected(size))
    assert off.max() <= 0.5 + 255 * 4 / 2048
    assert np.percentile(off, 99) <= 0.8


def test_each_step_draws_the_same_picture(stage):
    first, *others = [
        drawn(stage, which)[0] for which in STEPS if stage.backend == "vulkan" or which != "4/barriers"
    ]
    assert all((first == other).all() for other in others)


# --- names ------------------------------------------------------------------------------------------------------------


@pytest.mark.feature("frame-graph/edges")
def test_the_order_follows_from_the_names_however_they_are_declared():
    orders = {tuple(frame(Settings(shuffle=seed))[0]) for seed in range(50)}
    (only,) = orders
    written: set[str] = set()
    for name in only:
        assert {*PASSES.get(name, passes()["show"]).reads} <= written
        written.add(passes()[name].writes)


@pytest.mark.parametrize(
    ("shown", "left_out"), [("glow", {"outline"}), ("outline", {"bright", "across", "down", "combine"})]
)
def test_a_pass_whose_result_is_not_shown_is_left_out(stage, shown, left_out):
    ordered, wiring = frame(Settings(show=shown))
    assert {*wiring.left_out} == left_out == {*passes()} - {*ordered}
    picture, work = drawn(stage, "4/names", show=shown, shuffle=5)
    assert (work["passes"], work["draws"], work["passes_skipped"]) == (
        len(ordered),
        len(ordered),
        len(left_out),
    )
    assert (picture == drawn(stage, "4/names", show=shown)[0]).all()


def test_the_outline_is_another_picture(stage):
    assert (drawn(stage, "4/names", show="outline")[0] != drawn(stage, "4/names")[0]).any()


# --- barriers ---------------------------------------------------------------------------------------------------------


def uses(names):
    """Return what each pass does with each image, as the hazard checker reads it."""
    found = {}
    for name in names:
        described = passes()[name]
        found[name] = [use(name, one, "fragment sampled", layout="read") for one in described.reads]
        if described.writes:
            found[name].append(use(name, described.writes, "color color_write", layout="color", fresh=True))
    return found


def recorded(stage, which, **settings):
    """Return the events of five frames, and the places of the images in memory."""
    with stage.open(which, SIZE, settings=chapters.settings_class(which)(**settings)) as renderer:
        view = chapters.view_of(renderer)
        images = renderer._images
        own = {
            name: image for name, image in images.items() if name in {one.writes for one in PASSES.values()}
        }
        events = events_of(renderer, lambda _: renderer.render(view), uses(renderer._order), images=own)
        graph = renderer.graph
        at = {n: (p.heap, p.offset, p.offset + p.size) for n, p in graph.memory.places.items()}
    return events, at


@pytest.mark.feature("frame-graph/barriers")
@pytest.mark.parametrize("which", ["4/barriers", "4/memory"])
@only_vulkan
def test_no_barrier_is_missing_and_none_too_many(stage, which):
    """Without one of them, an access is not synchronised."""
    events, at = recorded(stage, which)
    assert find_hazards(events, at) == []
    calls = {event for event in events if isinstance(event, Barriers)}
    for call in calls:
        for one in (one for one in call.dependencies if "host" not in one.second_stages):
            rest = Barriers(tuple(other for other in call.dependencies if other != one), call.queue)
            assert find_hazards([rest if event == call else event for event in events], at) != [], one


@only_vulkan
def test_a_barrier_for_everything_draws_the_same_and_there_are_more(stage):
    needed, work = drawn(stage, "4/barriers")
    everything, more = drawn(stage, "4/barriers", wait="everything")
    assert (needed == everything).all()
    assert more["barriers"] == work["barriers"] + work["passes"]


@pytest.mark.parametrize("which", STEPS[1:])
@only_vulkan
def test_every_target_is_waited_for(stage, which):
    with views_made(stage.device) as images, stage.open(which, SIZE) as renderer:
        calls = calls_of_a_frame(stage.device, renderer)
    assert not_waited_for(calls, images) == []


# --- memory -----------------------------------------------------------------------------------------------------------


@pytest.mark.feature("frame-graph/resource-aliasing")
def test_shared_memory_is_smaller_and_the_picture_the_same(stage):
    shared, work = drawn(stage, "4/memory")
    alone, more = drawn(stage, "4/memory", share=False)
    assert (shared == alone).all()
    assert work["transient_bytes"] < work["transient_bytes_alone"] == more["transient_bytes_alone"]
    assert more["transient_bytes"] >= more["transient_bytes_alone"]


@only_vulkan
def test_images_of_one_step_share_no_byte(stage):
    with stage.open("4/memory", SIZE) as renderer:
        memory = renderer.graph.memory
    for heap in range(len(memory.heaps)):
        inside = [name for name, place in memory.places.items() if place.heap == heap]
        for step in range(1 + max(last for _, last in memory.lives.values())):
            alive = [n for n in inside if memory.lives[n][0] <= step <= memory.lives[n][1]]
            ranges = sorted((memory.places[n].offset, memory.places[n].size) for n in alive)
            assert all(offset + size <= after for (offset, size), (after, _) in pairwise(ranges))
