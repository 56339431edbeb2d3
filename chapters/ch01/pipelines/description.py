"""Descriptions of pipelines, the same for both APIs.

`vulkan.py` builds a VkPipeline from a description; `gl.py` builds a program, and sets the other state before draws.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol

Kind = Literal["uniform", "storage", "texture"]
Front = Literal["counter_clockwise", "clockwise"]
"""The winding of front faces on the screen."""


@dataclass(frozen=True)
class Binding:
    """One binding of a descriptor set, and the stages whose shaders read it: all, or the fragment shader alone."""

    number: int
    kind: Kind
    stages: Literal["all", "fragment"] = "all"


@dataclass(frozen=True)
class PipelineDescription:
    """The description of a graphics pipeline.

    `sets` are the bindings of each descriptor set, and `streams` are (shader location, floats per vertex) of each
    vertex buffer. OpenGL uses neither: it binds resources one by one, by the numbers in the shaders.
    """

    shaders: tuple[str, ...]
    defines: tuple[tuple[str, int | float | str], ...] = ()
    sets: tuple[tuple[Binding, ...], ...] = ()
    streams: tuple[tuple[int, int], ...] = ()
    color: str | None = "rgba16f"
    depth: Literal["write", "test", "equal"] | None = "write"
    blend: Literal["over", "add"] | None = None
    samples: int = 1
    name: str = ""

    @property
    def title(self) -> str:
        """The name, or the files of the shaders if there is no name."""
        return self.name or " + ".join(self.shaders)


@dataclass(eq=False)
class Built:
    """A pipeline that can be bound.

    `handle` is the VkPipeline, or the name of the OpenGL program. It changes when a shader is edited, so commands read
    it at each bind. `layout` is the VkPipelineLayout, for descriptors and push constants. `code` is the compiled code
    of the handle, for a reload to compare.
    """

    described: PipelineDescription
    handle: Any
    code: Any
    layout: Any = None


class Pipelines(Protocol):
    """A backend's pipelines, built at their first use. Equal descriptions share one pipeline."""

    def get(self, descriptions: Sequence[PipelineDescription]) -> list[Built]:
        """Return one pipeline per description."""

    def __len__(self) -> int: ...

    @property
    def files(self) -> frozenset[Path]:
        """All files that the shaders of these pipelines depend on."""
