"""What is shared with another queue and what is handed over, on devices that do not exist; frames of real ones."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from backends.contract import Access, Pass
from backends.shader_text import build_text
from backends.vulkan import api as vk
from backends.vulkan import resources
from backends.vulkan.compute import Kernel, Sampled
from backends.vulkan.device import Queue
from backends.vulkan.resources import Image
from chapters.ch05.frames.queues.vulkan_queues import Queues
from chapters.ch05.graph.sync.vulkan import STAGES, dependency
from chapters.ch05.graph.types import Barrier, Touch
from chapters.ch05.settings import Settings
from common.settings import replaced
from tests.ch04.test_graph_frames import OUTPUTS, SIZE, scene
from tests.support.cloth_runs import VIEW
from tests.support.cloth_scenes import cloth, cloth_scene_of
from tests.support.hazards import Given, Wait, find_hazards
from tests.support.scenes import facing
from tests.support.traced_frames import Trace, hazards_without

__all__ = ["scene"]

IGNORED = vk.VK_QUEUE_FAMILY_IGNORED
WRITTEN = Touch("color", frozenset({"color"}), frozenset({"color_write"}), True)
READ = Touch("general", frozenset({"compute"}), frozenset({"storage_read"}))
OVER = Barrier("lit", WRITTEN, READ, hand_over=("graphics", "compute"))
IMAGE = Image(vk.NULL, vk.NULL, "rgba8", 4, 4, 1, 1, vk.VK_IMAGE_ASPECT_COLOR_BIT, None, "lit")


def queues(graphics=0, compute=None, own=True):
    """Return the queues of a device with these families."""
    beside = None if compute is None else Queue(vk.NULL, compute, 0)
    device = SimpleNamespace(queue=Queue(vk.NULL, graphics, 0), compute_queue=beside)
    return Queues(device, own)


@pytest.mark.feature("async-compute/queue")
def test_compute_has_a_queue_of_its_own_where_there_is_one_and_it_is_wanted():
    assert queues(0, 2).of["compute"].family == 2
    assert queues(0, None).of["compute"] is not None and queues(0, None).of["compute"].family == 0
    assert queues(0, 2, own=False).of["compute"].family == 0


@pytest.mark.feature("async-compute/queue")
def test_buffers_are_used_concurrently_if_and_only_if_the_families_differ():
    cases = {
        (0, None, True): (),
        (0, 0, True): (),
        (0, 2, False): (),
        (0, 2, True): (0, 2),
        (3, 1, True): (3, 1),
    }
    for (graphics, compute, own), families in cases.items():
        assert queues(graphics, compute, own).families == families
        info = resources._buffer_info(16, vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT, families)
        concurrent = vk.VK_SHARING_MODE_CONCURRENT if families else vk.VK_SHARING_MODE_EXCLUSIVE
        assert info.sharingMode == concurrent
        named = [info.pQueueFamilyIndices[i] for i in range(info.queueFamilyIndexCount)]
        assert tuple(named) == families


def barrier_of(made):
    assert made.imageMemoryBarrierCount == 1
    return made.pImageMemoryBarriers[0]


@pytest.mark.feature("async-compute/queue")
def test_both_halves_of_a_hand_over_name_the_same_families_and_layouts():
    two = queues(0, 2)
    release, acquire = (
        barrier_of(dependency([OVER], {"lit": IMAGE}, half)) for half in (two.giving, two.taking)
    )
    for one in (release, acquire):
        assert (one.srcQueueFamilyIndex, one.dstQueueFamilyIndex) == (0, 2)
        assert (one.oldLayout, one.newLayout) == (
            vk.VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL,
            vk.VK_IMAGE_LAYOUT_GENERAL,
        )
    assert release.srcStageMask == STAGES["color"] and release.srcAccessMask
    assert release.dstStageMask == release.dstAccessMask == 0
    assert acquire.srcStageMask == acquire.dstStageMask == STAGES["compute"], "its stages are this queue's"
    assert acquire.srcAccessMask == 0 and acquire.dstAccessMask


@pytest.mark.feature("async-compute/queue")
def test_within_one_family_nothing_is_handed_over_and_the_layout_changes_once():
    for one_family in (queues(0, None), queues(1, 1), queues(0, 2, own=False)):
        acquire = barrier_of(dependency([OVER], {"lit": IMAGE}, one_family.taking))
        assert acquire.srcQueueFamilyIndex == acquire.dstQueueFamilyIndex == IGNORED
        assert acquire.newLayout == vk.VK_IMAGE_LAYOUT_GENERAL
    plain = replace(OVER, hand_over=None)
    made = barrier_of(dependency([plain], {"lit": IMAGE}, queues(0, 2).taking))
    assert made.srcStageMask == STAGES["color"] and made.srcQueueFamilyIndex == IGNORED
    begins = replace(OVER, hand_over=("compute", "compute"))  # of a prologue: on which queue it happens
    made = barrier_of(dependency([begins], {"lit": IMAGE}, queues(0, 2).taking))
    assert made.srcStageMask == STAGES["color"] and made.srcQueueFamilyIndex == IGNORED


INVERT = """
layout(local_size_x = 8, local_size_y = 8) in;
layout(binding = 0, rgba16f) readonly uniform image2D given;
layout(binding = 1, rgba16f) writeonly uniform image2D inverted;
void main() {
    ivec2 at = ivec2(gl_GlobalInvocationID.xy);
    if (all(lessThan(at, imageSize(given))))
        imageStore(inverted, at, vec4(1.0) - imageLoad(given, at));
}
"""


class Invert(Pass):
    """A compute pass between lighting and tone mapping, on the compute queue: two images change hands."""

    name = "invert"
    queue = "compute"
    reads = (Access("color_focused", "storage"),)
    writes = (Access("color_inverted", "storage", format="rgba16f"),)

    def __init__(self, renderer, queue="compute"):
        self._renderer, self.queue = renderer, queue
        text = build_text(INVERT, "comp", "vulkan", name="<invert>")
        self.kernel = Kernel(renderer.device, text, ["image", "image"], dispatches=64)

    @staticmethod
    def needed(scene, settings):
        return True

    def create(self):
        pass

    def record(self, commands):
        images, names = self._renderer._api.executor.images, self._renderer.graph.names
        held = [
            images.image(commands.slot.index, names[name]) for name in ("color_focused", "color_inverted")
        ]
        groups = (-(-held[0].width // 8), -(-held[0].height // 8), 1)
        self.kernel.record(commands.handle, [Sampled(one.view) for one in held], groups)


def inverted(chapter, scene, settings, queue, watch=None):
    """Return the pictures of some frames with that pass."""
    with chapter.open(scene, SIZE, settings, outputs=OUTPUTS) as renderer:
        made = Invert(renderer, queue)
        try:
            renderer.insert_pass(made, readers={"tonemap": {"color_focused": "color_inverted"}})
            frames = [renderer.render(facing()) for _ in range(3)]
            found = [{name: frame.image(name) for name in OUTPUTS} for frame in frames[1:]]
            if watch is not None:
                watch(renderer)
            return found
        finally:
            renderer.device.wait_idle()
            made.kernel.close()


@pytest.mark.variants("vulkan")
@pytest.mark.feature("async-compute/queue")
@pytest.mark.parametrize(
    ("graph", "changes"),
    [
        ("deferred", ({}, {"poison": "depth 0"})),
        ("forward", ({"async_compute": False}, {"alias": False})),
    ],
    ids=["deferred", "forward"],
)
def test_a_pass_on_the_compute_queue_gives_the_bits_that_it_gives_on_graphics(chapter, scene, graph, changes):
    settings = Settings(graph=graph, default_light=False, ambient=0.3, aperture=0.5, focus_distance=1.0)
    truth = inverted(chapter, scene, settings, "graphics")
    seen = []

    def watch(renderer):
        seen.append([batch.queue for batch in renderer.graph.batches])

    for changed in changes:
        found = inverted(chapter, scene, replaced(settings, **changed), "compute", watch)
        for one, other in zip(found, truth, strict=True):
            assert all(np.array_equal(one[name], other[name]) for name in OUTPUTS), changed
    assert all(batches.count("compute") == 1 and batches.count("graphics") >= 2 for batches in seen)


@pytest.mark.core
@pytest.mark.variants("vulkan")
@pytest.mark.feature("async-compute/vertex-hazard-guard")
def test_frames_with_a_pass_on_the_compute_queue_have_no_hazard_and_no_wait_in_vain(chapter, scene):
    def watch(renderer):
        trace = Trace(renderer)
        events, places = trace.events(lambda: renderer.render(facing())), trace.places
        assert not find_hazards(events, places)
        between = {event for event in events if isinstance(event, Wait) and event.queue != "host"}
        assert between
        for waited in between:
            assert hazards_without(events, places, lambda event, _, waited=waited: event == waited), waited

    inverted(chapter, scene, Settings(default_light=False, ambient=0.3), "compute", watch)


@pytest.mark.variants("vulkan", "without-all")
@pytest.mark.feature("async-compute/vertex-hazard-guard")
@pytest.mark.feature("async-compute/queue")
def test_no_vertex_of_a_cloth_is_written_while_an_earlier_frame_reads_it(chapter):
    """Each slot has its vertices: the wait of the CPU guards those of two frames ago, graphics waits for the newest."""
    sheet = cloth_scene_of(cloth(5, 5, [0, 4]))
    settings = Settings(graph="forward", cloth_substeps=2)
    with chapter.open(sheet, SIZE, settings) as renderer:
        moments = iter(np.arange(1, 100) / 60)

        def draw():
            renderer.render(VIEW, float(next(moments)))

        for _ in range(2):
            draw()
        trace = Trace(renderer)
        events, places = trace.events(draw, 6), trace.places
    assert not find_hazards(events, places)
    guarded = "cloth_vertices"

    def missed(left_out):
        found = hazards_without(events, places, lambda event, _: left_out(event))
        return {hazard.by for hazard in found if guarded in hazard.resource}

    assert missed(lambda event: isinstance(event, Wait) and event.queue == "graphics") == {"forward"}
    # Who does not wait for a slot is not lent its vertices either.
    assert missed(lambda event: isinstance(event, Given) and guarded in event.resource) == {"cloth"}
