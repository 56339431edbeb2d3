"""The pictures of a scene as a cache has them: pixels, or mip chains of blocks, one for each way in which one is read.

Uncompressed, a cache holds what the decoder gave, and the GPU makes the mip levels as it does without a cache: its bits
are the same. Compressed, it holds every level, since a GPU does not write blocks: BC4 where one channel is read, BC5
for roughness and metalness, BC7 for the rest, normals among it, whose third component the shaders read as it stands. A
picture of few texels stays as it is: blocks would save next to nothing, and show.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from common.errors import SceneError
from common.gltf import load_scene
from common.images import blocks
from common.images.mips import mip_chain
from common.scene import Image, Scene
from common.scene.images import Chain, EncodedImage, Pixels

from ..scene.packing import material_variant
from ..scene.textures.reads import uses
from ..scene.textures.texels import NARROW
from .sections import DamagedError, SectionFile

LEAST_TEXELS = 64 * 64
"""Of a picture that is compressed: below, it has 16 KB at most."""

EFFORT: blocks.Effort = "fast"
"""Of the BC7 encoder: the others take 3 and 8 times as long for 1 and 2 dB (see `common.images.blocks`)."""

Use = tuple[bool, bool, str]
"""How a picture is read: as colour (sRGB), with mip levels, which channels."""

_BLOCKS = {"r": "bc4", "gb": "bc5"}


def image_uses(scene: Scene) -> dict[int, list[Use]]:
    """Return the uses of each image by the materials of a scene; unused images are left out."""
    variants = [material_variant(material, scene) for material in scene.materials]
    uses_by_image: dict[int, list[Use]] = {}
    for use in uses(scene, variants):
        if use.read.key[0] == "image":
            _, number, *how = use.read.key
            ways = uses_by_image.setdefault(number, [])
            if tuple(how) not in ways:
                ways.append((how[0], how[1], how[2]))
    return uses_by_image


def is_compressible(image: Image) -> bool:
    """Whether an image is kept as blocks: eight bits a channel, and large enough."""
    return image.dtype == np.uint8 and image.width * image.height >= LEAST_TEXELS


def compress(pixels: Pixels, use: Use) -> Chain:
    """Return `pixels` (H, W, 4) uint8 as blocks for one use. Raises UnsupportedError where there is no encoder."""
    srgb, mipmapped, channels = use
    held = pixels.astype(np.uint8, copy=False)
    format, swizzle = ("bc7_srgb" if srgb else "bc7"), "rgba"
    if channels in NARROW:
        _, swizzle, columns = NARROW[channels]
        format, held = _BLOCKS[channels], held[..., columns]
    levels = mip_chain(held, srgb) if mipmapped else (held,)
    missing = 4 - held.shape[2]
    whole = [np.pad(level, ((0, 0), (0, 0), (0, missing))) for level in levels]
    return Chain(format, None, swizzle, blocks.encode_chain(whole, format, EFFORT))


def chain_record(use: Use, chain: Chain, add: Callable[[np.ndarray[Any, Any]], int]) -> list[Any]:
    """Return what `CachedImage` finds a chain by, after its levels went to `add` as one array."""
    section = add(np.concatenate([level.reshape(-1) for level in chain.levels]))
    shapes = [list(level.shape) for level in chain.levels]
    return [list(use), chain.format, chain.view_format, chain.swizzle, section, shapes]


class Source:
    """The pictures of the file that a cache was made of, for what the cache does not hold; opened at the first need."""

    def __init__(self, path: Path) -> None:
        self._path, self._lock = path, threading.Lock()
        self._images: list[Image] | None = None

    def decode(self, number: int, size: tuple[int, int]) -> Pixels:
        """Return the pixels of an image. Raises SceneError: the file is damaged, or is another one by now."""
        with self._lock:
            if self._images is None:
                self._images = load_scene(self._path, decode=False).images
        image = self._images[number] if number < len(self._images) else None
        if image is None or (image.width, image.height) != size:
            raise SceneError(f"{self._path} changed since it was opened: open it again.")
        return image.decode()


class CachedImage(EncodedImage):
    """A picture in a mapped cache. Where its bytes are damaged, `damaged` is told once and the source has it.

    `chain` answers the same whenever it is asked: plans are made by what it says.
    """

    _file: SectionFile
    _record: dict[str, Any]
    _damaged: Callable[[DamagedError], None]
    _chains: dict[Use, Chain | None]

    def __init__(
        self,
        file: SectionFile,
        number: int,
        record: dict[str, Any],
        source: Source,
        damaged: Callable[[DamagedError], None],
    ) -> None:
        size = (record["size"][0], record["size"][1])

        def decoder() -> Pixels:
            if record["pixels"] is not None:
                try:
                    kept: Pixels = file.array(record["pixels"])
                    return kept
                except DamagedError as error:
                    record["pixels"] = None
                    damaged(error)
            return source.decode(number, size)

        super().__init__(record["name"], size, np.dtype(record["dtype"]).type, decoder)
        held = {"_file": file, "_record": record, "_damaged": damaged, "_chains": {}}
        for attribute, value in held.items():
            object.__setattr__(self, attribute, value)

    def chain(self, srgb: bool, mipmapped: bool, channels: str) -> Chain | None:
        """Return the mapped chain for a use, its bytes compared with their checksum, or None: then `pixels` has it."""
        use = (srgb, mipmapped, channels)
        with self._lock:
            if use not in self._chains:
                self._chains[use] = self._read(use)
            return self._chains[use]

    def _read(self, use: Use) -> Chain | None:
        for made_for, format, view_format, swizzle, section, shapes in self._record["chains"]:
            if tuple(made_for) == use:
                try:
                    data = self._file.array(section)
                except DamagedError as error:
                    self._damaged(error)
                    return None
                levels, end = [], 0
                for rows, row in shapes:
                    begin, end = end, end + rows * row
                    levels.append(data[begin:end].reshape(rows, row))
                return Chain(format, view_format, swizzle, tuple(levels))
        return None
