"""Copies to the GPU: a decoded texture, its destination, and the progress of its copy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from backends.vulkan.resources import Image

from .loading import Request
from .uploads import Upload
from .vulkan_barriers import Part
from .vulkan_staging import Submission


@dataclass(frozen=True, eq=False)
class Target:
    """The destination of a texture: a layer of an image, which is `held` if frames have the image bound."""

    image: Image
    layer: int = 0
    held: bool = False


class Owner(Protocol):
    """The owner of the images."""

    def place(self, request: Request) -> Target:
        """Return the destination of a decoded texture."""

    def discard(self, request: Request) -> None:
        """Free the image of `place`: the request was cancelled, and no copy into it is in flight."""


@dataclass(eq=False)
class Copy:
    """A texture that is being copied, up to row `row` of level `level`, by `flying` submissions.

    `ended`: the work after the last copy is recorded, perhaps one frame later.
    """

    request: Request
    upload: Upload
    target: Target
    level: int = 0
    row: int = 0
    flying: int = 0
    last: Submission | None = None
    ended: bool = False
    cancelled: bool = False

    @property
    def whole(self) -> bool:
        """Whether all rows were recorded."""
        return self.level == len(self.upload.rows)

    def part(self, first: int = 0, levels: int | None = None) -> Part:
        """Return some levels of the destination, by default the copied ones."""
        image = self.target.image
        count = len(self.upload.rows) if levels is None else levels
        return Part(image.handle, image.aspect, first, count, self.target.layer)
