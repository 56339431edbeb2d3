"""Histories of a frame graph that another graph of the same stream continues, and recordings that wait meanwhile."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from chapters.ch11.graph.memory.images import ImagesInSlots
from chapters.ch11.graph.types import PREVIOUS
from chapters.ch11.settings import Settings
from common.settings import replaced
from tests.support.shadows import point, yard
from tests.support.taa import FULL, SIZE, VIEW, court, light, opened

pytestmark = pytest.mark.variants("vulkan", "gl")
BASE = Settings(**{**FULL, "taa_scale": 0.67})
HISTORIES = ("history_color", "history_weight")


def lent(renderer, **more):
    """Let the renderer draw with a second executor that continues the histories of the first; return both."""
    api, first = renderer._api, renderer._api.executor
    renderer._let_go("test")
    kept = api.copies, api.inspection, api.frames.exchange()
    api.copies = type(api.copies)(renderer.device)
    api.copies.also = kept[0].also
    graph = renderer._plan.compile(
        renderer.size, renderer.scene, replaced(renderer._settings, **more), api.requirement, True, api.queues
    )
    api.follow(renderer._plan, graph, renderer._settings, first.images)
    renderer.graph = graph
    return first, api.executor, kept


def free(renderer, executor, kept):
    copies, inspection, recordings = kept
    renderer._let_go("test")
    renderer._api.frames.discard(recordings)
    for it in (copies, inspection, executor):
        it.close()


def test_a_second_graph_continues_histories_as_if_there_were_one(chapter):
    """Bit for bit what one graph draws, and the images outlive the graph that made them."""
    with opened(chapter, BASE, court()) as renderer:
        truth = [light(renderer.render(VIEW)) for _ in range(5)]
    with opened(chapter, BASE, court()) as renderer:
        found = [light(renderer.render(VIEW)) for _ in range(2)]
        first, second, kept = lent(renderer)
        assert second.images.borrowed == {*HISTORIES}
        for name in HISTORIES:
            for slot in (0, 1):
                assert second.images.image(slot, name) is first.images.image(slot, name)
                assert second.images.image(slot, name + PREVIOUS) is first.images.image(1 - slot, name)
        assert second.images.image(0, "color_hdr") is not first.images.image(0, "color_hdr")
        found += [light(renderer.render(VIEW))]
        second.images.own(first.images)
        free(renderer, first, kept)
        found += [light(renderer.render(VIEW)) for _ in range(2)]
    assert np.array_equal(found, truth)


def test_a_history_of_another_format_is_not_lent(chapter):
    with opened(chapter, BASE, court()) as renderer:
        renderer.render(VIEW)
        images = renderer._api.executor.images
        graph, name = renderer.graph, "history_color"
        resource = graph.resources[name]
        borrower = type(images).__new__(type(images))
        borrower.graph = graph
        assert borrower.borrow(resource, images) == [images.image(slot, name) for slot in (0, 1)]
        assert borrower.borrowed == {name}
        for other in (replace(resource, format="rgba16f"), replace(resource, size=(8, 8))):
            assert borrower.borrow(other, images) == []
        assert borrower.borrow(resource, None) == []
        # A graph that leaves the history in another state: it has no barrier of it at all.
        borrower.graph = replace(graph, prologue=(), epilogue=(), steps=())
        assert borrower.borrow(resource, images) == []


def test_images_are_freed_by_one_owner_alone():
    """Objects that a graph does not use stay with their owner."""

    def images(*objects, used):
        it = ImagesInSlots()
        it._objects, it.in_slot = list(objects), [dict(enumerate(used))] * 2
        return it

    shared, own, other = (SimpleNamespace(name=name) for name in ("shared", "own", "other"))
    lender, borrower = images(shared, own, used=[shared, own]), images(other, used=[shared, other])
    borrower.own(lender)
    assert (lender._objects, borrower._objects) == ([own], [other, shared])
    borrower.own(lender)
    assert (lender._objects, borrower._objects) == ([own], [other, shared])


def test_recordings_wait_while_another_graph_draws(chapter):
    with opened(chapter, BASE, court()) as renderer:
        for _ in range(2):
            assert renderer.render(VIEW).work["recorded"] == 1
        assert renderer.render(VIEW).work["recorded"] == 0
        first, second, kept = lent(renderer)
        for _ in range(2):
            assert renderer.render(VIEW).work["recorded"] == 1
        renderer._let_go("test")
        mine = renderer._api.copies, renderer._api.inspection, renderer._api.frames.exchange(kept[2])
        renderer._api.copies, renderer._api.inspection = kept[:2]
        renderer._api.executor = first
        for _ in range(2):
            assert renderer.render(VIEW).work["recorded"] == 0
        forgotten = renderer._api.frames.forgotten
        renderer._api.frames.forget()
        assert renderer._api.frames.forgotten == forgotten + 1
        assert renderer.render(VIEW).work["recorded"] == 1
        free(renderer, second, mine)


def test_light_lists_have_room_for_the_picture_at_each_scale(chapter):
    """So a change of the drawn size alone makes no buffer; tests hold the lists themselves to brute force."""
    lamps = [point((-1.2 + 0.3 * number, 3.0, 0.8), candela=6.0) for number in range(9)]
    pictures = {}
    for lists in ("clusters", "brute"):
        with opened(chapter, BASE, yard(*lamps), light_lists=lists) as renderer:
            pictures[lists] = light(renderer.render(VIEW))
            technique = renderer.techniques["clusters"]
            assert technique._pass.layout.size == (27, 20) and technique._whole.size == SIZE
            assert technique._pass.layout.words <= technique._whole.words
            buffer = renderer._data.light_lists
            renderer.settings = replaced(renderer.settings, taa_scale=0.9)
            renderer.render(VIEW)
            assert technique._pass.layout.size == (36, 27) and renderer._data.light_lists is buffer
    assert np.array_equal(pictures["clusters"], pictures["brute"])


@pytest.mark.variants("vulkan")
def test_only_new_images_are_brought_into_a_state_before_the_first_frame(chapter, monkeypatch):
    """A borrowed history has contents, which a transition from nothing may discard; software drivers keep them."""
    from chapters.ch11.graph.execute import vulkan
    from chapters.ch11.graph.types import UNTOUCHED

    begun = []
    real = vulkan.dependency

    def noted(planned, *more):
        planned = list(planned)
        begun.append({it.resource for it in planned if it.before == UNTOUCHED})
        return real(planned, *more)

    monkeypatch.setattr(vulkan, "dependency", noted)
    with opened(chapter, BASE, court()) as renderer:
        names = {name + PREVIOUS for name in HISTORIES}
        assert names <= set().union(*begun)
        begun.clear()
        first, second, kept = lent(renderer)
        assert begun and not names & set().union(*begun)
        second.images.own(first.images)
        free(renderer, first, kept)
