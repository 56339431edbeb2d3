"""Pipelines whose shaders are edited while they run: the stages of each, and whether new ones can take their place."""

from __future__ import annotations

import contextlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from backends.shader_interface import Interface, misfit, refusal
from backends.shader_text import ShaderSource, build
from backends.vulkan.shaders.compiler import compile_all
from backends.vulkan.shaders.spirv_interface import interface_of, unwritten
from common.errors import ShaderError


@dataclass(eq=False)
class Stages:
    """The shaders of one pipeline, compiled: their SPIR-V in the order of its stages, and the files they came from."""

    sources: tuple[ShaderSource, ...] = field(repr=False)
    codes: tuple[bytes, ...] = field(repr=False)
    expects: Interface | None = field(default=None, repr=False)
    """What the host was made for; found out at the first edit, and the same from then on."""

    @property
    def files(self) -> frozenset[Path]:
        """All on disk that decides about their texts."""
        return frozenset[Path]().union(*(source.paths for source in self.sources))

    def use(self, files: Collection[Path]) -> bool:
        """Whether one of `files` decides about their texts."""
        return any(path in source.paths for source in self.sources for path in files)

    @property
    def by_stage(self) -> dict[str, bytes]:
        """The SPIR-V of each stage by its name, with a number where a pipeline of rays has several of one stage."""
        names = [source.stage for source in self.sources]
        places = [
            f" {names[:place].count(name)}" if name in names[:place] else ""
            for place, name in enumerate(names)
        ]
        return {name + place: code for name, place, code in zip(names, places, self.codes, strict=True)}


def compile_stages(sources: Sequence[Sequence[ShaderSource]], keep: bool = True) -> list[Stages]:
    """Return the compiled stages of several pipelines; an error knows every file on which they depend.

    Without `keep` no cache grows: for texts that live until the next edit.
    """
    try:
        codes = iter(compile_all([source for stages in sources for source in stages], keep))
    except ShaderError as error:
        error.files |= {path for stages in sources for source in stages for path in source.paths}
        raise
    return [Stages(tuple(stages), tuple(next(codes) for _ in stages)) for stages in sources]


def check_fit(old: Stages, new: Stages, changed: Collection[Path]) -> None:
    """Raise ShaderError where `new` expects of the host what `old` did not; `changed` are the edited files."""
    if old.expects is None:
        old.expects = interface_of(old.by_stage)
    difference = misfit(old.expects, interface_of(new.by_stage)) or unwritten(new.by_stage)
    if difference:
        raise refusal(difference, old.files & {*changed} or changed, new.files)
    new.expects = old.expects


def compiled_alone(files: Collection[Path]) -> dict[Path, Stages]:
    """Return the shaders in these files, each as a pipeline of its own; without those that need constants of a host."""
    compiled = {}
    for path in files:
        with contextlib.suppress(ShaderError):
            compiled[path] = compile_stages([[build(path, "vulkan")]], keep=False)[0]
    return compiled


def check_alone(before: Mapping[Path, Stages], changed: Collection[Path]) -> None:
    """Raise ShaderError where a shader of `compiled_alone` was edited and does not compile or fit any more."""
    for path, old in before.items():
        check_fit(old, compile_stages([[build(path, "vulkan")]], keep=False)[0], changed)
