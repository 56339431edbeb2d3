"""Creation descriptors: what a buffer, an image or a sampler is to be, as a value, before there is one.

A resource has many properties, and most of them keep their default. Written out at each call, as C does it, they hide
the two that matter, and a new property changes every call. A creation descriptor is the one place for them: each field
has one name and one default, setters return the description and are chained, and `reset` gives the defaults back.

    BufferCreation().set_size(64).set_memory("upload").set_uses("uniform").set_name("matrices")
    BufferCreation(size=64, memory="upload", uses=("uniform",), name="matrices")  # the same

`backends.vulkan.creation` and `backends.gl.creation` make the resource, both from the same description. The idea is
that of the structs called `...Creation` in "Mastering Graphics Programming with Vulkan" (Castorina and Sassone, 2023),
chapter 1.

Python has keyword arguments with defaults. Where a resource is described and made in one place they are the better
choice: `create_image(device, "rgba8", size, usage, "leaves", levels=5)` names what differs just as well, and makes no
object in between (which with its checks is a third of the time of making a small image: 16 of 47 µs on the software
driver). A description is better where it lives for a while: it is built in steps, both backends take it, or the
resources of a row differ in one field.

Setters change the description itself; what was made from it stays as it is. `dataclasses.replace(description, size=8)`
returns another one. A value is checked when it is set, so that the traceback leads to the line that is wrong; what
depends on several fields, which may be set in any order, is checked when the resource is made.
"""

from __future__ import annotations

import math
import numbers
import operator
import reprlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self, get_args

from common.errors import UnsupportedError, UserError
from common.names import suggest
from common.scene import Sampler

Memory = Literal["device", "upload", "readback"]
BufferUse = Literal[
    "copy_source", "copy_target", "uniform", "storage", "vertex", "index", "indirect", "address"
]
ImageUse = Literal["copy_source", "copy_target", "sampled", "storage", "color", "depth"]
Shape = Literal["2d", "array", "cube", "cube_array", "3d"]
Filter = Literal["nearest", "linear"]
Wrap = Literal["repeat", "clamp", "mirror"]
Place = tuple[Any, int]

# --- what a field may hold --------------------------------------------------------------------------------------------

Rule = Callable[[Any], Any]
"""Takes a value and returns what is stored; ValueError, with the end of a sentence, for what a field cannot hold."""


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise ValueError(": give a text.")
    return value


def _whole(least: int) -> Rule:
    """Return the rule of whole numbers from `least` on; numpy's become Python's."""

    def rule(value: Any) -> int:
        try:
            number = operator.index(value)
        except TypeError:
            number = least - 1
        if number < least:
            raise ValueError(f": give a whole number from {least} on.")
        return number

    return rule


def _samples(value: Any) -> int:
    number: int = _whole(1)(value)
    # Vulkan's flag of a count is the count; OpenGL makes 4 of 3 without a word.
    if number not in (1, 2, 4, 8, 16, 32, 64):
        raise ValueError(": give 1, 2, 4, 8, 16, 32 or 64.")
    return number


def _anisotropy(value: Any) -> float:
    if not (isinstance(value, numbers.Real) and 1.0 <= float(value) < math.inf):
        raise ValueError(": give a number from 1 on.")
    return float(value)


def _word(known: Iterable[str]) -> Rule:
    """Return the rule of one of these words."""
    words = tuple(known)

    def rule(value: Any) -> Any:
        if not isinstance(value, str) or value not in words:
            near = suggest(str(value), words)
            raise ValueError(near if near.endswith("?") else f"{near}.")
        return value

    return rule


def _words(known: Iterable[str]) -> Rule:
    """Return the rule of a set of words, stored in the order of `known`: those of any order are equal."""
    words = tuple(known)

    def rule(values: Any) -> tuple[Any, ...]:
        chosen = _several(_word(words))(values)
        return tuple(word for word in words if word in chosen)

    return rule


def _several(each: Rule, count: int | None = None) -> Rule:
    """Return the rule of a tuple, of `count` values where that is given, each value by the rule `each`."""

    def rule(values: Any) -> tuple[Any, ...]:
        several = isinstance(values, Iterable) and not isinstance(values, str)
        items = tuple(values) if several else ()
        if not several or count not in (None, len(items)):
            raise ValueError(": give a tuple." if count is None else f": give {count} values.")
        return tuple(each(value) for value in items)

    return rule


def _swizzle(value: Any) -> str:
    if len(_text(value)) != 4 or not set(value) <= set("01rgba"):
        raise ValueError(": give four of the letters 0, 1, r, g, b and a.")
    return str(value)


def _place(value: Any) -> Place:
    memory, offset = _several(lambda part: part, 2)(value)
    return memory, _whole(0)(offset)


