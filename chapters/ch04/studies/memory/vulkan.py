"""The study memory on Vulkan: the study barriers, with images at places in one block of memory."""

from __future__ import annotations

from ..barriers import vulkan as barriers
from . import STUDY, Settings


class Renderer(barriers.Renderer):
    """The frame with images that share memory."""

    study = STUDY
    settings_class: type = Settings

    @property
    def share(self) -> bool:
        """Whether images share memory: as the knob says."""
        share: bool = self.settings.share
        return share
