"""How pictures go to a surface: which pair of format and colour space it has, and what image of a renderer it shows.

Windows show finished pictures of 8-bit sRGB codes. A renderer for another display has a class of its own, which derives
from `Display`; `Screen` asks an object of it, and puts it on the device, where the renderer finds it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.resources import Image
from common.errors import UnsupportedError

# A picture is coded in sRGB by the tone mapper and 8 bits deep, so formats that would code it again are no choice.
_FORMATS = (vk.VK_FORMAT_R8G8B8A8_UNORM, vk.VK_FORMAT_B8G8R8A8_UNORM, vk.VK_FORMAT_A8B8G8R8_UNORM_PACK32)

COLOR_SPACES = "VK_EXT_swapchain_colorspace"
"""The instance extension without which surfaces offer sRGB only."""

HDR_METADATA = "VK_EXT_hdr_metadata"
"""The device extension that tells a display about the content."""


def choose_format(offered: Sequence[tuple[int, int]]) -> tuple[int, int]:
    """Return the (format, colour space) to show 8-bit sRGB codes in as they are; UnsupportedError if there is none."""
    for format in _FORMATS:
        if (format, vk.VK_COLOR_SPACE_SRGB_NONLINEAR_KHR) in offered:
            return format, vk.VK_COLOR_SPACE_SRGB_NONLINEAR_KHR
    raise UnsupportedError("This display has no plain 8-bit colour format: run with --headless.")


@dataclass(frozen=True)
class Mastering:
    """What a display is told about the content: chromaticities (x, y), and luminance in nits; 0 means unknown.

    `brightest` is the largest luminance of a pixel, `average` the largest mean of a frame (CTA-861.3).
    """

    red: tuple[float, float]
    green: tuple[float, float]
    blue: tuple[float, float]
    white: tuple[float, float]
    peak: float
    black: float = 0.0
    brightest: float = 0.0
    average: float = 0.0

    def info(self) -> Any:
        """Return this as a VkHdrMetadataEXT."""
        place = {
            f"displayPrimary{name.title()}": dict(zip("xy", getattr(self, name), strict=True))
            for name in ("red", "green", "blue")
        }
        return vk.new(
            "VkHdrMetadataEXT",
            **place,
            whitePoint=dict(zip("xy", self.white, strict=True)),
            maxLuminance=self.peak,
            minLuminance=self.black,
            maxContentLightLevel=self.brightest,
            maxFrameAverageLightLevel=self.average,
        )


class Display:
    """A window that shows finished pictures: 8-bit sRGB codes."""

    instance_extensions: Sequence[str] = ()
    """Extensions of the instance that are enabled where the loader offers them."""

    device_extensions: Sequence[str] = ()
    """Extensions of the device that are enabled where the driver offers them."""

    def choose(self, offered: Sequence[tuple[int, int]], extensions: frozenset[str]) -> tuple[int, int]:
        """Return one of the (format, colour space) that a surface offers with these instance extensions.

        Raises UnsupportedError if none will do.
        """
        return choose_format(offered)

    def source(self, renderer: Any) -> Image:
        """Return the image of a renderer to show, which is in state 'copy_source'."""
        image: Image = renderer.present_source
        return image

    def mastering(self, renderer: Any) -> Mastering | None:
        """Return what the display is told about a renderer's pictures, if anything."""
        return None
