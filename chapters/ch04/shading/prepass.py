"""Whether a frame draws depth before it shades anything."""

from __future__ import annotations

from typing import Protocol


class Settings(Protocol):
    """What is asked of a chapter's settings."""

    view: str
    depth_prepass: bool


def has_prepass(settings: Settings) -> bool:
    """Whether depth is drawn first; where a view counts all fragments, none of them must be left out."""
    return settings.depth_prepass and settings.view != "overdraw"
