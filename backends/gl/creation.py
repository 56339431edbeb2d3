"""Makes on OpenGL what a creation descriptor describes; `backends.creation` says when to write one."""

from __future__ import annotations

from backends.creation import BufferCreation, ImageCreation, SamplerCreation
from backends.gl.context import Context
from backends.gl.resources import FORMATS, Buffer, Image, create_buffer, create_image, create_sampler


def buffer_from(context: Context, creation: BufferCreation) -> Buffer:
    """Return the buffer that is described, for any use; UnsupportedError for one with a place or queue families."""
    creation.refuse(("place", "families"), "OpenGL")
    return create_buffer(context, creation.size, creation.memory, creation.name)


def image_from(context: Context, creation: ImageCreation) -> Image:
    """Return the image that is described, for any use.

    UserError for what `ImageCreation.check` refuses, UnsupportedError for one with a place.
    """
    creation.check(FORMATS)
    creation.refuse(("place",), "OpenGL")
    return create_image(
        context,
        creation.format,
        creation.size,
        creation.name,
        shape=creation.shape,
        levels=creation.levels,
        layers=creation.layers,
        samples=creation.samples,
        view_format=creation.view_format,
        swizzle=creation.swizzle,
    )


def sampler_from(context: Context, creation: SamplerCreation) -> int:
    """Return the sampler that is described."""
    return create_sampler(context, creation.sampler, creation.anisotropy, creation.name)
