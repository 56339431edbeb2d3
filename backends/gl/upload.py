"""Mip chains made on the GPU by the kernel that Vulkan uses too, so that both backends sample the same texels.

OpenGL takes pixels straight from numpy (`resources.write_image`): the driver keeps its own staging memory.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from backends import shader_text
from backends.gl import api as gl
from backends.gl.context import Context
from backends.gl.programs import Program, Programs
from backends.gl.resources import (
    FORMATS,
    Image,
    bind_storage_image,
    bind_texture,
    create_view,
    level_size,
    write_image,
)
from common.images import blocks
from common.paths import ROOT


class Uploader:
    """Copies pixels into images and makes their mip levels; its programs live as long as it does."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._programs = Programs(context)
        self.bytes = 0

    def image(
        self,
        target: Image,
        pixels: np.ndarray | Sequence[np.ndarray],
        *,
        mips: bool = True,
        srgb: bool = False,
    ) -> None:
        """Copy (H, W) or (H, W, C) pixels to level 0, and make the other levels if `mips`.

        `pixels` has the type and channels of the image's format, one array for each layer of an array; `srgb` says that
        colour is to be averaged as light.
        """
        if blocks.is_compressed(target.storage_format):
            raise ValueError(f"'{target.name}' holds blocks, not pixels: its levels go up by `chain`.")
        expected = (target.height, target.width)
        layers = [pixels] if isinstance(pixels, np.ndarray) else pixels
        if len(layers) != target.layers:
            raise ValueError(f"'{target.name}' has {target.layers} layers, and {len(layers)} were given.")
        if target.levels > 1 and not mips:
            raise ValueError(f"'{target.name}' has {target.levels} levels, and only one was given.")
        for number, layer in enumerate(layers):
            if layer.shape[:2] != expected:
                raise ValueError(f"'{target.name}' wants {expected} pixels, not {layer.shape[:2]}.")
            if layer.ndim == 3 and layer.shape[2] == 1:
                layer = layer[:, :, 0]
            write_image(self._context, target, layer, layer=number)
            self.bytes += layer.nbytes
        if target.levels > 1:
            self.make_mips(target, srgb=srgb)

    def chain(self, target: Image, layers: Sequence[Sequence[np.ndarray]]) -> None:
        """Copy mip levels that were made before.

        `layers` holds, for each layer, all levels of the image, the largest first: (rows, bytes of a row) uint8, where
        rows are of blocks if the format is of blocks, and else of texels.
        """
        if target.shape == "3d" or len(layers) != target.layers:
            raise ValueError(f"'{target.name}' has {target.layers} layers, and {len(layers)} were given.")
        for number, levels in enumerate(layers):
            if len(levels) != target.levels:
                raise ValueError(f"'{target.name}' has {target.levels} levels, and {len(levels)} were given.")
            for level, rows in enumerate(levels):
                _write_level(self._context, target, rows, level=level, layer=number)
                self.bytes += rows.nbytes

    def make_mips(self, image: Image, *, srgb: bool = False) -> None:
        """Make levels 1 and up of a "2d" or "array" image from level 0, by the box filter of `shaders/mips.comp`."""
        context, fn = self._context, self._context.fn
        fn.glUseProgram(self._program(image.storage_format, image.shape == "array", srgb).handle)
        for level in range(1, image.levels):
            above, size = level_size(image, level - 1), level_size(image, level)
            source = create_view(context, image, image.storage_format, level=level - 1, levels=1)
            try:
                bind_texture(context, 0, source, 0)
                bind_storage_image(context, 0, image, level=level)
                highest = 255 if FORMATS[image.storage_format].dtype is np.uint8 else 0
                context.push(np.array([*size, *above, highest], np.uint32))
                fn.glDispatchCompute((size[0] + 7) // 8, (size[1] + 7) // 8, image.layers)
                # The next level fetches what this one stored.
                fn.glMemoryBarrier(gl.GL_TEXTURE_FETCH_BARRIER_BIT)
            finally:
                image.views.remove(source)
                context.destroy("texture", source)
        fn.glMemoryBarrier(gl.GL_TEXTURE_FETCH_BARRIER_BIT | gl.GL_TEXTURE_UPDATE_BARRIER_BIT)

    def _program(self, format: str, layered: bool, srgb: bool) -> Program:
        # The name of a format is that of the image's layout qualifier.
        path = ROOT / "shaders" / "mips.comp"
        defines: dict[str, int | str] = {"FORMAT": format}
        defines |= {name: 1 for name, on in (("LAYERED", layered), ("SRGB", srgb)) if on}
        source = shader_text.build(path, "gl", defines=defines)
        return self._programs.get([source], f"mips {format}")

    def close(self) -> None:
        """Free the programs."""
        self._programs.close()

    def __enter__(self) -> Uploader:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _write_level(context: Context, image: Image, rows: np.ndarray, *, level: int, layer: int) -> None:
    """Copy a level of a layer as it is stored: (rows, bytes of a row) uint8, rows of blocks if the format has blocks.

    ValueError for bytes of another shape than `common.images.blocks.stored_shape` says.
    """
    described = FORMATS[image.storage_format]
    width, height = level_size(image, level)
    expected = blocks.stored_shape(image.storage_format, width, height, described.texel)
    if rows.shape != expected or rows.dtype != np.uint8:
        raise ValueError(
            f"Level {level} of '{image.name}' wants {expected} uint8, not {rows.shape} {rows.dtype}."
        )
    raw, fn = np.ascontiguousarray(rows), context.fn
    flat = image.shape == "2d"
    if not blocks.is_compressed(image.storage_format):
        where = (described.pixels, described.component, gl.pointer(raw))
        if flat:
            fn.glTextureSubImage2D(image.handle, level, 0, 0, width, height, *where)
        else:
            fn.glTextureSubImage3D(image.handle, level, 0, 0, layer, width, height, 1, *where)
        return
    where = (described.internal, raw.size, gl.pointer(raw))
    if flat:
        fn.glCompressedTextureSubImage2D(image.handle, level, 0, 0, width, height, *where)
    else:
        fn.glCompressedTextureSubImage3D(image.handle, level, 0, 0, layer, width, height, 1, *where)
