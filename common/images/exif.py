"""EXIF data of a JPEG, hidden from decoders: nothing here reads it, and Pillow prints a warning where it is broken."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]

_START_OF_SCAN, _APP1 = 0xDA, 0xE1
_NAME = b"Exif\0\0"


def without_exif(data: Bytes) -> Bytes:
    """Return a JPEG whose EXIF segments have another name, in a copy; what has none, or is no JPEG, as it is.

    A segment is 0xFF, its kind, its length in two bytes, which count, and its content (ITU T.81, B.1.1.4); a decoder
    skips an application's segment of a name that it does not know.
    """
    if data[:2].tobytes() != b"\xff\xd8":
        return data
    places, at = list[int](), 2
    while at + 4 <= len(data) and data[at] == 0xFF and data[at + 1] != _START_OF_SCAN:
        if data[at + 1] == 0xFF:  # a fill byte
            at += 1
            continue
        if data[at + 1] == _APP1 and data[at + 4 : at + 10].tobytes() == _NAME:
            places.append(at + 4)
        at += 2 + int.from_bytes(data[at + 2 : at + 4].tobytes(), "big")
    if not places:
        return data
    renamed = data.copy()
    renamed[places] = ord("-")
    return renamed
