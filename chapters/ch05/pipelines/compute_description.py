"""What a compute pipeline is made of: one shader and nothing else, so most of what draws have falls away."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ComputeDescription:
    """What a compute pipeline is made of; the words are those of `PipelineDescription`."""

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
        """The name, or the file of the shader where there is none."""
        return self.name or self.shader
