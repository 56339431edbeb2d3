"""What the GPU says about its own work: when it passed a place in the calls, and counts of invocations."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from backends.gl import api as gl
from backends.gl.context import Context

STATISTICS: Mapping[str, int] = {
    "vertices": gl.GL_VERTICES_SUBMITTED,
    "primitives": gl.GL_PRIMITIVES_SUBMITTED,
    "vertex_invocations": gl.GL_VERTEX_SHADER_INVOCATIONS,
    "clipping_invocations": gl.GL_CLIPPING_INPUT_PRIMITIVES,
    "clipping_primitives": gl.GL_CLIPPING_OUTPUT_PRIMITIVES,
    "fragment_invocations": gl.GL_FRAGMENT_SHADER_INVOCATIONS,
    "compute_invocations": gl.GL_COMPUTE_SHADER_INVOCATIONS,
    "samples_passed": gl.GL_SAMPLES_PASSED,
}
"""Names of the counts, and the queries behind them; all but "samples_passed" need "pipeline-statistics"."""


class Timestamps:
    """Times around passes of one frame; one object per frame in flight, so that reading waits for nothing new."""

    def __init__(self, context: Context, name: str) -> None:
        self._context, self._label = context, name
        self._names: list[str] = []
        self._queries: list[int] = []

    def begin_frame(self) -> None:
        """Forget the last frame's stamps."""
        self._names = []

    def begin(self, name: str) -> None:
        """Stamp the beginning of pass `name`."""
        self._names.append(name)
        self._stamp(2 * len(self._names) - 2)

    def end(self) -> None:
        """Stamp the end of the pass that began last."""
        self._stamp(2 * len(self._names) - 1)

    def _stamp(self, number: int) -> None:
        while len(self._queries) <= number:
            self._queries.append(self._context.create("query", f"{self._label}, stamp {len(self._queries)}"))
        self._context.fn.glQueryCounter(self._queries[number], gl.GL_TIMESTAMP)

    def ready(self) -> bool:
        """Whether `read` would not have to wait."""
        return not self._names or _is_there(self._context, self._queries[2 * len(self._names) - 1])

    def read(self) -> dict[str, float]:
        """Return GPU milliseconds by pass, in the order of the frame; waits until the last stamp is there."""
        stamps = [_result(self._context, query) for query in self._queries[: 2 * len(self._names)]]
        return {name: (stamps[2 * i + 1] - stamps[2 * i]) * 1e-6 for i, name in enumerate(self._names)}

    def close(self) -> None:
        """Free the queries."""
        for query in self._queries:
            self._context.destroy("query", query)
        self._queries.clear()
        self._names = []


class Statistics:
    """Counts of the GPU's work between two places; what the driver cannot count is left out."""

    def __init__(self, context: Context, name: str) -> None:
        self._context = context
        counted = (
            STATISTICS if context.has("pipeline-statistics") else {"samples_passed": gl.GL_SAMPLES_PASSED}
        )
        self._queries = {
            key: (target, context.create("query", f"{name} {key}")) for key, target in counted.items()
        }
        self._counted = False

    @contextmanager
    def count(self) -> Iterator[None]:
        """Count the work of the calls within; one at a time in a context."""
        for target, query in self._queries.values():
            self._context.fn.glBeginQuery(target, query)
        try:
            yield
        finally:
            for target, _ in self._queries.values():
                self._context.fn.glEndQuery(target)
            self._counted = True

    def read(self) -> dict[str, int]:
        """Return the counts by the names of STATISTICS, waiting for them; empty before the first `count`."""
        if not self._counted:
            return {}
        return {key: _result(self._context, query) for key, (_, query) in self._queries.items()}

    def close(self) -> None:
        """Free the queries."""
        for _, query in self._queries.values():
            self._context.destroy("query", query)
        self._queries.clear()
        self._counted = False


def _result(context: Context, query: int) -> int:
    out = gl.ffi.new("GLuint64[1]")
    context.fn.glGetQueryObjectui64v(query, gl.GL_QUERY_RESULT, out)
    return int(out[0])


def _is_there(context: Context, query: int) -> bool:
    out = gl.ffi.new("GLint[1]")
    context.fn.glGetQueryObjectiv(query, gl.GL_QUERY_RESULT_AVAILABLE, out)
    return bool(out[0])
