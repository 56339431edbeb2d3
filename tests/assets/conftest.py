"""What the tests of the scenes share: a cache in which every size is made once."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A user's cache for the tests that only read it; the first that wants a scene fills it."""
    return tmp_path_factory.mktemp("cache")
