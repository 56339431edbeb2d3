"""What a graph's images go through before its first frame, on the queues that have them first."""

from __future__ import annotations

from backends.vulkan.once import submit_once

from ...frames.queues.vulkan_queues import Queues
from ..execute.batches import prologues
from ..memory.vulkan_images import GraphImages
from ..types import Graph
from .vulkan import dependency


def begin_lasting(queues: Queues, graph: Graph, images: GraphImages) -> None:
    """Bring what lasts from frame to frame into the state, and to the queue, in which a frame finds it."""
    for queue, released, planned in prologues(graph):
        if released and not queues.families:
            continue  # a queue of the same family takes it as it is
        with submit_once(queues.device, queues.of[queue]) as commands:
            for held in images.in_slot:
                made = dependency(planned, held, queues.giving if released else queues.taking)
                queues.device.fn.vkCmdPipelineBarrier2(commands, made)