def _or_none(rule: Rule) -> Rule:
    return lambda value: None if value is None else rule(value)


# --- descriptions -----------------------------------------------------------------------------------------------------


@dataclass(kw_only=True)
class Creation:
    """What all descriptions share: a name for messages, `reset`, and a check of each value that is set.

    Descriptions with equal fields are equal; since they change, none is the key of a dict.
    """

    name: str = ""

    RULES: ClassVar[Mapping[str, Rule]] = {"name": _text}
    """What each field may hold."""

    def set_name(self, name: str) -> Self:
        """Name the resource, for messages of the validation layers, captures and traces."""
        self.name = name
        return self

    def reset(self) -> Self:
        """Give every field its default."""
        for field in fields(self):
            setattr(self, field.name, field.default)
        return self

    def refuse(self, names: Iterable[str], backend: str) -> None:
        """Raise UnsupportedError where one of these fields, which `backend` does not have, is not its default."""
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name in names and value != field.default:
                raise UnsupportedError(
                    f"{self._said(field.name, value)}: {backend} has no such thing; leave it {field.default!r}."
                )

    def _held_to(self, rule: Rule, field: str, value: Any) -> Any:
        try:
            return rule(value)
        except ValueError as wrong:
            raise UserError(f"{self._said(field, value)}{wrong}") from None

    def _said(self, field: str, value: Any) -> str:
        """Return how a sentence about a field begins."""
        name = f" '{self.name}'" if self.name else ""  # the class's, while the name itself is set
        return f"{type(self).__name__}{name}: {field}={reprlib.repr(value)}"

    if not TYPE_CHECKING:  # mypy would take it to mean that any field may be set

        def __setattr__(self, field: str, value: Any) -> None:
            if field not in self.RULES:
                near = suggest(field, self.RULES, len(self.RULES))
                raise UserError(
                    f"{type(self).__name__} has no field '{field}'{near}" + ("" if near[-1] == "?" else ".")
                )
            object.__setattr__(self, field, self._held_to(self.RULES[field], field, value))


@dataclass(kw_only=True)
class BufferCreation(Creation):
    """A buffer of `size` bytes, 4 at least.

    Its memory is the GPU's ("device"), or such that the CPU writes ("upload") or reads it ("readback"). OpenGL's
    buffers are for any use: there `uses` say nothing. `place`, (VkDeviceMemory, offset), and the queue `families` that
    share the buffer are Vulkan's.
    """

    size: int = 0
    memory: Memory = "device"
    uses: tuple[BufferUse, ...] = ()
    place: Place | None = None
    families: tuple[int, ...] = ()

    RULES: ClassVar[Mapping[str, Rule]] = {
        **Creation.RULES,
        "size": _whole(0),
        "memory": _word(get_args(Memory)),
        "uses": _words(get_args(BufferUse)),
        "place": _or_none(_place),
        "families": _several(_whole(0)),
    }

    def set_size(self, size: int) -> Self:
        """Set the number of bytes."""
        self.size = size
        return self

    def set_memory(self, memory: Memory) -> Self:
        """Set whether the GPU or the CPU accesses the memory."""
        self.memory = memory
        return self

    def set_uses(self, *uses: BufferUse) -> Self:
        """Say what the buffer is for, all of it."""
        self.uses = uses
        return self

    def set_place(self, memory: Any, offset: int) -> Self:
        """Let the buffer lie in memory of the caller's, `offset` bytes from its beginning."""
        self.place = memory, offset
        return self

    def set_families(self, *families: int) -> Self:
        """Share the buffer between several queue families, in place of handing it over."""
        self.families = families
        return self


