"""What a compute pass binds: everything that it declares to read and to write, in that order, in one set.

A pass that draws reaches its targets as attachments and binds only what it samples. A kernel reaches all through
bindings, so what it declares is the table of its set: binding i is the i-th access, reads first.

    sampled                       a texture with its sampler
    storage of an image           an image that is loaded and stored
    storage, uniform of a buffer  a block
    indirect, copy                nothing: no shader reads them by name
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from backends.contract import Pass

from ...pipelines.spirv.declared import Kind
from ..types import PREVIOUS, Graph, GraphError, Step

STORABLE = ("rgba8", "rgba16f", "rgba32f", "r32f", "r32ui")
"""The formats in which shaders of every device can store (Vulkan specification, "Required Format Support")."""


@dataclass(frozen=True)
class Bound:
    """An access that is bound: what the step calls the resource, as what a shader sees it, and whether it writes."""

    resource: str
    kind: Kind
    writes: bool


def bindings_of(step: Step, made: Pass, graph: Graph) -> list[Bound]:
    """Return what a step that computes binds, in the order of the bindings; `made` is its pass."""
    found = []
    for writes, accesses, names in ((False, made.reads, step.reads), (True, made.writes, step.writes)):
        for access, name in zip(accesses, names, strict=True):
            kind: Kind | None = None
            if access.use == "sampled":
                kind = "texture"
            elif access.use == "uniform":
                kind = "uniform"
            elif access.use == "storage":
                buffer = graph.resources[name.removesuffix(PREVIOUS)].kind == "buffer"
                kind = "storage" if buffer else "image"
            if kind is not None:
                found.append(Bound(name, kind, writes))
    return found


def check_table(step: str, bound: Sequence[Bound], table: Mapping[int, tuple[str, str]], shader: str) -> None:
    """Raise GraphError where a shader's set is not what the pass of `step` declares.

    `table` has by binding the kind and the name of what the shader declares there. A binding that the shader leaves
    out is one that it does not use.
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
        one = bound[number]
        if kind != one.kind:
            raise GraphError(
                f"'{step}' binds '{one.resource}' as {one.kind} at binding {number}, where {shader} has the {kind} "
                f"'{name}': bindings follow the order of reads, then writes."
            )


def check_stored(name: str, format: str, samples: int) -> None:
    """Raise GraphError for an image that a shader stores to, in a format in which not every device can."""
    if format not in STORABLE:
        raise GraphError(
            f"A shader cannot store to '{name}' in {format}: images that are stored to are {', '.join(STORABLE)}."
        )
    if samples > 1:
        raise GraphError(f"A shader cannot store to '{name}', which has {samples} samples a pixel.")
