"""The bindings of a compute pass: one descriptor set with all of its declared reads and writes, in this order.

A pass that draws has attachments, and binds only the images that it samples. A compute shader accesses all resources
through bindings: binding i is the i-th bound access, reads first.

    sampled                       a texture with its sampler
    storage of an image           an image that is loaded and stored
    storage, uniform of a buffer  a block
    indirect, copy                no binding: no shader accesses them
    structure, build              no binding: the owner of acceleration structures binds them
    storage of OWNED bytes        no binding: the owner of the memory binds it
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from backends.contract import Pass

from ...pipelines.spirv.declared import Kind
from ..types import PREVIOUS, Graph, GraphError, Step

OWNED = 4
"""Bytes of a resource that only orders passes: it stands for memory that a technique binds by itself."""

STORABLE = ("rgba8", "rgba16f", "rgba32f", "r32f", "r32ui")
"""Formats with shader stores on every device (Vulkan specification, "Required Format Support")."""

STORED_RATES = "r8ui"
"""The format of an attachment of shading rates. A device counts as one with such attachments if shaders store it, too
(backends/vulkan/driver/features.py)."""


@dataclass(frozen=True)
class Bound:
    """A bound access: the resource, the kind of binding in the shader, and whether the shader writes it."""

    resource: str
    kind: Kind
    writes: bool


def bindings_of(step: Step, gpu_pass: Pass, graph: Graph) -> list[Bound]:
    """Return the bindings of a compute step in their order."""
    bindings = []
    for writes, accesses, names in (
        (False, gpu_pass.reads, step.reads),
        (True, gpu_pass.writes, step.writes),
    ):
        for access, name in zip(accesses, names, strict=True):
            kind: Kind | None = None
            if access.use == "sampled":
                kind = "texture"
            elif access.use == "uniform":
                kind = "uniform"
            elif access.use == "storage" and graph.resources[name.removesuffix(PREVIOUS)].bytes != OWNED:
                buffer = graph.resources[name.removesuffix(PREVIOUS)].kind == "buffer"
                kind = "storage" if buffer else "image"
            if kind is not None:
                bindings.append(Bound(name, kind, writes))
    return bindings


def check_table(step: str, bound: Sequence[Bound], table: Mapping[int, tuple[str, str]], shader: str) -> None:
    """Raise GraphError if a shader's descriptor set differs from the declarations of the pass of `step`.

    `table` has, by binding, kind and name in the shader. The shader may leave bindings out.
    """
    if not table:
        raise GraphError(f"{shader} has no bindings, and '{step}' binds what it declares there.")
    for number, (kind, name) in sorted(table.items()):
        declared = f"{len(bound)} accesses that are bound" if len(bound) != 1 else "1 access that is bound"
        if number >= len(bound):
            raise GraphError(
                f"'{step}' declares {declared}, and {shader} has the {kind} '{name}' at binding {number}: "
                "declare what it reads or writes there."
            )
        entry = bound[number]
        if kind != entry.kind:
            raise GraphError(
                f"'{step}' binds '{entry.resource}' as {entry.kind} at binding {number}, where {shader} has the {kind} "
                f"'{name}': bindings follow the order of reads, then writes."
            )


def check_stored(name: str, format: str, samples: int) -> None:
    """Raise GraphError if shaders store to an image whose format some devices cannot store."""
    if format not in (*STORABLE, STORED_RATES):
        raise GraphError(
            f"A shader cannot store to '{name}' in {format}: images that are stored to are {', '.join(STORABLE)}."
        )
    if samples > 1:
        raise GraphError(f"A shader cannot store to '{name}', which has {samples} samples a pixel.")
