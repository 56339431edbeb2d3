"""The bindings of compute passes on OpenGL: all declared accesses; compare vulkan_sets.py.

OpenGL numbers bindings by kind: the i-th texture that a pass declares is bound to unit i, and likewise for images and
blocks (the last argument of BIND in the shader). If a pass also reads the scene, its `sources` has the first number of
each kind.
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
"""The prefix of each kind in `interface_of`."""

_PUSH = _PLACES["uniform"] + "14"
"""The block of push constants (`backends.shader_text`)."""

_SCENE = [_PLACES["storage"] + number for number in ("12", "13", "14", "15")] + [_PLACES["image"] + "7"]
_SCENE += [_PLACES["uniform"] + "13"]
"""The scene's places behind the first ones of all others: more instances, light lists, shadows, fog (scene.glsl)."""


@dataclass(frozen=True)
class BoundSources:
    """The bindings before a pass: textures as (unit, view, sampler), images as (unit, image, access), and
    blocks."""

    textures: tuple[tuple[int, int, int], ...]
    images: tuple[tuple[int, Image, str], ...]
    blocks: tuple[tuple[Literal["storage", "uniform"], int, Buffer], ...]

    def bind(self, context: Context) -> None:
        """Bind all."""
        for unit, view, sampler in self.textures:
            context.fn.glBindTextureUnit(unit, view)
            context.fn.glBindSampler(unit, sampler)
        for unit, image, access in self.images:
            bind_storage_image(context, unit, image, access=access)
        for kind, binding, buffer in self.blocks:
            bind_buffer(context, kind, binding, buffer)


def _numbered(step: Step, gpu_pass: Pass, graph: Graph) -> list[tuple[int, Bound]]:
    """Return the bindings, each with its number within its kind."""
    numbers = Counter(gpu_pass.sources.first if gpu_pass.sources else {})
    numbered = []
    for bound in bindings_of(step, gpu_pass, graph):
        numbered.append((numbers[bound.kind], bound))
        numbers[bound.kind] += 1
    return numbered


def check_sources(context: Context, step: Step, gpu_pass: Pass, graph: Graph) -> None:
    """Raise GraphError if the program uses a binding that the pass does not declare."""
    bound = {f"{_PLACES[entry.kind]}{number}" for number, entry in _numbered(step, gpu_pass, graph)}
    first, (pipeline,) = gpu_pass.sources.first if gpu_pass.sources else {}, gpu_pass.pipelines
    for place, slot in interface_of(context, pipeline.handle).items():
        for kind, prefix in _PLACES.items():
            if not place.startswith(prefix) or place in bound or place in (_PUSH, *_SCENE):
                continue
            if int(place.removeprefix(prefix)) >= first.get(kind, 0):
                raise GraphError(
                    f"'{step.name}' declares nothing that is bound as {kind} {place.removeprefix(prefix)}, and "
                    f"{pipeline.code.name} has '{slot.name}' there: declare what it reads or writes."
                )


def sources(
    step: Step, gpu_pass: Pass, graph: Graph, objects: Mapping[str, Image | Buffer], sampler: int
) -> BoundSources:
    """Return the bindings of one slot; `objects` are its images and buffers by the names of the resources."""
    textures, images, blocks = [], [], []
    for number, bound in _numbered(step, gpu_pass, graph):
        resource = objects[bound.resource]
        if isinstance(resource, Buffer):
            kind: Literal["storage", "uniform"] = "uniform" if bound.kind == "uniform" else "storage"
            blocks.append((kind, number, resource))
        elif bound.kind == "texture":
            textures.append((number, resource.view, sampler))
        else:
            images.append((number, resource, "both" if bound.writes else "read"))
    return BoundSources(tuple(textures), tuple(images), tuple(blocks))
