"""Requests for textures without any API: exactly once, in order, bounded, cancelled in every state, failing alone."""

from __future__ import annotations

import os
import threading
import time
from functools import partial

import numpy as np
import pytest

from chapters.ch03.benches import scene as bench_scene
from chapters.ch03.loading.importance import material_sizes
from chapters.ch03.loading.loading import (
    AHEAD,
    MOST_AHEAD,
    Loading,
    State,
    Wanted,
    refusal,
    report_failures,
    sentence,
)
from chapters.ch03.loading.uploads import Upload, cost
from chapters.ch03.scene.textures.texels import Shape
from chapters.ch03.scene_cache import cache
from chapters.ch03.settings import Settings
from common import layouts
from common.errors import SceneError
from common.gltf.images import _Maker
from common.numerics.transforms import pose_looking_at
from common.scene import Material
from common.view.camera import Perspective, View
from tests.support.scenes import facing, quad_scene, translated
from tests.support.timing import PATIENCE_S, until

pytestmark = pytest.mark.usefixtures("no_thread_left")


def upload(name="one", nbytes=4):
    return Upload(name, Shape(nbytes // 4, 1, "rgba8", None, 1), False, (np.zeros((1, nbytes), np.uint8),))


def wanted(count, nbytes=4, make=None):
    """Return requests 0 to count - 1; `make(number)` decodes one."""
    made = make or (lambda number: upload(str(number), nbytes))
    return {n: Wanted(f"image {n}", nbytes, lambda n=n: made(n), (n,)) for n in range(count)}


@pytest.fixture
def opened():
    made = []

    def open_(*arguments, **more):
        made.append(Loading(*arguments, **more))
        return made[-1]

    yield open_
    for one in made:
        one.close()


def take_all(loading):
    """Return everything that is asked for, in the order in which it is handed over."""
    taken = []
    while loading.busy:
        request = loading.take()
        if request is None:
            loading.wait()
            continue
        taken.append(request)
        loading.copied(request)
        loading.arrived(request)
    return taken


# --- once, in order ---


@pytest.mark.feature("async-loading/file-decode")
@pytest.mark.parametrize("threads", [1, 4])
def test_each_texture_is_handed_over_exactly_once_and_decoded_elsewhere(opened, threads):
    decoded, lock = [], threading.Lock()

    def make(number):
        with lock:
            decoded.append((number, threading.get_ident()))
        return upload(str(number))

    loading = opened(threads)
    loading.want(wanted(300, make=make))
    loading.feed()
    until(lambda: not loading.decoding)  # without `wait` nobody helps
    taken = take_all(loading)
    assert sorted(request.key for request in taken) == list(range(300))
    assert all(request.upload is None and request.state is State.RESIDENT for request in taken)
    assert sorted(number for number, _ in decoded) == list(range(300))
    assert threading.get_ident() not in {ident for _, ident in decoded}
    assert loading.take() is None and loading.held_bytes == 0
    assert loading.counts(0, 0) == {
        "textures": 0,
        "textures_resident": 300,
        "textures_waiting": 0,
        "textures_failed": 0,
        "bytes_uploaded": 0,
    }


def test_nothing_that_is_there_is_asked_for_again(opened):
    loading = opened(1)
    loading.want(wanted(3))
    take_all(loading)
    assert loading.want(wanted(4)) == []
    assert [request.key for request in take_all(loading)] == [3]


def test_what_is_large_on_the_screen_comes_first_and_the_order_follows_the_view(opened):
    gate, begun = threading.Event(), []

    def make(number):
        begun.append(number)
        gate.wait(PATIENCE_S)
        return upload()

    loading = opened(1)
    loading.want(wanted(6, make=make))
    loading.prioritise(np.array([0, 1, 5, 3, 5, 2.0]))
    loading.feed()
    until(lambda: begun)
    loading.prioritise(np.array([9, 1, 0, 0, 0, 2.0]))  # 2 has begun
    gate.set()
    assert [request.key for request in take_all(loading)] == [2, 0, 5, 1, 3, 4]
    assert begun == [2, 0, 5, 1, 3, 4]


def test_without_a_view_the_order_is_the_scene_s(opened):
    loading = opened(1)
    loading.want(wanted(20))
    assert [request.key for request in take_all(loading)] == list(range(20))


def test_sizes_on_the_screen_are_those_of_the_nearest_object():
    materials = (Material(), Material(), Material(), Material())
    scene = quad_scene(
        materials=materials,
        matrices=tuple(translated(*at) for at in ((0, 0, 0), (0, 0, -8), (0, 0, 20), (0, 0, -48), (0, 0, 0))),
        instance_materials=(0, 1, 2, 1, 3),
    )
    scene.instances.visible[4] = False
    records = np.zeros(5, layouts.dtype("Instance"))
    places = np.array([(0, 0, 0), (0, 0, -8), (0, 0, 20), (0, 0, -48), (0, 0, 0)])
    records["bounds_centre"][:, :3] = places - scene.origin
    records["bounds_centre"][:, 3] = 1.0
    view = View(pose_looking_at((0, 0, 2), (0, 0, 0)), Perspective(np.pi / 2, 0.1))
    sizes = material_sizes(scene, records, view)
    # At distance d a sphere of radius 1 is 1/(2 d tan 45 deg) heights of the picture; behind the camera a tenth of it.
    assert sizes == pytest.approx([1 / 4, 1 / 20, 0.1 / 36, 0.0])
    assert material_sizes(scene, records, facing(ymag=4.0))[1] == pytest.approx(1 / 8)
    assert material_sizes(scene, records[:0], view).tolist() == [0.0] * 4


# --- bounds ---


def test_little_is_decoded_ahead(opened):
    loading = opened(4, ahead=1000)
    loading.want(wanted(50, nbytes=300))
    most, taken = 0, 0
    while loading.busy:
        loading.feed()
        until(lambda: loading.decoded)
        time.sleep(0.001)  # whoever could go too far does it now
        most = max(most, loading.held_bytes)
        request = loading.take()
        assert request is not None
        loading.copied(request)
        loading.arrived(request)
        taken += 1
    assert taken == 50 and 600 <= most <= 1000
    assert loading.held_bytes == 0


@pytest.mark.parametrize(("nbytes", "most"), [(1 << 20, 3 * AHEAD), (16 << 20, 48 << 20)])
def test_unless_told_otherwise_each_thread_has_an_image_however_large(opened, nbytes, most):
    loading = opened(2)
    loading.want(wanted(30, nbytes=nbytes, make=lambda number: upload(nbytes=nbytes)))
    loading.feed()
    until(lambda: not loading._running)
    assert min(30 * nbytes, most) - nbytes < loading.held_bytes <= most
    assert len(loading._decoded) >= 3


def test_one_image_alone_may_be_larger_than_the_bound(opened):
    loading = opened(2, ahead=100)
    loading.want(wanted(3, nbytes=400))
    assert len(take_all(loading)) == 3


def test_ten_thousand_tiny_textures(opened):
    loading = opened(2)
    began = time.perf_counter()
    loading.want(wanted(10_000))
    loading.prioritise(np.arange(10_000.0))
    assert len(take_all(loading)) == 10_000
    assert time.perf_counter() - began < 5.0


# --- what is not wanted any more, and what fails ---


def test_cancelled_in_every_state(opened):
    gate, begun = threading.Event(), []

    def make(number):
        begun.append(number)
        if number == 2:
            gate.wait(PATIENCE_S)
        return upload(nbytes=100)

    loading = opened(1, ahead=10_000)
    loading.want(wanted(5, make=make))
    loading.feed()
    until(lambda: 2 in begun)
    uploading = loading.take()  # 0 is being copied, 1 is decoded, 2 is being decoded, 3 and 4 wait
    requests = dict(loading.requests)
    assert [requests[n].state for n in range(5)] == [
        State.UPLOADING,
        State.DECODED,
        State.DECODING,
        State.WAITING,
        State.WAITING,
    ]
    kept = {4: wanted(5, make=make)[4]}
    assert loading.want(kept) == [uploading], "only what somebody copies has to be told"
    assert all(requests[n].state is State.CANCELLED for n in range(4))
    gate.set()
    assert [request.key for request in take_all(loading)] == [4]
    assert begun == [0, 1, 2, 4] and loading.held_bytes == 0


def test_wanted_again_while_it_is_still_decoded_for_nobody(opened):
    gate, begun = threading.Event(), []

    def make(number):
        begun.append(number)
        gate.wait(PATIENCE_S)
        return upload()

    loading = opened(1)
    loading.want(wanted(1, make=make))
    loading.feed()
    until(lambda: begun)
    loading.want({})
    loading.want(wanted(1, make=make))
    gate.set()
    assert len(take_all(loading)) == 1 and len(begun) == 2


@pytest.mark.feature("async-loading/file-decode")
@pytest.mark.parametrize("error", [ValueError("7 bytes"), MemoryError(), SceneError("a.png: is damaged.")])
def test_a_decoder_that_raises_fails_alone_with_one_sentence(opened, error):
    def make(number):
        if number == 1:
            raise error
        return upload()

    loading = opened(2)
    loading.want(wanted(3, make=make))
    assert sorted(request.key for request in take_all(loading)) == [0, 2]
    counts = loading.counts(2, 0)
    assert (counts["textures_resident"], counts["textures_waiting"], counts["textures_failed"]) == (2, 0, 1)
    scene = quad_scene()
    report_failures(loading, scene)
    report_failures(loading, scene)
    expected = {
        ValueError: "image 1 cannot be decoded (7 bytes): it is drawn without its texture.",
        MemoryError: "image 1 cannot be decoded (MemoryError): it is drawn without its texture.",
        SceneError: "a.png: is damaged: it is drawn without its texture.",
    }
    assert scene.warnings == [expected[type(error)]]
    failed = loading.requests[1]
    assert isinstance(refusal(failed), SceneError) and sentence(failed, "x").count(".") <= 2
    assert failed.upload is None
    loading.want(wanted(3))  # mended: it is tried once more
    assert [request.key for request in take_all(loading)] == [1]
    assert loading.counts(0, 0)["textures_failed"] == 0


@pytest.mark.parametrize("pause_s", [0.0, 0.002, 0.01])
def test_closed_while_loading_joins_all_threads(pause_s):
    before = threading.active_count()
    loading = Loading(3)
    loading.want(wanted(1000, make=lambda number: time.sleep(0.0005) or upload()))
    loading.feed()
    time.sleep(pause_s)
    loading.close()
    loading.close()
    assert threading.active_count() == before
    assert loading.held_bytes == 0 and not loading.busy


def test_threads_rest_when_nothing_is_left_and_come_back(opened):
    before = threading.active_count()
    loading = opened(2)
    for count in (2, 4):
        loading.want(wanted(count))
        take_all(loading)
        loading.rest()
        assert threading.active_count() == before


def test_one_slow_image_does_not_stop_the_others(opened):
    """Who waits is woken by whichever is the first, so that what is decoded ahead makes room for more."""
    held, seen, ended = threading.Event(), [], []
    loading = opened(2, ahead=2 << 20)

    def make(number):
        if number == 0:
            held.wait(2.0)  # so long it would take, were it waited for
            ended.append(number)
        return upload(str(number), 1 << 20)

    loading.want({n: Wanted(f"{n}", 1 << 20, partial(make, n)) for n in range(8)})
    while len(seen) < 7:  # all but the slow one
        request = loading.take()
        if request is None:
            loading.wait()
            continue
        seen.append(request.key)
        loading.copied(request)
        loading.arrived(request)
    assert 0 not in seen and not ended
    held.set()
    take_all(loading)
    assert not loading.busy


def test_what_is_decoded_ahead_is_bounded_however_large_images_are():
    for threads in (1, 8, 64):
        loading = Loading(threads)
        for side, most in ((512, MOST_AHEAD), (4096, MOST_AHEAD), (8192, 2 * 4 * 8192**2)):
            loading.want({(side, n): Wanted(f"{n}", 4 * side * side, None) for n in range(100)})
            loading._feed(lambda name, task: None)
            assert loading.held_bytes <= max(most, 4 * side * side)
            loading._running.clear()
            loading._held_bytes = 0
        loading.stop()


@pytest.mark.parametrize("cached", [False, True])
@pytest.mark.parametrize(("processors", "images"), [(1, 1), (2, 2), (64, 3)])
def test_few_pictures_are_decoded_while_geometry_is_read(tmp_path, monkeypatch, processors, images, cached):
    """Pictures of 4 MiB each: one for each thread, and however many there are, three."""
    path = bench_scene.write(tmp_path, 6, 1024)
    monkeypatch.setattr(os, "cpu_count", lambda: processors)
    begun = []
    monkeypatch.setattr(_Maker, "begin", lambda self, pool, copied: begun.append(self))
    opened = cache.open_scene(path, cached=cached)
    assert len(opened.scene.images) == 6 and len(begun) == images


def test_whatever_a_decoder_raises_the_one_who_waits_is_woken(opened):
    loading = opened(1)

    def leave():
        raise SystemExit("gone")

    loading.want({0: Wanted("0", 1, leave)})
    loading.wait()
    assert [str(request.error) for request in loading.failures()] == ["gone"]


# --- what the settings say ---


def test_frames_are_not_waited_for_in_a_window_only():
    said = {
        (loading, presents): Loading.of(Settings(loading=loading), presents).streams
        for loading in ("auto", "wait", "stream")
        for presents in (False, True)
    }
    assert {key for key, streams in said.items() if streams} == {
        ("auto", True),
        ("stream", False),
        ("stream", True),
    }
    assert Loading.of(Settings(upload_budget=0.5), True).budget == 1 << 19


# --- what a frame spends ---


@pytest.mark.parametrize(("levels", "brought", "made"), [(1, 1, 0), (9, 1, 8), (9, 9, 0), (9, 4, 5)])
def test_each_level_that_the_gpu_makes_costs_as_much_as_the_image_itself(levels, brought, made):
    rows = tuple(np.zeros((1, 4), np.uint8) for _ in range(brought))
    image = Upload("one", Shape(256, 256, "rgba8", None, levels), False, rows)
    assert cost(image) == (1 + made) * 131_072, "an eighth of a MiB each"
