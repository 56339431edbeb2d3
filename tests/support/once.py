"""What a run makes once for all copies of a file of tests, which is imported for each chapter that it runs for."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import pytest

T = TypeVar("T")
_MADE = pytest.StashKey[dict[str, Any]]()


def once(config: pytest.Config, name: str, make: Callable[[], T]) -> T:
    """Return what `make` returned when it was first asked for under this name."""
    made = config.stash.setdefault(_MADE, {})
    if name not in made:
        made[name] = make()
    found: T = made[name]
    return found