@dataclass(kw_only=True)
class ImageCreation(Creation):
    """An image of (width, height) pixels, by default a texture; `view_format` and `swizzle` say how it is sampled.

    `layers` are those of an "array", six for each cube of a "cube_array", or the slices of a "3d" image; a "cube" has
    its six by itself. On Vulkan the view shows the faces of cubes as layers; OpenGL's images are for any use. `place`,
    (VkDeviceMemory, offset), is Vulkan's.
    """

    format: str = "rgba8"
    size: tuple[int, int] = (1, 1)
    shape: Shape = "2d"
    layers: int = 1
    levels: int = 1
    samples: int = 1
    uses: tuple[ImageUse, ...] = ("copy_target", "sampled")
    view_format: str | None = None
    swizzle: str = "rgba"
    place: Place | None = None

    RULES: ClassVar[Mapping[str, Rule]] = {
        **Creation.RULES,
        "format": _text,
        "size": _several(_whole(1), 2),
        "shape": _word(get_args(Shape)),
        "layers": _whole(1),
        "levels": _whole(1),
        "samples": _samples,
        "uses": _words(get_args(ImageUse)),
        "view_format": _or_none(_text),
        "swizzle": _swizzle,
        "place": _or_none(_place),
    }

    def set_format(self, format: str) -> Self:
        """Set the format in which the image is stored, one of the backend's `FORMATS`."""
        self.format = format
        return self

    def set_size(self, width: int, height: int) -> Self:
        """Set the size of level 0 in pixels."""
        self.size = width, height
        return self

    def set_shape(self, shape: Shape, layers: int = 1) -> Self:
        """Say how the image is seen, and of how many layers or slices."""
        self.shape, self.layers = shape, layers
        return self

    def set_levels(self, levels: int) -> Self:
        """Set the number of mip levels."""
        self.levels = levels
        return self

    def set_samples(self, samples: int) -> Self:
        """Set the number of samples of a pixel."""
        self.samples = samples
        return self

    def set_uses(self, *uses: ImageUse) -> Self:
        """Say what the image is for, all of it."""
        self.uses = uses
        return self

    def set_view_format(self, format: str | None) -> Self:
        """Let the image be sampled in another format than it is stored in."""
        self.view_format = format
        return self

    def set_swizzle(self, swizzle: str) -> Self:
        """Say which channels are seen as red, green, blue and alpha: "0rg1" shows the image's red in green."""
        self.swizzle = swizzle
        return self

    def set_place(self, memory: Any, offset: int) -> Self:
        """Let the image lie in memory of the caller's, `offset` bytes from its beginning."""
        self.place = memory, offset
        return self

    def check(self, formats: Iterable[str]) -> None:
        """Raise UserError for a format that is none of `formats`, and for fields that do not fit together.

        Layers, levels and samples are held to what both backends can make.
        """
        for field, rule in (("format", _word(formats)), ("view_format", _or_none(_word(formats)))):
            self._held_to(rule, field, getattr(self, field))
        (width, height), layers = self.size, self.layers
        if self.shape == "2d" and layers > 1:
            raise UserError(f"{self._said('layers', layers)}: a '2d' image has one; give the shape 'array'.")
        if self.shape in ("cube", "cube_array"):
            if width != height:
                raise UserError(f"{self._said('size', self.size)}: the faces of a cube are square.")
            if (self.shape == "cube_array" and layers % 6) or (self.shape == "cube" and layers not in (1, 6)):
                raise UserError(f"{self._said('layers', layers)}: a cube has six.")
        if self.samples > 1 and (self.shape != "2d" or self.levels > 1):
            raise UserError(
                f"{self._said('samples', self.samples)}: several are for a '2d' image of one level."
            )
        full = max(width, height, layers if self.shape == "3d" else 1).bit_length()
        if self.levels > full:
            raise UserError(f"{self._said('levels', self.levels)}: an image of this size has {full} at most.")


@dataclass(kw_only=True)
class SamplerCreation(Creation):
    """Filters and wrap modes in glTF's words, with the defaults of `common.scene.Sampler`, and anisotropy beside them.

    Anisotropy above 1 needs the feature and three linear filters, and is 1 without them.
    """

    mag: Filter = Sampler.mag
    min: Filter = Sampler.min
    mipmap: Filter | None = Sampler.mipmap
    wrap_u: Wrap = Sampler.wrap_u
    wrap_v: Wrap = Sampler.wrap_v
    anisotropy: float = 1.0

    RULES: ClassVar[Mapping[str, Rule]] = {
        **Creation.RULES,
        "mag": _word(get_args(Filter)),
        "min": _word(get_args(Filter)),
        "mipmap": _or_none(_word(get_args(Filter))),
        "wrap_u": _word(get_args(Wrap)),
        "wrap_v": _word(get_args(Wrap)),
        "anisotropy": _anisotropy,
    }

    def set_filters(self, mag: Filter, min: Filter, mipmap: Filter | None) -> Self:
        """Set the filters of larger and of smaller texels, and that between levels: with None level 0 alone is read."""
        self.mag, self.min, self.mipmap = mag, min, mipmap
        return self

    def set_wraps(self, u: Wrap, v: Wrap) -> Self:
        """Say what lies beyond the edges."""
        self.wrap_u, self.wrap_v = u, v
        return self

    def set_anisotropy(self, anisotropy: float) -> Self:
        """Set how much longer than wide the area of a sample may be."""
        self.anisotropy = anisotropy
        return self

    @property
    def sampler(self) -> Sampler:
        """The filters and wraps alone, as materials have them."""
        return Sampler(self.mag, self.min, self.mipmap, self.wrap_u, self.wrap_v)
