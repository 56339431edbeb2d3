"""The descriptor sets of compute passes: all declared accesses.

See graph/execute/bindings.py for the order. `sources` of the pass has the number of the set.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from backends.contract import Pass
from backends.vulkan import api as vk
from backends.vulkan.resources import Buffer, Image

from ...pipelines.vulkan_descriptors import Held, Texture
from ..sync.vulkan import layout_of
from ..types import Graph, Step
from .bindings import bindings_of, check_table


def check_sources(step: Step, gpu_pass: Pass, graph: Graph) -> None:
    """Raise GraphError if the shader's set differs from the declared reads and writes."""
    (pipeline,), number = gpu_pass.pipelines, gpu_pass.sources.set if gpu_pass.sources else 0
    sets = pipeline.sets
    layout = sets[number] if number < len(sets) else None
    shader = pipeline.code.sources[0].name
    table = {entry.number: (str(entry.kind), entry.name) for entry in (layout.bindings if layout else ())}
    check_table(step.name, bindings_of(step, gpu_pass, graph), table, f"set {number} of {shader}")


def sources(
    step: Step, gpu_pass: Pass, graph: Graph, objects: Mapping[str, Image | Buffer], sampler: Any
) -> dict[int, Held]:
    """Return the contents of the bindings of one slot; `objects` are its images and buffers by resource."""
    contents: dict[int, Held] = {}
    for binding, bound in enumerate(bindings_of(step, gpu_pass, graph)):
        resource = objects[bound.resource]
        if isinstance(resource, Buffer):
            contents[binding] = resource
        elif bound.kind == "texture":
            contents[binding] = Texture(resource.view, sampler, layout_of("read", resource))
        else:
            contents[binding] = Texture(resource.view, vk.NULL, layout_of("general", resource))
    return contents
