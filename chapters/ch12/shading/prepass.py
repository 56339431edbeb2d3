"""Whether a frame draws depth before it shades anything."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from .settings import ShadingSettings


class Settings(Protocol):
    """The settings of the pre-pass."""

    shading: ShadingSettings


def has_prepass(settings: Settings) -> bool:
    """Whether depth is drawn first; where a view counts all fragments, none of them must be left out."""
    return settings.shading.depth_prepass and settings.shading.view != "overdraw"
