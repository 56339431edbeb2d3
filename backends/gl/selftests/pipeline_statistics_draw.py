"""Self-test: vertices, primitives and fragments of a draw are counted exactly."""

from __future__ import annotations

from backends.gl import api as gl
from backends.gl.selftests.bench import Bench
from backends.selftest import draws as data


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    program = bench.graphics(data.TWICE_VERTEX, data.ONE_FRAGMENT)
    statistics = bench.statistics()

    def record() -> None:
        with statistics.count():
            bench.fn.glDrawArrays(gl.GL_TRIANGLES, 0, 6)

    pixels, counted = bench.render(program, record), statistics.read()
    names = ("vertices", "primitives", "fragment_invocations")
    return data.drawn_counts_wrong(pixels, *(counted[name] for name in names))
