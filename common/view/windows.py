"""The size of a window from what was asked for: pixels, or per cent of the monitor."""

from __future__ import annotations

from common.errors import UserError


def window_size(asked: tuple[int, int], monitor: tuple[int, int]) -> tuple[int, int]:
    """Return (width, height) in pixels: positive numbers are pixels, negative ones per cent of the monitor's side.

    Raises:
        UserError: a number is 0, or more than 100 per cent.
    """
    sizes = []
    for name, size, whole in zip(("width", "height"), asked, monitor, strict=True):
        if size == 0 or size < -100:
            raise UserError(
                f"the window's {name} is {size}: give pixels above 0, or per cent of the monitor from -1 to -100"
            )
        sizes.append(size if size > 0 else max(1, whole * -size // 100))
    return sizes[0], sizes[1]
