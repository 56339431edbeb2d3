"""Passes recorded by several threads: the same picture to the bit, and every pool with one thread and one frame."""

from __future__ import annotations

import threading
from collections import Counter, defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

from backends.vulkan import api as vk
from chapters.ch03.frames.frame import SLOTS
from chapters.ch03.frames.recording.parts import Groups, pool_index
from chapters.ch03.frames.recording.vulkan_pools import CommandPools
from chapters.ch03.settings import Settings
from chapters.ch03.tasks.errors import TaskError
from common.scene import Image, Material, Scene
from tests.support import recorded
from tests.support.chapter import of_backend, record_anew
from tests.support.pacing import ends
from tests.support.scenes import facing, quad_scene, texture, translated
from tests.support.timing import PATIENCE_S

pytestmark = pytest.mark.usefixtures("no_thread_left")

SIZE = (32, 32)
OUTPUTS = ("color", "color_linear", "depth", "instance_id")
WAYS = [(1, 1), (2, 3), (3, 5)]
"""(threads, least calls of a part)."""

IMAGES = (Image("squares", np.random.default_rng(1).integers(0, 256, (8, 8, 4), np.uint8)),)
MATERIALS = (
    Material(base_color=(0.9, 0.2, 0.1, 1.0)),
    Material(base_color_texture=texture()),
    Material(base_color=(0.1, 0.6, 0.2, 1.0), unlit=True, double_sided=True),
    Material(base_color_texture=texture(), alpha_mode="mask"),
    Material(base_color=(0.9, 0.9, 0.1, 0.5), alpha_mode="blend"),
    Material(base_color=(0.1, 0.1, 0.9, 0.6), alpha_mode="blend", double_sided=True),
)


def mixed_scene() -> Scene:
    """Return 26 squares in disorder: solid ones of four kinds, mirrored or not, and 12 transparent ones of two kinds
    in turns, which lie over one another."""
    rng = np.random.default_rng(7)
    kinds = (*rng.integers(0, 4, 14).tolist(), *(4, 5) * 6)
    places = []
    for kind in kinds:
        x, y, z = rng.uniform((-0.5, -0.5, -1.0 if kind < 4 else 0.1), (0.5, 0.5, 0.0 if kind < 4 else 1.0))
        scale = np.diag((0.4, 0.4 * rng.choice((1, -1)), 1.0, 1.0))
        places.append(translated(x, y, z) @ scale)
    return quad_scene(matrices=tuple(places), materials=MATERIALS, instance_materials=kinds, images=IMAGES)


def pictures(frame: Any) -> dict[str, np.ndarray]:
    """Return all outputs of a frame."""
    return {name: frame.image(name) for name in OUTPUTS}


def knobs(threads: int, least: int, **more: Any) -> Settings:
    """Return settings that record so."""
    return Settings(recording_threads=threads, draws_per_secondary=least, **more)


@contextmanager
def opened(chapter: Any, settings: Settings, **more: Any) -> Iterator[Any]:
    """Open the chapter on the mixed scene."""
    with chapter.open(mixed_scene(), SIZE, settings, outputs=OUTPUTS, **more) as renderer:
        yield renderer


DRAWN = ("draws", "draw_calls", "triangles", "instances", "pipelines")


@pytest.mark.feature("recording/parallel-draws", "recording/primary-and-secondary")
@pytest.mark.parametrize("without", [(), ("multi-draw",)], ids=["as it is", "a call for each"])
def test_the_picture_is_the_same_for_every_number_of_threads_and_parts(chapter, without):
    with opened(chapter, Settings(), without=without) as renderer:
        frame = renderer.render(facing())
        truth, work = pictures(frame), frame.work
    assert work["recorded_parts"] == 0 and work["recording_threads"] == 1
    assert len(np.unique(truth["color"].reshape(-1, 4), axis=0)) > 40, "squares lie over one another"
    for threads, least in WAYS:
        with opened(chapter, knobs(threads, least), without=without) as renderer:
            for _ in range(SLOTS + 1):  # so that a slot's pools are used again
                frame = renderer.render(facing())
            assert frame.work["recorded_parts"] >= 2
            assert frame.work["recording_threads"] == threads + 1
            assert {name: frame.work[name] for name in DRAWN} == {name: work[name] for name in DRAWN}
            for name, one in pictures(frame).items():
                assert np.array_equal(one, truth[name]), f"{name} with {threads} threads, parts of {least}"


@pytest.mark.feature("recording/primary-and-secondary")
def test_many_samples_and_another_size_are_inherited_too(chapter):
    found = []
    for settings in (Settings(msaa=4), knobs(2, 2, msaa=4)):
        with opened(chapter, settings, without=("multi-draw",)) as renderer:
            if renderer.samples == 1:
                pytest.skip("the device has no multisampling")
            renderer.render(facing()).image("color")
            renderer.resize((31, 17))
            found.append(pictures(renderer.render(facing())))
    for name, one in found[0].items():
        assert one.shape[:2] == (17, 31) and np.array_equal(one, found[1][name]), name


