"""The pictures that materials sample: decoded, or still as the file has them."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Pixels = NDArray[np.uint8] | NDArray[np.uint16] | NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Chain:
    """An image as the GPU takes it: all levels of its mip chain, made before.

    `format` is how it is stored and `view_format` how it is sampled, if otherwise, by the names of the backends;
    `swizzle` says which channel of the format stands for red, green, blue and alpha. `levels` are, level 0 first,
    (rows, bytes of a row) uint8; of a block-compressed format rows are rows of blocks.
    """

    format: str
    view_format: str | None
    swizzle: str
    levels: tuple[NDArray[np.uint8], ...]


@dataclass(frozen=True)
class Image:
    """A decoded picture, `pixels` (H, W, 4) uint8, uint16 or float32, row 0 on top, straight alpha.

    Whether integers are sRGB codes is decided by the use, not by the file: base colour and emission are, the
    rest is linear (glTF 2.0, 3.9.2). Floats are always linear.
    """

    name: str
    pixels: Pixels

    @property
    def width(self) -> int:
        """Pixels of a row."""
        return int(self.pixels.shape[1])

    @property
    def height(self) -> int:
        """Rows."""
        return int(self.pixels.shape[0])

    @property
    def dtype(self) -> np.dtype[Any]:
        """The type of the pixels."""
        return self.pixels.dtype

    def decode(self) -> Pixels:
        """Return the pixels; of an image that is still encoded this is the work, and may be done on any thread."""
        return self.pixels

    def chain(self, srgb: bool, mipmapped: bool, channels: str) -> Chain | None:
        """Return what is ready to be uploaded for a use as colour (`srgb`) or data of `channels` ("rgba"), or None."""
        return None


class EncodedImage(Image):
    """A picture whose size and type are known and whose pixels are decoded at the first access.

    `decode` decodes whenever it is called and keeps nothing; `pixels` decodes once and keeps them.
    """

    _size: tuple[int, int]
    _dtype: np.dtype[Any]
    _decoder: Callable[[], Pixels]
    _kept: list[Pixels]
    _lock: threading.Lock

    def __init__(
        self,
        name: str,
        size: tuple[int, int],
        dtype: type[np.generic],
        decoder: Callable[[], Pixels],
    ) -> None:
        """`size` is (width, height); `decoder` returns (height, width, 4) of `dtype`, or raises SceneError."""
        held = {"name": name, "_size": size, "_dtype": np.dtype(dtype), "_decoder": decoder, "_kept": []}
        for attribute, value in (held | {"_lock": threading.Lock()}).items():
            object.__setattr__(self, attribute, value)  # as a frozen dataclass itself does

    @property
    def width(self) -> int:
        """Pixels of a row."""
        return int(self._size[0])

    @property
    def height(self) -> int:
        """Rows."""
        return int(self._size[1])

    @property
    def dtype(self) -> np.dtype[Any]:
        """The type that the pixels will have."""
        return self._dtype

    def decode(self) -> Pixels:
        """Return the pixels, decoded by the thread that asks. Raises SceneError: the file is damaged."""
        return self._kept[0] if self._kept else self._decoder()

    @property
    def pixels(self) -> Pixels:
        """The pixels, decoded at the first use. Raises SceneError: the file is damaged."""
        with self._lock:
            if not self._kept:
                self._kept.append(self._decoder())
        return self._kept[0]

    def __eq__(self, other: object) -> bool:
        return self is other

    __hash__ = object.__hash__

    def __repr__(self) -> str:
        return f"EncodedImage({self.name!r}, {self.width}x{self.height} {self.dtype})"
