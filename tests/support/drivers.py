"""Faults of drivers that self-tests found: a test whose truth one of them spoils is skipped by its name."""

from __future__ import annotations

from typing import Any

import pytest


def needs_whole_quads(device: Any) -> None:
    """Skip on a driver that gives textures seams along edges of triangles, as the llvmpipe of Mesa 22.3 does."""
    if not device.capabilities.use("texturing", "edges"):
        pytest.skip("the driver gives textures seams along edges of triangles")


def needs_line_marks(device: Any) -> None:
    """Skip on a driver whose GLSL compiler does not say in which file a line is, as that of Mesa 22."""
    if device.capabilities.backend == "gl" and " Mesa 22." in device.capabilities.driver:
        pytest.skip("the driver does not say in which file a line is")
