"""The common base of a graph's images on both APIs: by slot, and by the names of the graph."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, TypeVar

from ...frames.frame import SLOTS
from ..types import PREVIOUS, Barrier, Graph, Resource

AnImage = TypeVar("AnImage")
ABuffer = TypeVar("ABuffer")


class ImagesInSlots(Generic[AnImage, ABuffer]):
    """The images and buffers of a graph: `in_slot[slot]` has them by the names of the resources.

    Images of a second graph can use the histories of a first one, the `lender`: then both graphs, in turn, continue the
    same histories. `borrowed` are the names of those histories. The images that created a history free it.
    """

    graph: Graph
    in_slot: list[dict[str, AnImage | ABuffer]]
    borrowed: frozenset[str] = frozenset()
    _objects: list[AnImage | ABuffer]
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

    def _add_history(
        self, resource: Resource, lender: Any, create: Callable[[Resource, str], AnImage | ABuffer]
    ) -> None:
        """Add the two images of a history to the slots: those of the lender, or new ones."""
        pair = self.borrow(resource, lender)
        name = resource.name
        if not pair:
            pair = [create(resource, f"{name}, parity {parity}") for parity in range(SLOTS)]
        for slot, resources in enumerate(self.in_slot):
            resources[name], resources[name + PREVIOUS] = pair[slot], pair[1 - slot]

    def borrow(
        self, resource: Resource, lender: ImagesInSlots[AnImage, ABuffer] | None
    ) -> list[AnImage | ABuffer]:
        """Return the two images of a history of the lender by slot; [] if it has no equal one that is used equally."""
        name = resource.name
        if lender is None or lender.graph.resources.get(name) != resource:
            return []
        if _uses(self.graph, name) != _uses(lender.graph, name):
            return []
        self.borrowed |= {name}
        return [lender.in_slot[slot][name] for slot in range(SLOTS)]

    def own(self, lender: ImagesInSlots[AnImage, ABuffer]) -> None:
        """Free what was borrowed from a lender, or from its lender, with these images, and not with the lender."""
        used = {id(it) for resources in self.in_slot for it in resources.values()}
        self._objects += [it for it in lender._objects if id(it) in used]
        lender._objects = [it for it in lender._objects if id(it) not in used]


def _uses(graph: Graph, name: str) -> list[tuple[Barrier, ...]]:
    """Return the barriers of a history, from before the first frame to the end of a frame: its states follow."""
    steps = (step.barriers for step in graph.steps)
    return [
        tuple(it for it in barriers if it.resource.removesuffix(PREVIOUS) == name)
        for barriers in (graph.prologue, *steps, graph.epilogue)
    ]
