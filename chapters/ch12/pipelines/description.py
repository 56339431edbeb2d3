"""Descriptions of pipelines, the same for both APIs.

`vulkan.py` builds a VkPipeline from a description; `gl.py` builds a program, and sets the other state before draws.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol

from .compute_description import ComputeDescription
from .ray_description import RayDescription

Front = Literal["counter_clockwise", "clockwise"]
"""The winding of front faces on the screen."""


@dataclass(frozen=True)
class PipelineDescription:
    """The description of a graphics pipeline. Its bindings are read from its shaders.

    `specialization` sets the values of specialization constants, by name or id (specialization.py). `dynamic` names
    buffers whose offset is given at each bind. `color` may be several formats, one for each target; all targets have
    the same blending. `by_rates` is for draws with a mask of shading rates.
    """

    shaders: tuple[str, ...]
    defines: tuple[tuple[str, int | float | str], ...] = ()
    specialization: tuple[tuple[str | int, int | float | bool], ...] = ()
    dynamic: tuple[str, ...] = ()
    color: str | tuple[str, ...] | None = "rgba16f"
    depth: Literal["write", "test", "equal"] | None = "write"
    blend: Literal["over", "add", "weighted"] | None = None
    samples: int = 1
    name: str = ""
    by_rates: bool = False

    @property
    def title(self) -> str:
        """The name, or the files of the shaders if there is no name."""
        return self.name or " + ".join(self.shaders)

    @property
    def colors(self) -> tuple[str, ...]:
        """The format of each colour target."""
        return (self.color,) if isinstance(self.color, str) else self.color or ()


Described = PipelineDescription | ComputeDescription | RayDescription


@dataclass(eq=False)
class Built:
    """A pipeline that can be bound.

    `handle` is the VkPipeline, or the name of the OpenGL program. It changes when a shader is edited, so commands read
    it at each bind. `code` is the compiled code of the handle, for a reload to compare. The others are for Vulkan: the
    VkPipelineLayout, the layouts of the sets by number (None for a set that no shader uses), and the stages of the push
    constants (0 if there are none).
    """

    described: Described
    handle: Any
    code: Any
    layout: Any = None
    sets: tuple[Any, ...] = ()
    push_stages: int = 0
    group: tuple[int, int, int] = (1, 1, 1)
    """Invocations of a work group along each axis, for a compute pipeline."""
    table: Any = None
    """The shader binding table of a ray pipeline on Vulkan; None for all others."""


class Pipelines(Protocol):
    """A backend's pipelines, built at their first use. Equal descriptions share one pipeline."""

    def get(self, descriptions: Sequence[Described]) -> list[Built]:
        """Return one pipeline per description."""

    def __len__(self) -> int: ...

    @property
    def files(self) -> frozenset[Path]:
        """All files that the shaders of these pipelines depend on."""
