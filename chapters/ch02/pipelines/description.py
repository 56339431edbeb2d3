"""What a pipeline is made of, in plain words: one description for both APIs.

`vulkan.py` builds a VkPipeline from it; `gl.py` builds a program, and sets the rest before it draws.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol

Front = Literal["counter_clockwise", "clockwise"]
"""How the corners of front faces follow one another on the screen."""


@dataclass(frozen=True)
class PipelineDescription:
    """What a pipeline is made of. What it reads, its shaders say themselves.

    `specialization` gives constants of theirs, by name or id, the values that they are compiled with; what OpenGL
    draws too takes a define in its place. `dynamic` names buffers whose offset comes with the bind. `color` may be
    several formats: of as many targets, blended alike.
    """

    shaders: tuple[str, ...]
    defines: tuple[tuple[str, int | float | str], ...] = ()
    specialization: tuple[tuple[str | int, int | float | bool], ...] = ()
    dynamic: tuple[str, ...] = ()
    color: str | tuple[str, ...] | None = "rgba16f"
    depth: Literal["write", "test", "equal"] | None = "write"
    blend: Literal["over", "add"] | None = None
    samples: int = 1
    name: str = ""

    @property
    def title(self) -> str:
        """The name, or the files of the shaders where there is none."""
        return self.name or " + ".join(self.shaders)

    @property
    def colors(self) -> tuple[str, ...]:
        """The format of each colour target."""
        return (self.color,) if isinstance(self.color, str) else self.color or ()


@dataclass(eq=False)
class Built:
    """A pipeline that can be bound.

    `handle` is the VkPipeline, or OpenGL's number of the program. It changes when a shader was edited, so commands
    read it at each bind. `code` is what the handle was built from; a reload compares it. The rest is Vulkan's: the
    VkPipelineLayout, the layouts of the sets by number (None where no shader uses one), and the stages to be named when
    constants are pushed (0 where the pipeline takes none).
    """

    described: PipelineDescription
    handle: Any
    code: Any
    layout: Any = None
    sets: tuple[Any, ...] = ()
    push_stages: int = 0


class Pipelines(Protocol):
    """A backend's pipelines, built at their first use. Equal descriptions share one."""

    def get(self, wanted: Sequence[PipelineDescription]) -> list[Built]:
        """Return one pipeline per description."""

    def __len__(self) -> int: ...

    @property
    def files(self) -> frozenset[Path]:
        """All on disk that decides about the shaders of these pipelines."""
