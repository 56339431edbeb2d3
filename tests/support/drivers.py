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


def needs_nans(device: Any) -> None:
    """Skip on Mesa 22, whose compiler for Vulkan does not keep NaNs."""
    if " Mesa 22." in device.capabilities.driver:
        pytest.skip("the driver's arithmetic loses NaNs")


def needs_feature(device: Any, feature: str) -> None:
    """Skip on a device that lacks a feature, or gets it wrong."""
    if not device.has(feature):
        pytest.skip(f"the device has no {feature}")


def needs_layers(instance: Any) -> None:
    """Skip where the Vulkan validation layers are not installed."""
    if not instance.validates:
        pytest.skip("the Vulkan validation layers are not installed")


def checked(instance: Any, backend: str) -> tuple[str, ...]:
    """Return the option of a command that has its calls checked, () where that takes layers that are not installed."""
    return ("--validate",) if backend == "gl" or instance.validates else ()


def needs_precise_products(device: Any) -> None:
    """Skip on Mesa 22, whose compilers for Vulkan and OpenGL round a product of matrices in two ways."""
    if " Mesa 22." in device.capabilities.driver:
        pytest.skip("the compilers of this driver round a product in two ways")
