"""The descriptor sets of passes that compute: all that a pass declares, as its kernel reaches it.

See graph/execute/bindings.py for the order. A pass asks for it by its `sources`, which say the number of the set.
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


def check_sources(step: Step, made: Pass, graph: Graph) -> None:
    """Raise GraphError where the set of the pass's sources is not what it declares to read and write."""
    (pipeline,), number = made.pipelines, made.sources.set if made.sources else 0
    sets = pipeline.sets
    layout = sets[number] if number < len(sets) else None
    shader = pipeline.code.sources[0].name
    table = {one.number: (str(one.kind), one.name) for one in (layout.bindings if layout else ())}
    check_table(step.name, bindings_of(step, made, graph), table, f"set {number} of {shader}")


def sources(
    step: Step, made: Pass, graph: Graph, held: Mapping[str, Image | Buffer], sampler: Any
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
