"""What the executors of both APIs share: a step in one slot, and the images of others."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from backends.contract import Pass


@dataclass
class ReadyStep:
    """A step in one slot, as it is recorded; each API adds its barriers and attachments."""

    step: Any  # a `Step`, which has what an inspection asks of a pass: its name
    sources: Any = field(default=None, kw_only=True)
    """What the pass reads of other passes, bound; None where it reads nothing."""

    def enter(self, commands: Any, drawn_by: Pass) -> None:
        """Give the commands what the pass reads, and let the pass record what precedes its attachments."""
        commands.sources = self.sources
        commands.extent = self.step.size
        drawn_by.pre_render(commands)


def add_externals(images: Any, externals: Callable[[Any], list[Mapping[str, Any]]] | None) -> None:
    """Add the images and buffers of others to those of a graph, slot by slot."""
    if externals is not None:
        for held, more in zip(images.in_slot, externals(images), strict=True):
            held.update(more)
