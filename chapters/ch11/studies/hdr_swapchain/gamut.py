"""Primaries of displays, and the matrix from light in one set of primaries to light in another, in float64.

A display's red, green and blue at full strength add up to its white. Their chromaticities (x, y) fix the colours of the
primaries but not their strengths; white fixes those.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Chromaticity = tuple[float, float]


class Gamut(NamedTuple):
    """CIE 1931 chromaticities (x, y) of the primaries and of white."""

    red: Chromaticity
    green: Chromaticity
    blue: Chromaticity
    white: Chromaticity


D65: Chromaticity = (0.3127, 0.3290)
REC_709 = Gamut((0.640, 0.330), (0.300, 0.600), (0.150, 0.060), D65)
"""ITU-R BT.709-6, item 1.3; the primaries of sRGB, too."""
REC_2020 = Gamut((0.708, 0.292), (0.170, 0.797), (0.131, 0.046), D65)
"""ITU-R BT.2020-2, table 3; the primaries of HDR10."""


def xyz_from_rgb(gamut: Gamut) -> NDArray[np.float64]:
    """Return the matrix (3, 3) from linear light to CIE XYZ, where white has Y = 1 (SMPTE RP 177, section 3)."""
    # The XYZ of a chromaticity with y scaled to 1; a column for each primary.
    columns = np.array([(x / y, 1.0, (1.0 - x - y) / y) for x, y in gamut]).T
    primaries, white = columns[:, :3], columns[:, 3]
    strengths = np.linalg.solve(primaries, white)
    return primaries * strengths


def between(source: Gamut, target: Gamut) -> NDArray[np.float64]:
    """Return the matrix (3, 3) from linear light in `source` to that light in `target`; both have the same white."""
    matrix: NDArray[np.float64] = np.linalg.solve(xyz_from_rgb(target), xyz_from_rgb(source)).astype(
        np.float64
    )
    return matrix
