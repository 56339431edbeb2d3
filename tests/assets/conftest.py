"""What the tests of the scenes share: a cache in which every size is made once."""

from __future__ import annotations

from pathlib import Path

import pytest

from assets import SCENES

QUICK = 1_000_000
"""Triangles drawn at the largest size that the usual run makes; larger ones are made with --long."""

SIZES = [
    pytest.param(info.name, size, id=f"{info.name}:{size}", marks=[pytest.mark.long] * (drawn > QUICK))
    for info in SCENES.values()
    for size, drawn in info.sizes.items()
]
"""All scenes at all of their listed sizes."""


@pytest.fixture(scope="session")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A user's cache for the tests that only read it; the first that wants a scene fills it."""
    return tmp_path_factory.mktemp("cache")
