"""The textures and buffers of a compiled frame graph; compare vulkan_images.py.

OpenGL has no placement of memory. So two resources can share memory only as one texture: they must be equal in format
and size, with disjoint lifetimes. `graph.memory` has the sizes with placement; `size` and `alone` here are the real
sizes.
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
from ..types import Graph, Resource
from .images import ImagesInSlots


def sharing(graph: Graph, alias: bool = True) -> dict[str, str]:
    """Return for each transient the owner of its texture or buffer: itself, or a transient whose life has ended.

    Two can share if format, size and sample count are equal, or for buffers the size. Objects are assigned in the order
    in which lives begin, and each transient gets a free object if there is one. So the number of objects is minimal.
    """
    lives = graph.memory.lives
    owner: dict[str, str] = {}
    free_after: dict[Any, dict[str, int]] = defaultdict(dict)
    for name in sorted(lives, key=lambda name: (lives[name], name)):
        resource, (first, last) = graph.resources[name], lives[name]
        alike = free_after[resource.format, resource.size, resource.slices, resource.samples, resource.bytes]
        free = [other for other, until in alike.items() if until < first]
        owner[name] = free[0] if free and alias else name
        alike[owner[name]] = last
    return owner


class GraphImages(ImagesInSlots[Image, Buffer]):
    """The images and buffers of a graph, with histories of a `lender` or of its own."""

    kind = Image

    def __init__(
        self, context: Context, graph: Graph, alias: bool = True, lender: GraphImages | None = None
    ) -> None:
        self._context, self.graph, self._lender = context, graph, lender
        self._objects: list[Image | Buffer] = []
        self.in_slot: list[dict[str, Image | Buffer]] = [{} for _ in range(SLOTS)]
        self._owner = sharing(graph, alias)
        sizes = {name: texels(graph.resources[name]).size for name in self._owner}
        self.alone = sum(sizes.values())
        """Bytes that the transients would take without sharing."""
        self.size = sum(sizes[owner] for owner in {*self._owner.values()})
        """Bytes that the transients take."""
        try:
            for resource in graph.resources.values():
                self._make(resource)
            for resources in self.in_slot:
                resources |= {name: resources[owner] for name, owner in self._owner.items()}
        except BaseException:
            self.close()
            raise

    def _make(self, resource: Resource) -> None:
        name = resource.name
        if resource.life == "external" or self._owner.get(name, name) != name:
            return
        if resource.life == "history":
            self._add_history(resource, create=self._create, lender=self._lender)
            return
        image_or_buffer = self._create(
            resource, ", ".join([user for user in self._owner if self._owner[user] == name] or [name])
        )
        for resources in self.in_slot:
            resources[name] = image_or_buffer

    def _create(self, resource: Resource, name: str) -> Image | Buffer:
        image_or_buffer: Image | Buffer
        if resource.kind == "buffer":
            image_or_buffer = create_buffer(self._context, resource.bytes, "device", name)
        else:
            assert resource.format is not None and resource.size is not None, resource
            image_or_buffer = create_image(
                self._context,
                resource.format,
                resource.size,
                name,
                shape="3d" if resource.slices else "2d",
                layers=max(1, resource.slices),
                samples=resource.samples,
            )
        self._objects.append(image_or_buffer)
        return image_or_buffer

    def close(self) -> None:
        """Free all objects; OpenGL keeps their memory until the GPU has used it."""
        for image_or_buffer in self._objects:
            if isinstance(image_or_buffer, Image):
                destroy_image(self._context, image_or_buffer)
            else:
                destroy_buffer(self._context, image_or_buffer)
        self._objects = []
