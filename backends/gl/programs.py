"""Programs from the GLSL text that Vulkan's shaders are built from; mistakes are shown as on Vulkan.

moderngl compiles and links. OpenGL takes text, not SPIR-V: names survive and messages name their line. The driver keeps
compiled programs on disk by itself.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from backends.gl import api as gl
from backends.gl.context import Context
from backends.gl.driver.capabilities import SAMPLERS, STORAGE_BUFFERS
from backends.gl.program_interface import interface_of
from backends.shader_interface import Interface, misfit, refusal
from backends.shader_text import ShaderSource, describe_errors
from common.errors import ShaderError

_ARGUMENTS = {
    "vert": "vertex_shader",
    "tesc": "tess_control_shader",
    "tese": "tess_evaluation_shader",
    "geom": "geometry_shader",
    "frag": "fragment_shader",
}
_REFERENCED = {
    "vert": gl.GL_REFERENCED_BY_VERTEX_SHADER,
    "tesc": gl.GL_REFERENCED_BY_TESS_CONTROL_SHADER,
    "tese": gl.GL_REFERENCED_BY_TESS_EVALUATION_SHADER,
    "geom": gl.GL_REFERENCED_BY_GEOMETRY_SHADER,
    "frag": gl.GL_REFERENCED_BY_FRAGMENT_SHADER,
    "comp": gl.GL_REFERENCED_BY_COMPUTE_SHADER,
}
_WORD = re.compile(r"\w+")
_HEADING = re.compile(r"^(\w+)\n=+\n", re.M)  # of moderngl's: "vertex_shader" and a line below it


@dataclass(eq=False)
class Program:
    """A linked program: `handle` is for raw calls, `mgl` the same one for moderngl's; `files` decide about its code."""

    handle: int
    mgl: Any
    name: str
    files: frozenset[Path] = field(default=frozenset(), repr=False)
    text: str = field(default="", repr=False)
    """The shaders that the host was made for; they stay so from edit to edit."""
    expects: Interface | None = field(default=None, repr=False)
    """What of the host they use, asked from the driver when a shader is edited."""


