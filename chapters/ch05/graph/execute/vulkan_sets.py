"""The descriptor sets of passes that compute: all that a pass declares, as its kernel reaches it.

See graph/execute/bindings.py for the order. A pass asks for it by having `source_set`, which the executor fills before
it records the pass; `source_number` is the set's number, 0 unless the class says otherwise.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.resources import Buffer, Image

from ...pipelines.vulkan_descriptors import Held, Texture
from ..sync.vulkan import layout_of
from ..types import Graph, Step
from .bindings import bindings_of, check_table


def check_sources(step: Step, made: Any, graph: Graph, number: int) -> None:
    """Raise GraphError where set `number` of the pass's pipeline is not what it declares to read and write."""
    sets = made.pipeline.sets
    layout = sets[number] if number < len(sets) else None
    shader = made.pipeline.stages.sources[0].name
    table = {one.number: (str(one.kind), one.name) for one in (layout.bindings if layout else ())}
    check_table(step.name, bindings_of(step, made, graph), table, f"set {number} of {shader}")


def sources(
    step: Step, made: Any, graph: Graph, held: Mapping[str, Image | Buffer], sampler: Any
) -> dict[int, Held]:
    """Return what the bindings hold in one slot; `held` is what is behind the names of resources there."""
    found: dict[int, Held] = {}
    for binding, bound in enumerate(bindings_of(step, made, graph)):
        one = held[bound.resource]
        if isinstance(one, Buffer):
            found[binding] = one
        elif bound.kind == "texture":
            found[binding] = Texture(one.view, sampler, layout_of("read", one))
        else:
            found[binding] = Texture(one.view, vk.NULL, layout_of("general", one))
    return found
