"""The common base of a graph's images on both APIs: by slot, and by the names of the graph."""

from __future__ import annotations

from typing import Generic, TypeVar

from ..types import Graph

AnImage = TypeVar("AnImage")
ABuffer = TypeVar("ABuffer")


class ImagesInSlots(Generic[AnImage, ABuffer]):
    """The images and buffers of a graph: `in_slot[slot]` has them by the names of the resources."""

    in_slot: list[dict[str, AnImage | ABuffer]]
    kind: type[AnImage]
    """The class of the API's images."""

    def image(self, slot: int, name: str) -> AnImage:
        """Return the image of a resource in a slot."""
        resource = self.in_slot[slot][name]
        assert isinstance(resource, self.kind), name
        return resource

    def by_name(self, graph: Graph, slot: int = 0) -> dict[str, AnImage]:
        """Return the images of a slot by all of their names in the graph."""
        resources = {name: self.in_slot[slot].get(of) for name, of in graph.names.items()}
        return {name: image for name, image in resources.items() if isinstance(image, self.kind)}
