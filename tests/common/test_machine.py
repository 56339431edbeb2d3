"""Free memory, as Linux and containers tell it."""

from __future__ import annotations

import pytest

from common import machine


@pytest.mark.parametrize(
    ("told", "limit", "free"),
    [
        ("MemTotal:       24000000 kB\nMemAvailable:   20000000 kB\n", "max\n", 20_000_000 << 10),
        ("MemTotal:       24000000 kB\nMemAvailable:   20000000 kB\n", "1073741824\n", 1 << 30),
        ("MemAvailable:   1000 kB\n", "1073741824\n", 1000 << 10),
        ("MemAvailable:\n", None, None),
        ("MemAvailable: many kB\n", "4096", 4096),
        (None, None, None),
    ],
)
def test_the_smaller_of_two_limits_counts(tmp_path, monkeypatch, told, limit, free):
    for name, text in (("MEMINFO", told), ("LIMIT", limit)):
        monkeypatch.setattr(machine, name, tmp_path / name)
        if text is not None:
            (tmp_path / name).write_text(text)
    assert machine.free_memory() == free