class Programs:
    """Links programs at their first use and keeps them: the same stages and text give the same program."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._made: dict[tuple[str, ...], Program] = {}
        self.linked = 0
        """Programs that were linked so far."""

    def __len__(self) -> int:
        return len(self._made)

    def get(self, sources: Sequence[ShaderSource], name: str = "") -> Program:
        """Return the program of these stages: a vertex shader, alone or with those that follow it, or one of compute.

        The sources were built for "gl". Raises ShaderError with file, line, caret and chain of includes, also for a
        stage that uses more than 12 storage buffers or 16 samplers.
        """
        key = tuple(source.key for source in sources)
        if key not in self._made:
            self._made[key] = self._link(sources, name or " + ".join(source.name for source in sources))
        self._made[key].files |= {path for source in sources for path in source.paths}
        return self._made[key]

    def exchange(
        self, old: Sequence[Program], sources: Sequence[Sequence[ShaderSource]], changed: Collection[Path]
    ) -> list[Program]:
        """Return programs of edited sources in place of `old` ones, which are freed; all of them, or none.

        `changed` are the edited files. Raises ShaderError as `get` does, and for what no longer fits its host.
        """
        before = set(self._made)
        try:
            new = [self.get(text, was.name) for was, text in zip(old, sources, strict=True)]
            self._check_fit(old, new, changed)
        except ShaderError as error:
            error.files |= {path for text in sources for source in text for path in source.paths}
            for key in [key for key in self._made if key not in before]:
                self._free(self._made.pop(key))
            raise
        gone = {*old} - {*new}
        for key in [key for key, program in self._made.items() if program in gone]:
            self._free(self._made.pop(key))
        return new

    def _check_fit(self, old: Sequence[Program], new: Sequence[Program], changed: Collection[Path]) -> None:
        """Refuse programs that expect of their host what it was not made for."""
        context = self._context
        for program in self._made.values():
            if program.expects is None and program not in new:
                program.expects = interface_of(context, program.handle)
        # OpenGL lists what a program uses, not what it declares. What it declared and only another one used is bound.
        elsewhere = [
            item for program in self._made.values() if program.expects for item in program.expects.items()
        ]
        for was, program in zip(old, new, strict=True):
            now = interface_of(context, program.handle)
            known = was.expects or now
            words = {*_WORD.findall(was.text)}
            declared = {place for place, slot in now.items() if slot.name.split("[")[0] in words}
            difference = misfit(known, now, [item for item in elsewhere if item[0] in declared])
            if difference:
                raise refusal(difference, was.files & {*changed} or changed)
            program.expects, program.text = {**now, **known}, was.text

    def _link(self, sources: Sequence[ShaderSource], name: str) -> Program:
        mgl = self._context.mgl
        try:
            if [source.stage for source in sources] == ["comp"]:
                linked = mgl.compute_shader(sources[0].text)
            else:
                linked = mgl.program(**{_ARGUMENTS[source.stage]: source.text for source in sources})
        except KeyError as error:
            raise ShaderError(f"{name}: OpenGL takes no shaders of the stage {error}.") from None
        except _refusal() as error:
            raise ShaderError(_explain(str(error), sources)) from None
        self.linked += 1
        program = Program(int(linked.glo), linked, name, text="\n".join(source.text for source in sources))
        self._context.adopt("program", program.handle, name)
        try:
            for source in sources:
                self._check_discipline(program, source)
        except ShaderError:
            self._free(program)
            raise
        return program

    def _check_discipline(self, program: Program, source: ShaderSource) -> None:
        """Refuse what another driver or the other backend could not bind."""
        stage = _REFERENCED[source.stage]
        blocks = self._count(program, gl.GL_SHADER_STORAGE_BLOCK, stage, samplers=False)
        if blocks > STORAGE_BUFFERS:
            raise ShaderError(
                f"{source.name} uses {blocks} storage buffers; a stage may use {STORAGE_BUFFERS}: put some together."
            )
        samplers = self._count(program, gl.GL_UNIFORM, stage, samplers=True)
        if samplers > SAMPLERS:
            raise ShaderError(f"{source.name} uses {samplers} samplers; a stage may use {SAMPLERS}.")

    def _count(self, program: Program, interface: int, stage: int, *, samplers: bool) -> int:
        """Return how many resources of a kind a stage uses; arrays of samplers count with their length."""
        fn, out = self._context.fn, gl.ffi.new("GLint[3]")
        fn.glGetProgramInterfaceiv(program.handle, interface, gl.GL_ACTIVE_RESOURCES, out)
        wanted = [stage, gl.GL_TYPE, gl.GL_ARRAY_SIZE] if samplers else [stage]
        properties = gl.ffi.new("GLenum[]", wanted)
        total = 0
        for index in range(out[0]):
            fn.glGetProgramResourceiv(
                program.handle, interface, index, len(wanted), properties, 3, gl.NULL, out
            )
            if out[0] and not samplers:
                total += 1
            elif out[0] and _is_sampler(out[1]):
                total += out[2]
        return total

    def _free(self, program: Program) -> None:
        self._context.destroy("program", program.handle)
        program.mgl.release()

    def close(self) -> None:
        """Free every program."""
        for program in self._made.values():
            self._free(program)
        self._made.clear()


_SAMPLER_TYPES = (
    range(0x8B5D, 0x8B65),  # sampler1D to sampler2DRectShadow
    range(0x8DC0, 0x8DC6),  # arrays, buffers, cube shadows
    range(0x8DC9, 0x8DD9),  # isampler and usampler
    range(0x900C, 0x9010),  # cube arrays
    range(0x9108, 0x910E),  # multisampled
)
"""The runs in which the types of samplers lie in `gl.xml`."""


def _is_sampler(kind: int) -> bool:
    return any(kind in run for run in _SAMPLER_TYPES)


def _refusal() -> type[Exception]:
    """Return moderngl's exception for a shader that it cannot compile or link."""
    import moderngl

    error: type[Exception] = moderngl.Error
    return error


def _explain(log: str, sources: Sequence[ShaderSource]) -> str:
    """Return moderngl's log with the places in the files of the stage that is wrong."""
    heading = _HEADING.search(log)
    stages = {argument: stage for stage, argument in _ARGUMENTS.items()} | {"compute_shader": "comp"}
    stage = stages.get(heading[1]) if heading else None
    wrong = [source for source in sources if source.stage == stage] or list(sources)
    body = log[heading.end() :] if heading else log
    return describe_errors(body.replace("\0", "").strip(), wrong[0])
