"""The benches of lessons, by name: each is in the chapter of its lesson, and measures later chapters and forks, too."""

from __future__ import annotations

from importlib import import_module
from typing import Any

CHAPTERS = {
    "load": 3,
    "loads": 3,
    "graph": 4,
    "gbuffer": 4,
    "cloth": 5,
    "executions": 5,
    "drift": 5,
    "async_compute": 5,
    "pacing": 5,
    "stages": 6,
    "visible_set": 6,
    "meshlet_sizes": 6,
    "levels": 6,
    "lights": 7,
    "visibility": 7,
    "occlusion": 7,
    "transparency": 7,
    "hdr": 7,
    "shadow_memory": 8,
    "shadow_filters": 8,
    "shadow_cascades": 8,
    "shadow_caching": 8,
    "shadow_casters": 8,
    "rates": 9,
    "constants": 9,
    "fog": 10,
    "taa": 11,
    "rays": 12,
    "paths": 12,
}
"""The chapter whose `benches/` has the module."""


def bench(name: str) -> Any:
    """Return the module of a bench."""
    return import_module(f"chapters.ch{CHAPTERS[name]:02}.benches.{name}")
