"""The surface of the study hdr-swapchain on Vulkan: its format and colour space, and what its display is told."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from backends.vulkan import api as vk
from backends.vulkan.resources import Image
from backends.vulkan.window.display import COLOR_SPACES, HDR_METADATA, Display, Mastering, choose_format

from . import SPOKEN, WRITES
from .gamut import REC_709

SRGB = vk.VK_COLOR_SPACE_SRGB_NONLINEAR_KHR
HDR10 = vk.VK_COLOR_SPACE_HDR10_ST2084_EXT
SCRGB = vk.VK_COLOR_SPACE_EXTENDED_SRGB_LINEAR_EXT

PAIRS = (
    ("hdr10", vk.VK_FORMAT_A2B10G10R10_UNORM_PACK32, HDR10),
    ("hdr10", vk.VK_FORMAT_A2R10G10B10_UNORM_PACK32, HDR10),
    ("scrgb", vk.VK_FORMAT_R16G16B16A16_SFLOAT, SCRGB),
)
"""What is asked for, in this order. The order of channels is no matter: a blit converts."""


class Surface(NamedTuple):
    """The pair of a surface, its encoding, and a sentence that says why."""

    encoding: str
    format: int
    space: int
    sentence: str


def choose_surface(offered: Sequence[tuple[int, int]], extended: bool = True) -> Surface:
    """Return what to show in: HDR10, else scRGB, else sRGB in 8 bits.

    `offered` are a surface's (format, colour space); `extended` says whether the instance has
    VK_EXT_swapchain_colorspace, without which a swapchain may use no other space than sRGB. Raises UnsupportedError if
    there is no 8-bit format either.
    """
    for encoding, format, space in PAIRS if extended else ():
        if (format, space) in offered:
            before = "" if encoding == "hdr10" else "not HDR10 but "
            return Surface(
                encoding, format, space, f"the surface offers {before}{SPOKEN[encoding]}: {WRITES[encoding]}."
            )
    format, space = choose_format(offered)
    why = (
        f"the surface offers neither HDR10 nor scRGB among its {len(offered)} pairs of format and colour space"
        if extended
        else f"the Vulkan loader lacks {COLOR_SPACES}, so the surface may offer sRGB only"
    )
    return Surface("srgb", format, space, f"{why}: {WRITES['srgb']}.")


class HdrDisplay(Display):
    """The window of this study. `surface` is what was chosen, once a screen has asked."""

    instance_extensions = (COLOR_SPACES,)
    device_extensions = (HDR_METADATA,)
    surface: Surface | None = None

    def choose(self, offered: Sequence[tuple[int, int]], extensions: frozenset[str]) -> tuple[int, int]:
        """Return the pair that `choose_surface` takes, and remember why."""
        self.surface = choose_surface(offered, COLOR_SPACES in extensions)
        return self.surface.format, self.surface.space

    def source(self, renderer: Any) -> Image:
        """Return the encoded image where the surface takes it as it is, else the picture that explains it."""
        image: Image = renderer.displayed
        return image

    def mastering(self, renderer: Any) -> Mastering | None:
        """Return the peak of the settings and primaries of Rec. 709, which the scene never leaves; None for sRGB.

        No pixel is brighter than the peak. The mean of a frame is not known: 0.
        """
        if self.surface is None or self.surface.encoding == "srgb":
            return None
        peak = float(renderer.settings.peak)
        return Mastering(*REC_709, peak=peak, brightest=peak)
