"""Self-test: the GPU's own number of draws, below the length of the list; each with its number and instance offset."""

from __future__ import annotations

from backends.gl import api as gl
from backends.gl.selftests.bench import Bench
from backends.gl.selftests.multi_draw_draw import INDICES, bind_records
from backends.selftest import draws as data


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    program = bench.graphics(data.SQUARES_VERTEX.replace("DRAW", "gl_DrawIDARB"), data.NUMBER_FRAGMENT)
    bind_records(bench, data.COUNTED_DRAWS)
    bench.fn.glBindBuffer(gl.GL_PARAMETER_BUFFER, bench.input(data.COUNT).handle)

    def record() -> None:
        bench.fn.glMultiDrawElementsIndirectCountARB(
            gl.GL_TRIANGLES, gl.GL_UNSIGNED_INT, gl.NULL, 0, len(data.COUNTED_DRAWS), 20
        )

    return data.counted_draws_wrong(bench.render(program, record, indices=INDICES))
