"""Self-test: a triangle drawn as lines colours its edges and not its inside."""

from __future__ import annotations

from backends.gl import api as gl
from backends.gl.selftests.bench import Bench
from backends.selftest import draws as data


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    program = bench.graphics(data.WIREFRAME_VERTEX, data.ONE_FRAGMENT)

    def record() -> None:
        bench.fn.glPolygonMode(gl.GL_FRONT_AND_BACK, gl.GL_LINE)
        try:
            bench.fn.glDrawArrays(gl.GL_TRIANGLES, 0, 3)
        finally:
            bench.fn.glPolygonMode(gl.GL_FRONT_AND_BACK, gl.GL_FILL)

    return data.wireframe_wrong(bench.render(program, record))
