"""Pictures: files, colour, mip levels and compressed blocks."""

from common.images.images import (
    READABLE,
    WRITABLE,
    check_format,
    check_writable,
    encode_png,
    image_size,
    read_image,
    read_layers,
    write_image,
    write_layers,
)

__all__ = [
    "READABLE",
    "WRITABLE",
    "check_format",
    "check_writable",
    "encode_png",
    "image_size",
    "read_image",
    "read_layers",
    "write_image",
    "write_layers",
]
