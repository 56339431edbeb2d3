"""The light lists of the last frame, read back from a renderer's buffer and taken apart."""

from __future__ import annotations

from typing import Any

import numpy as np

from tests.support.buffers import read_words


class Lists:
    """The lists of one frame; each factor of two in distance has 64 bins."""

    def __init__(self, renderer: Any) -> None:
        data, device = renderer._data, renderer.device
        buffer = data.light_lists
        if hasattr(renderer._api, "resources"):
            buffer = renderer._api.resources.buffers.get(buffer)
        self.words = read_words(device, buffer)
        self.layout = layout = renderer.techniques["clusters"]._pass.layout
        header, count = layout.first_bound - layout.lights, layout.first_depth - layout.first_bin
        self.local = sum(light.kind != "directional" for light in renderer.scene.lights)
        self.order = self.words[header : header + self.local].astype(int)
        self.first_code = int(self.words[4])
        places = self.words[layout.first_bin :][:count]
        self.bins = np.stack([places & 0xFFFF, places >> 16], axis=1).astype(int)
        across, down = layout.tiles
        depths = self.words[layout.first_depth : layout.first_tile].reshape(count, -1)
        bits = self.words[layout.first_tile :].reshape(down, across, -1)
        self.depths, self.tiles = (
            (words[..., None] >> np.arange(32, dtype=np.uint32) & 1).reshape(*words.shape[:-1], -1)
            for words in (depths, bits)
        )

    def bin_of(self, depths: np.ndarray) -> np.ndarray:
        """Return the bin of each depth."""
        codes = np.maximum(depths, 0.0).astype(np.float32).view(np.uint32).astype(int) >> (23 - 6)
        return np.clip(codes - self.first_code, 0, len(self.bins) - 1)
