"""The textures and buffers behind a compiled frame graph; compare vulkan_images.py.

OpenGL does not let anybody say where memory lies. What is left of sharing is to give one texture to two resources that
are alike and never needed at the same time. `graph.memory` tells what is saved where memory can be placed; `size` and
`alone` here tell what is saved really.
"""

from __future__ import annotations

from collections import defaultdict
from typing import Any

from backends.gl.context import Context
from backends.gl.resources import (
    Buffer,
    Image,
    create_buffer,
    create_image,
    destroy_buffer,
    destroy_image,
)

from ...frames.frame import SLOTS
from ..frame_graph import texels
from ..types import PREVIOUS, Graph, Resource
from .images import ImagesInSlots


def sharing(graph: Graph, alias: bool = True) -> dict[str, str]:
    """Return for each transient whose texture or buffer it uses: its own, or that of one which is over by then.

    Alike are those of one format, size and number of samples, or buffers of equal size. Taken in the order in which
    their lives begin, each finds one that is free if there is any, so none is made that could be spared.
    """
    lives = graph.memory.lives
    owner: dict[str, str] = {}
    free_after: dict[Any, dict[str, int]] = defaultdict(dict)
    for name in sorted(lives, key=lambda name: (lives[name], name)):
        one, (first, last) = graph.resources[name], lives[name]
        alike = free_after[one.format, one.size, one.samples, one.bytes]
        found = [other for other, until in alike.items() if until < first]
        owner[name] = found[0] if found and alias else name
        alike[owner[name]] = last
    return owner


class GraphImages(ImagesInSlots[Image, Buffer]):
    """The images and buffers of a graph."""

    kind = Image

    def __init__(self, context: Context, graph: Graph, alias: bool = True) -> None:
        self._context = context
        self._made: list[Image | Buffer] = []
        self.in_slot: list[dict[str, Image | Buffer]] = [{} for _ in range(SLOTS)]
        self._owner = sharing(graph, alias)
        sizes = {name: texels(graph.resources[name]).size for name in self._owner}
        self.alone = sum(sizes.values())
        """Bytes that the transients would take, each in memory of its own."""
        self.size = sum(sizes[owner] for owner in {*self._owner.values()})
        """Bytes that they take."""
        try:
            for resource in graph.resources.values():
                self._make(resource)
            for held in self.in_slot:
                held |= {name: held[owner] for name, owner in self._owner.items()}
        except BaseException:
            self.close()
            raise

    def _make(self, resource: Resource) -> None:
        name = resource.name
        if resource.life == "external" or self._owner.get(name, name) != name:
            return
        if resource.life == "history":
            pair = [self._create(resource, f"{name}, parity {parity}") for parity in range(SLOTS)]
            for slot, held in enumerate(self.in_slot):
                held[name], held[name + PREVIOUS] = pair[slot], pair[1 - slot]
            return
        made = self._create(
            resource, ", ".join([one for one in self._owner if self._owner[one] == name] or [name])
        )
        for held in self.in_slot:
            held[name] = made

    def _create(self, resource: Resource, name: str) -> Image | Buffer:
        made: Image | Buffer
        if resource.kind == "buffer":
            made = create_buffer(self._context, resource.bytes, "device", name)
        else:
            assert resource.format is not None and resource.size is not None, resource
            made = create_image(self._context, resource.format, resource.size, name, samples=resource.samples)
        self._made.append(made)
        return made

    def close(self) -> None:
        """Free what was made; OpenGL itself waits for the GPU's use."""
        for made in self._made:
            if isinstance(made, Image):
                destroy_image(self._context, made)
            else:
                destroy_buffer(self._context, made)
        self._made = []
