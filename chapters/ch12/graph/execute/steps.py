"""The common parts of the executors of both APIs: a step in one slot, and external resources."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from backends.contract import Pass


@dataclass
class ReadyStep:
    """A step in one slot, ready to be recorded; each API adds its barriers and attachments."""

    step: Any  # a `Step`; an inspection reads its name
    sources: Any = field(default=None, kw_only=True)
    """The bound results of other passes; None if the pass reads none."""

    def enter(self, commands: Any, gpu_pass: Pass) -> None:
        """Pass the sources to the commands, and record the commands of the pass before its attachments."""
        commands.sources = self.sources
        commands.extent = self.step.size
        gpu_pass.pre_render(commands)


def add_externals(images: Any, externals: Callable[[Any], list[Mapping[str, Any]]] | None) -> None:
    """Add external images and buffers to the resources of a graph, slot by slot."""
    if externals is not None:
        for resources, added in zip(images.in_slot, externals(images), strict=True):
            resources.update(added)
