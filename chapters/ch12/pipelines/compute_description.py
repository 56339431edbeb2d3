"""The description of compute pipelines: one shader, and none of the state of draws."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ComputeDescription:
    """The description of a compute pipeline; the fields are as in `PipelineDescription`."""

    shader: str
    defines: tuple[tuple[str, int | float | str], ...] = ()
    specialization: tuple[tuple[str | int, int | float | bool], ...] = ()
    dynamic: tuple[str, ...] = ()
    name: str = ""

    @property
    def shaders(self) -> tuple[str, ...]:
        """The files of all stages."""
        return (self.shader,)

    @property
    def title(self) -> str:
        """The name, or the file of the shader if there is no name."""
        return self.name or self.shader
