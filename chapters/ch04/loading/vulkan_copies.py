"""What is copied to the GPU: a decoded texture, where it goes, and how far that has come."""

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
    """Where a texture is copied to: a layer of an image, which is `held` if frames have the image bound already."""

    image: Image
    layer: int = 0
    held: bool = False


class Owner(Protocol):
    """Who has the images."""

    def place(self, request: Request) -> Target:
        """Return where a decoded texture goes."""

    def discard(self, request: Request) -> None:
        """Give up what `place` made: the request was cancelled, and no copy into it is under way."""


@dataclass(eq=False)
class Copy:
    """A texture that is being copied, down to row `row` of level `level`; `flying` submissions work on it.

    `ended` says that what follows the last copy is recorded, too; that may be a frame later.
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
        """Whether all of it was recorded."""
        return self.level == len(self.upload.rows)

    def part(self, first: int = 0, levels: int | None = None) -> Part:
        """Return some levels of where it goes, by default those that are copied."""
        image = self.target.image
        count = len(self.upload.rows) if levels is None else levels
        return Part(image.handle, image.aspect, first, count, self.target.layer)
