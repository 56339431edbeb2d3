"""Pipelines on OpenGL: a program, and the state that has to be set before draws.

Equal descriptions share one pipeline. `bind` sets all of its state, since the context keeps the state of other users.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path

from backends import shader_text
from backends.gl import api as gl
from backends.gl.context import FRONT_FACES, Context
from backends.gl.draws import create_vertex_array
from backends.gl.programs import Program, Programs
from backends.shader_text import ShaderSource
from common.layouts import SNIPPETS

from .compute_description import ComputeDescription
from .description import Built, Described, Front, PipelineDescription
from .gl_compute import group_of, subgroup_sizes
from .gl_specialization import specialized
from .specialization import SUBGROUP_SIZE, Values

CHAPTER = Path(__file__).resolve().parents[1]


class Pipelines:
    """Builds pipelines at their first use and keeps them. All shaders get the additional `defines`, and `constants` if
    they declare specialization constants of these names."""

    def __init__(
        self, context: Context, defines: Sequence[tuple[str, int | float | str]] = (), constants: Values = ()
    ) -> None:
        self._context, self._defines = context, defines
        self._constants = (*constants, *((SUBGROUP_SIZE, size) for size in subgroup_sizes(context)))
        self._programs = Programs(context)
        self._built: dict[Described, Built] = {}
        self.no_vertices = create_vertex_array(context, [], None, None, "no vertices")
        """The vertex array of draws that read no vertices; OpenGL requires a bound one."""

    def __len__(self) -> int:
        return len(self._built)

    def get(self, descriptions: Sequence[Described]) -> list[Built]:
        """Return one pipeline per description."""
        for described in descriptions:
            if described not in self._built:
                program = self._programs.get(self._sources(described), described.name)
                self._built[described] = Built(
                    described, program.handle, program, group=self._group(described, program)
                )
        return [self._built[described] for described in descriptions]

    def _group(self, described: Described, program: Program) -> tuple[int, int, int]:
        computes = isinstance(described, ComputeDescription)
        return group_of(self._context, program) if computes else (1, 1, 1)

    def _sources(self, described: Described) -> list[ShaderSource]:
        defines = dict((*described.defines, *self._defines))
        sources = [
            shader_text.build(CHAPTER / file, "gl", roots=(CHAPTER,), defines=defines, snippets=SNIPPETS)
            for file in described.shaders
        ]
        return specialized(sources, described.specialization, self._constants)

    @property
    def files(self) -> frozenset[Path]:
        """All files that the shaders of these pipelines depend on."""
        return frozenset().union(*(built.code.files for built in self._built.values()))

    def reload(self, changed: Collection[Path]) -> tuple[str, ...]:
        """Relink the programs whose code depends on a file of `changed`: all, or none after an error.

        Returns their pipelines' names. Raises ShaderError for a shader that does not compile, or that no longer fits
        its bindings.
        """
        old = [built for built in self._built.values() if built.code.files & set(changed)]
        sources = [self._sources(built.described) for built in old]
        new = self._programs.exchange([built.code for built in old], sources, changed)
        anew = [pair for pair in zip(old, new, strict=True) if pair[0].code is not pair[1]]
        for built, program in anew:
            built.handle, built.code = program.handle, program
            built.group = self._group(built.described, program)
        return tuple(built.described.name for built, _ in anew)

    def bind(self, pipeline: Built, cull: bool, front: Front) -> None:
        """Bind `pipeline` for the next draws; `cull` discards back faces, `front` is the winding of front faces."""
        fn, described = self._context.fn, pipeline.described
        assert isinstance(described, PipelineDescription), "what computes is bound as such"
        fn.glUseProgram(pipeline.handle)
        _switch(fn, gl.GL_CULL_FACE, cull)
        fn.glFrontFace(FRONT_FACES[front])
        _switch(fn, gl.GL_DEPTH_TEST, described.depth is not None)
        # Reversed z: the near plane is 1, infinity 0, and nearer is greater; see pipelines/vulkan.py.
        fn.glDepthFunc(gl.GL_EQUAL if described.depth == "equal" else gl.GL_GEQUAL)
        fn.glDepthMask(int(described.depth == "write"))
        _switch(fn, gl.GL_BLEND, described.blend is not None)
        if described.blend:
            fn.glBlendEquationSeparate(gl.GL_FUNC_ADD, gl.GL_FUNC_ADD)
            over = described.blend == "over"
            source, kept = (gl.GL_SRC_ALPHA, gl.GL_ONE_MINUS_SRC_ALPHA) if over else (gl.GL_ONE, gl.GL_ONE)
            fn.glBlendFuncSeparate(source, kept, gl.GL_ZERO if over else gl.GL_ONE, kept)
            if described.blend == "weighted":  # as in pipelines/vulkan.py
                fn.glBlendFuncSeparate(gl.GL_ONE, gl.GL_ONE, gl.GL_ZERO, gl.GL_ONE_MINUS_SRC_ALPHA)

    def close(self) -> None:
        """Free every program, and the vertex array."""
        self._programs.close()
        self._context.destroy("vertex array", self.no_vertices)


def _switch(fn: gl.Functions, capability: int, on: bool) -> None:
    (fn.glEnable if on else fn.glDisable)(capability)
