"""Self-test: a vertex shader reads its vertices from a storage buffer by index, and its instance by number."""

from __future__ import annotations

from backends.gl import api as gl
from backends.gl.selftests.bench import Bench
from backends.selftest import draws as data


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    program = bench.graphics(data.PULLED_VERTEX, data.NUMBER_FRAGMENT)
    resources = [bench.input(data.PULLED_CORNERS), bench.input(data.PULLED_COLORS)]
    first, instances = data.PULLED_INSTANCES

    def record() -> None:
        bench.fn.glDrawElementsInstancedBaseVertexBaseInstance(
            gl.GL_TRIANGLES, data.PULLED_INDICES.size, gl.GL_UNSIGNED_INT, gl.NULL, instances, 0, first
        )

    return data.pulled_wrong(bench.render(program, record, resources, data.PULLED_INDICES))
