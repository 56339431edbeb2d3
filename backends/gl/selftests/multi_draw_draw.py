"""Self-test: one call makes every draw of a list, each with its own indices and from its own first instance on."""

from __future__ import annotations

import numpy as np

from backends.gl import api as gl
from backends.gl.selftests.bench import Bench
from backends.selftest import draws as data

INDICES = np.arange(data.SQUARES_VERTICES, dtype=np.uint32)


def bind_records(bench: Bench, draws: np.ndarray) -> None:
    """Bind a buffer with `draws` as OpenGL reads them: the first vertex is the first index, and no base is added."""
    buffer = bench.input(np.insert(draws, 3, 0, axis=1))
    bench.fn.glBindBuffer(gl.GL_DRAW_INDIRECT_BUFFER, buffer.handle)


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    program = bench.graphics(data.SQUARES_VERTEX.replace("DRAW", "0"), data.NUMBER_FRAGMENT)
    bind_records(bench, data.MULTI_DRAWS)

    def record() -> None:
        bench.fn.glMultiDrawElementsIndirect(gl.GL_TRIANGLES, gl.GL_UNSIGNED_INT, gl.NULL, 4, 20)

    return data.multi_draws_wrong(bench.render(program, record, indices=INDICES))
