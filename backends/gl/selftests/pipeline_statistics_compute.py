"""Self-test: invocations of compute shaders are counted exactly."""

from __future__ import annotations

import numpy as np

from backends.gl.selftests.bench import Bench
from backends.selftest import data as data


def run(bench: Bench) -> str:
    """Return what was wrong, or ""."""
    output, statistics = bench.output(data.COUNTED_INVOCATIONS), bench.statistics()
    with statistics.count():
        bench.dispatch(data.COUNTED_COMPUTE, [output], data.COUNTED_GROUPS)
    return data.computed_count(statistics.read()["compute_invocations"], bench.read(output, np.uint32))
