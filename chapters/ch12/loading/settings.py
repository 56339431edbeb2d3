"""The knobs of loading."""

from __future__ import annotations

from dataclasses import dataclass

from common.settings import knob


@dataclass
class LoadingSettings:
    """How textures arrive."""

    mode: str = knob(
        "auto",
        "whether frames wait for the textures, or are drawn at once and fill in; auto: fill in where there is a window",
        choices=("auto", "wait", "stream"),
        flat="loading",
    )
    decoding_threads: int = knob(
        0, "threads that decode images; 0: one less than there are cores, at most 8", minimum=0, maximum=64
    )
    upload_budget: float = knob(
        2.0, "texels copied to the GPU in a frame while loading", unit="MiB", minimum=0.015625, maximum=1024
    )