def test_few_draws_are_recorded_as_ever_and_no_thread_starts(chapter):
    before = threading.active_count()
    for settings in (Settings(), knobs(2, 1000)):
        with opened(chapter, settings) as renderer:
            renderer.render(facing())
            work = renderer.render(facing()).work
            assert threading.active_count() == before
        assert work["recorded_parts"] == 0 and work["recording_threads"] == 1


def test_an_empty_scene_has_no_parts(chapter):
    scene = quad_scene(instance_materials=())
    with chapter.open(scene, SIZE, knobs(2, 1), outputs=("color",)) as renderer:
        frame = renderer.render(facing())
        assert frame.work["recorded_parts"] == 0
        assert len(np.unique(frame.image("color").reshape(-1, 4), axis=0)) == 1


@pytest.mark.feature("recording/parallel-draws")
def test_an_error_in_a_part_tells_its_name_and_the_next_frame_is_whole(chapter, monkeypatch):
    """The threads are two for certain: the first two parts wait for one another."""
    part, both, seen = Groups.part, threading.Barrier(2, timeout=PATIENCE_S), set()

    def failing(self: Groups, first: int, last: int) -> list[Any]:
        if first < 6:
            both.wait()
        seen.add(threading.get_ident())
        if first == 3:
            raise ValueError("no such page")
        return part(self, first, last)

    with opened(chapter, knobs(1, 3), without=("multi-draw",)) as renderer:
        truth = pictures(renderer.render(facing()))
        with monkeypatch.context() as patch:
            patch.setattr(Groups, "part", failing)
            with pytest.raises(TaskError, match=r"failed in '.*\[3:[67]\]'") as caught:
                renderer.render(facing())
        assert len(seen) == 2
        assert "no such page" in str(caught.value) and isinstance(caught.value.__cause__, ValueError)
        for _ in range(SLOTS + 1):
            frame = renderer.render(facing())
        for name, one in pictures(frame).items():
            assert np.array_equal(one, truth[name]), name


# --- what Vulkan got --------------------------------------------------------------------------------------------------

VULKAN = pytest.mark.variants("vulkan", "without-all")


class Log(list[Any]):
    """Traced calls, and beside each the thread that made it, and what it waits for or signals in the end."""

    def __init__(self) -> None:
        super().__init__()
        self.threads: list[int] = []
        self.ends: list[list[Any]] = []
        self._lock = threading.Lock()

    def append(self, call: Any) -> None:
        """Keep a call with its thread."""
        with self._lock:
            self.threads.append(threading.get_ident())
            self.ends.append(ends(*call))
            super().append(call)


def key(handle: Any) -> int:
    """Return a handle as a number."""
    return int(vk.ffi.cast("uintptr_t", handle))


@contextmanager
def traced(chapter: Any) -> Iterator[Log]:
    """Trace the device's calls with their threads."""
    log = Log()
    chapter.device.fn.trace(log)
    try:
        yield log
    finally:
        chapter.device.fn.trace(None)


def per_buffer(log: Log) -> tuple[dict[int, list[Any]], list[Any]]:
    """Return the commands of each buffer, and those of the primaries with secondaries in the place of their call."""
    of: dict[int, list[Any]] = defaultdict(list)
    inherits: set[int] = set()
    for name, arguments in log:
        if name == "vkBeginCommandBuffer":
            of[key(arguments[0])] = []
            if arguments[1].pInheritanceInfo != vk.NULL:
                inherits.add(key(arguments[0]))
        elif name.startswith("vkCmd"):
            of[key(arguments[0])].append((name, arguments))
    primaries = dict.fromkeys(buffer for buffer in of if buffer not in inherits)
    flat: list[Any] = []
    for buffer in primaries:
        for name, arguments in of[buffer]:
            if name == "vkCmdExecuteCommands":
                for number in range(arguments[1]):
                    flat += of[key(arguments[2][number])]
            else:
                flat.append((name, arguments))
    return {buffer: of[buffer] for buffer in inherits}, flat


@VULKAN
@pytest.mark.feature("recording/primary-and-secondary", "recording/parallel-draws")
def test_secondaries_say_all_themselves_and_stand_in_the_order_of_the_draws(chapter):
    drawn = []
    for settings in (Settings(), knobs(2, 4)):
        with opened(chapter, settings, without=("multi-draw",)) as renderer:
            renderer.render(facing())
            with traced(chapter) as log:
                renderer.render(facing())
            secondaries, flat = per_buffer(log)
            drawn.append(recorded.draws(renderer, flat))
    assert drawn[0] == drawn[1]
    assert [len(one) for one in drawn[0][:2]] == [26, 14]
    assert len(secondaries) == 26 // 4 + 14 // 4
    for commands in secondaries.values():
        names = [name for name, _ in commands]
        assert names[:2] == ["vkCmdSetViewport", "vkCmdSetScissor"]
        first = next(i for i, name in enumerate(names) if name.startswith("vkCmdDraw"))
        needed = {
            *("vkCmdBindPipeline", "vkCmdSetCullMode", "vkCmdSetFrontFace"),
            *("vkCmdBindDescriptorSets", "vkCmdBindIndexBuffer"),
        }
        assert needed <= {*names[:first]}
        assert not any("Rendering" in name or "Barrier" in name for name in names)
    flags = [arguments[1].flags for name, arguments in log if name == "vkCmdBeginRendering"]
    assert flags == [vk.VK_RENDERING_CONTENTS_SECONDARY_COMMAND_BUFFERS_BIT] * 2 + [0], "tonemap is one call"


