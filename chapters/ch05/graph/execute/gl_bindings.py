"""What passes that compute bind on OpenGL: all that a pass declares; compare vulkan_sets.py.

OpenGL counts bindings by kind, so the i-th texture that a pass declares is bound to the i-th unit, and so are images
and blocks (the last argument of BIND in its shader). A pass that also reads the scene says in its `sources` with which
numbers its own begin.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from backends.contract import Pass
from backends.gl.context import Context
from backends.gl.program_interface import interface_of
from backends.gl.resources import Buffer, Image, bind_buffer, bind_storage_image

from ..types import Graph, GraphError, Step
from .bindings import Bound, bindings_of

_PLACES = {
    "texture": "texture unit ",
    "image": "image unit ",
    "storage": "storage block, binding ",
    "uniform": "uniform block, binding ",
}
"""How `interface_of` calls the places of each kind."""

_PUSH = _PLACES["uniform"] + "14"
"""The block of push constants (`backends.shader_text`)."""


@dataclass(frozen=True)
class BoundSources:
    """What is bound in front of a pass: textures as (unit, view, sampler), images as
    (unit, image, access), and blocks."""

    textures: tuple[tuple[int, int, int], ...]
    images: tuple[tuple[int, Image, str], ...]
    blocks: tuple[tuple[Literal["storage", "uniform"], int, Buffer], ...]

    def bind(self, context: Context) -> None:
        """Make the calls that bind them."""
        for unit, view, sampler in self.textures:
            context.fn.glBindTextureUnit(unit, view)
            context.fn.glBindSampler(unit, sampler)
        for unit, image, access in self.images:
            bind_storage_image(context, unit, image, access=access)
        for kind, binding, buffer in self.blocks:
            bind_buffer(context, kind, binding, buffer)


def _numbered(step: Step, made: Pass, graph: Graph) -> list[tuple[int, Bound]]:
    """Return what is bound, each with its number among those of its kind."""
    numbers = Counter(made.sources.first if made.sources else {})
    found = []
    for bound in bindings_of(step, made, graph):
        found.append((numbers[bound.kind], bound))
        numbers[bound.kind] += 1
    return found


def check_sources(context: Context, step: Step, made: Pass, graph: Graph) -> None:
    """Raise GraphError where the program of the pass reaches something that it does not declare."""
    bound = {f"{_PLACES[one.kind]}{number}" for number, one in _numbered(step, made, graph)}
    first, (pipeline,) = made.sources.first if made.sources else {}, made.pipelines
    for place, slot in interface_of(context, pipeline.handle).items():
        for kind, words in _PLACES.items():
            if not place.startswith(words) or place in bound or place == _PUSH:
                continue
            if int(place.removeprefix(words)) >= first.get(kind, 0):
                raise GraphError(
                    f"'{step.name}' declares nothing that is bound as {kind} {place.removeprefix(words)}, and "
                    f"{pipeline.code.name} has '{slot.name}' there: declare what it reads or writes."
                )


def sources(
    step: Step, made: Pass, graph: Graph, held: Mapping[str, Image | Buffer], sampler: int
) -> BoundSources:
    """Return what is bound in one slot; `held` is what is behind the names of resources there."""
    textures, images, blocks = [], [], []
    for number, bound in _numbered(step, made, graph):
        one = held[bound.resource]
        if isinstance(one, Buffer):
            kind: Literal["storage", "uniform"] = "uniform" if bound.kind == "uniform" else "storage"
            blocks.append((kind, number, one))
        elif bound.kind == "texture":
            textures.append((number, one.view, sampler))
        else:
            images.append((number, one, "both" if bound.writes else "read"))
    return BoundSources(tuple(textures), tuple(images), tuple(blocks))
