"""Shading rates: their code, the size of a mask, and whether frames have one. No device.

A rate is the size of a block of pixels that is lit once. Its code is that of VK_KHR_fragment_shading_rate: bits 0 and 1
are the binary logarithm of the height, bits 2 and 3 that of the width (Vulkan 1.3 specification, "Attachment Fragment
Shading Rate"). 0 is 1x1, so memory of zeros shades every pixel.
"""

from __future__ import annotations

from typing import Any

TEXEL = 16
"""Pixels along a texel of a rasteriser's mask, which has one rate; a device may ask for another size."""

GROUP = 16
"""Pixels along the tile of a work group, at least; a mask's group has an invocation for each block of its tile."""

EDGE_TILE = 32
"""Pixels along the tile in which gradients are found: no texel is longer."""

AREA = 16
"""Pixels along the area of a work group that lights."""

RATES, EDGES = "rates", "history_rates"
"""The mask of this frame, and what the last picture asks of it."""

MASK = "rate_mask"
"""The name of the pass that writes the mask."""

LONGEST = 4
"""Pixels along the longest block."""

WHOLE, LAST, KEPT = 9, 10, 11
"""Frames without a change, counted, behind a whole round of turns. WHOLE is lit at each pixel, so that its edges are
those of the whole picture. LAST has the mask of these edges, without turns. From KEPT on it is kept until something
changes.
"""

Defines = tuple[tuple[str, int | float | str], ...]


def encode(width: int, height: int) -> int:
    """Return the code of a rate. Raises ValueError for sides that are not 1, 2 or 4."""
    sides = {1: 0, 2: 1, 4: 2}
    if width not in sides or height not in sides:
        raise ValueError(f"A shading rate has sides of 1, 2 or 4 pixels, and this one is {width}x{height}.")
    return sides[width] << 2 | sides[height]


def decode(code: int) -> tuple[int, int]:
    """Return (width, height) of a rate. Raises ValueError for a code that is none."""
    width, height = 1 << (code >> 2 & 3), 1 << (code & 3)
    if not 0 <= code < 16 or max(width, height) > LONGEST:
        raise ValueError(f"{code} is no code of a shading rate: the codes are 0, 1, 2, 4, 5, 6, 8, 9 and 10.")
    return width, height


def coarse_code(settings: Any) -> int:
    """Return the code of the blocks that share their light."""
    width, height = map(int, settings.rates.rate_coarse.split("x"))
    return encode(width, height)


def coarse_define(settings: Any) -> tuple[str, str]:
    """Return the name and the value of the code of the blocks that share their light, for shaders."""
    return "COARSE", f"{coarse_code(settings)}u"


def wanted(settings: Any) -> bool:
    """Whether the settings ask for a mask, and the picture is one that a G-buffer can hold."""
    shading, drawn = settings.shading, not settings.paths.path_tracer
    return bool(
        settings.rates.rate_policy != "none" and drawn and shading.view == "picture" and shading.msaa == 1
    )


def texel_of(settings: Any) -> int:
    """Return the pixels along a texel where shaders read the mask: a block, unless the settings ask for more."""
    return max(settings.rates.rate_texel, *decode(coarse_code(settings)))


def mask_defines(settings: Any, texel: int) -> Defines:
    """Return what the kernels of the mask are built with."""
    rates = settings.rates
    return (
        ("RATE_TEXEL", texel),
        ("TILE", max(texel, GROUP)),
        ("EDGE_TILE", EDGE_TILE),
        ("WHOLE", WHOLE),
        ("LAST", LAST),
        ("KEPT", KEPT),
        coarse_define(settings),
        ("COARSE_SIDE", decode(coarse_code(settings))[0]),
        *(
            (("RADIUS", rates.rate_radius),)
            if rates.rate_policy == "radial"
            else (("THRESHOLD", rates.rate_threshold), ("SURFACE", rates.rate_surface))
        ),
    )