@VULKAN
@pytest.mark.feature("recording/command-pools")
def test_a_pool_has_one_thread_is_reset_once_a_frame_and_never_in_flight(chapter, monkeypatch):
    frames, threads = 7, 3
    part, both = Groups.part, threading.Barrier(2, timeout=PATIENCE_S)

    def with_company(self: Groups, first: int, last: int) -> list[Any]:
        if first < 4:
            both.wait()  # the first two parts run at the same time
        return part(self, first, last)

    monkeypatch.setattr(Groups, "part", with_company)
    with traced(chapter) as log, opened(chapter, knobs(threads - 1, 2), without=("multi-draw",)) as renderer:
        opening = len(
            log
        )  # what opens a renderer has pools of its own, whose handles a driver may give out again
        for _ in range(frames):
            record_anew(renderer)
            renderer.render(facing())
        pools = {key(pool.handle) for pool in of_backend(renderer, "commands")._pools.pools}
    assert len(pools) == SLOTS * threads
    counts = Counter(name for name, _ in log)
    assert counts["vkFreeCommandBuffers"] == counts["vkResetCommandBuffer"] == 0
    pool_of: dict[int, int] = {}
    users: dict[int, set[int]] = defaultdict(set)
    begun: dict[int, None] = {}  # buffers since their pools were reset
    recorded_now: set[int] = set()  # pools since the last submission
    resets: Counter[int] = Counter()  # since then, too
    in_flight: dict[Any, set[int]] = {}  # pools by fence or value
    submitted = 0
    for number, ((name, arguments), thread, over) in enumerate(zip(log, log.threads, log.ends, strict=True)):
        if name == "vkAllocateCommandBuffers":
            pool_of[key(arguments[2][0])] = key(arguments[1].commandPool)
            if number < opening:
                continue
            begun.pop(key(arguments[2][0]), None)  # where one was that went with its pool
            users[key(arguments[1].commandPool)].add(thread)
        elif number < opening:
            continue
        elif name in ("vkBeginCommandBuffer", "vkEndCommandBuffer") or name.startswith("vkCmd"):
            buffer = key(arguments[0])
            users[pool_of[buffer]].add(thread)
            if name == "vkBeginCommandBuffer":
                assert buffer not in begun, "a buffer was begun again without a reset"
                begun[buffer] = None
                recorded_now.add(pool_of[buffer])
        elif name == "vkResetCommandPool":
            pool = key(arguments[1])
            assert not any(pool in used for used in in_flight.values()), "the GPU may still read it"
            begun = {buffer: None for buffer in begun if pool_of[buffer] != pool}
            resets[pool] += 1
        elif name.startswith("vkWait"):
            for end in over:
                in_flight.pop(end, None)
        elif name == "vkQueueSubmit2":
            if recorded_now & pools:
                submitted += 1
                assert all(count == 1 for count in resets.values()), "one reset per pool and frame"
                in_flight[over[-1]] = set(recorded_now)
            recorded_now, resets = set(), Counter()
    assert submitted == frames
    assert all(len(users[pool]) <= 1 for pool in pools)
    assert len({pool for pool in pools if users[pool]}) > SLOTS, "workers have recorded, too"


@pytest.mark.variants("vulkan")
def test_buffers_of_a_pool_are_kept_and_given_out_anew(chapter):
    with opened(chapter, knobs(1, 2), without=("multi-draw",)) as renderer:
        slot = renderer._frames.slots[0]
        pools = CommandPools(
            chapter.device,
            [slot],
            of_backend(renderer, "workers"),
        )
        pools.open()
        first = [key(pools.take(slot)) for _ in range(3)]
        assert len({*first}) == 3 and pools.pools[pool_index(0, 0, 2)].used == 3
        renderer._frames.wait(slot)
        pools.begin(slot)
        assert [key(pools.take(slot)) for _ in range(3)] == first
        elsewhere: list[BaseException] = []

        def take() -> None:
            try:
                pools.take(slot)
            except RuntimeError as error:
                elsewhere.append(error)

        stranger = threading.Thread(target=take)
        stranger.start()
        stranger.join()
        assert "has no index" in str(elsewhere[0])
        pools.close()
