"""Pools of resources behind handles that know when they are stale.

A handle is a slot and the generation of its tenant. Destroying a resource raises the generation of the slot,
so a handle that outlives its resource is caught at its next use, where a plain index would silently reach the
next tenant.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Generic, TypeVar

from common.errors import StrataError

T = TypeVar("T")


class StaleHandleError(StrataError):
    """A handle was used after its resource was destroyed, or with a pool that did not make it."""


class PoolExhaustedError(StrataError):
    """A pool is full."""


@dataclass(frozen=True, slots=True)
class Handle:
    """Names one resource of one pool for as long as it lives; small, hashable, safe to copy and to keep."""

    pool: str
    index: int
    generation: int


class Pool(Generic[T]):
    """At most `capacity` resources of one kind, found by handle; `name` is the kind ("buffer")."""

    def __init__(self, name: str, capacity: int) -> None:
        self.name = name
        self.capacity = capacity
        self._resources: list[T | None] = []
        self._generations: list[int] = []
        self._free: list[int] = []

    def create(self, resource: T) -> Handle:
        """Put a resource in and return its handle; raises PoolExhaustedError if the pool is full."""
        if self._free:
            index = self._free.pop()  # the slot freed last: its entries are the likeliest to be in a cache
            self._resources[index] = resource
        elif len(self._resources) < self.capacity:
            index = len(self._resources)
            self._resources.append(resource)
            self._generations.append(0)
        else:
            raise PoolExhaustedError(
                f"the pool of {self.capacity} {self.name}s is full: destroy one or make it larger"
            )
        return Handle(self.name, index, self._generations[index])

    def get(self, handle: Handle) -> T:
        """Return the resource; raises StaleHandleError if it was destroyed or belongs to another pool."""
        self._check(handle)
        resource = self._resources[handle.index]
        assert resource is not None
        return resource

    def destroy(self, handle: Handle) -> T:
        """Take the resource out and return it; its handle is stale from now on."""
        resource = self.get(handle)
        self._resources[handle.index] = None
        self._generations[handle.index] += 1
        self._free.append(handle.index)
        return resource

    def is_alive(self, handle: Handle) -> bool:
        """Return whether `get` would find the resource."""
        return (
            handle.pool == self.name
            and handle.index < len(self._generations)
            and self._generations[handle.index] == handle.generation
        )

    def __len__(self) -> int:
        """Return the number of live resources."""
        return len(self._resources) - len(self._free)

    def items(self) -> Iterator[tuple[Handle, T]]:
        """Iterate over the live resources by slot: for teardown and for reports of leaks."""
        freed = set(self._free)
        for index, (resource, generation) in enumerate(zip(self._resources, self._generations, strict=True)):
            if index not in freed:
                assert resource is not None
                yield Handle(self.name, index, generation), resource

    def _check(self, handle: Handle) -> None:
        if handle.pool != self.name:
            raise StaleHandleError(f"a {handle.pool} handle was given to the pool of {self.name}s")
        if not self.is_alive(handle):
            raise StaleHandleError(
                f"{self.name} {handle.index} of generation {handle.generation} was destroyed before this use"
            )
