"""The description of ray-tracing pipelines: the shaders of a ray's whole way, in groups.

`vkCmdTraceRaysKHR` runs the ray generation shader once for each ray of the picture. `traceRayEXT` looks for a hit: the
hit group of the surface says how (an intersection shader for what is no triangle, an any-hit shader for what may let
the ray pass), and its closest-hit shader runs at the end; a miss shader runs where nothing is hit. Callable shaders run
at `executeCallableEXT`. Shaders refer to groups by their places in the lists below.
"""

from __future__ import annotations

from dataclasses import dataclass

from common.errors import ShaderError

RECURSION = 1
"""Rays that may be under way at once: shaders of hits trace none, and the limit of every device is at least 1."""


@dataclass(frozen=True)
class HitGroup:
    """The shaders of one kind of surface, "" for none. With an `intersection` the surface is procedural."""

    closest: str = ""
    any: str = ""
    intersection: str = ""

    @property
    def shaders(self) -> tuple[str, ...]:
        """The files of the group, in the order of the fields."""
        return tuple(file for file in (self.closest, self.any, self.intersection) if file)


@dataclass(frozen=True)
class RayDescription:
    """The description of a ray-tracing pipeline; the fields that other pipelines have are as in `PipelineDescription`.

    `recursion` is the depth of rays that start other rays. With `linked` each group is compiled as a library of its
    own, and the pipeline is linked from those; pixels are the same. The largest payload and the largest attributes of
    hits, in bytes, are part of what libraries must agree about.
    """

    raygen: str
    miss: tuple[str, ...] = ()
    hits: tuple[HitGroup, ...] = ()
    callables: tuple[str, ...] = ()
    name: str = ""
    defines: tuple[tuple[str, int | float | str], ...] = ()
    dynamic: tuple[str, ...] = ()
    specialization: tuple[tuple[str | int, int | float | bool], ...] = ()
    recursion: int = RECURSION
    linked: bool = False
    payload_bytes: int = 32
    attribute_bytes: int = 8

    @property
    def shaders(self) -> tuple[str, ...]:
        """The files of all stages, each once: ray generation, miss shaders, hit groups, callables."""
        of_hits = (file for group in self.hits for file in group.shaders)
        return tuple(dict.fromkeys((self.raygen, *self.miss, *of_hits, *self.callables)))

    @property
    def title(self) -> str:
        """The name, or the file of the ray generation shader if there is none."""
        return self.name or self.raygen

    def check(self, deepest: int) -> None:
        """Raise ShaderError for a recursion that a device, whose limit is `deepest`, does not have."""
        if not 1 <= self.recursion <= deepest:
            raise ShaderError(
                f"{self.title} traces rays {self.recursion} deep, and this device has 1 to {deepest}: trace in a loop "
                "in the ray generation shader."
            )
