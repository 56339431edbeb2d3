"""Names that captures show: each living object has one that says what it is, and each pass a debug group of its name.

Names are read where a capture reads them: from the calls to Vulkan, and from what OpenGL keeps.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

from backends.gl import api as gl
from backends.vulkan import api as vk
from chapters.ch01.frames.frame import OUTPUTS
from common.scene import Image, Light, Material, Sampler
from tests.support.chapter import record_anew, targets_of
from tests.support.gl_functions import noted
from tests.support.pacing import number
from tests.support.scenes import facing, quad_scene, texture, translated

pytestmark = [pytest.mark.newest, pytest.mark.feature("device/debug-names-and-markers")]

SIZE = (16, 16)
SUN = Light("directional", node=0, intensity=math.pi)
IMAGES = tuple(Image(name, np.full((2, 2, 4), 200, np.uint8)) for name in ("bricks", "leaves"))
MATERIALS = (
    Material(base_color_texture=texture(0)),
    Material(unlit=True, alpha_mode="mask", base_color_texture=texture(1, Sampler())),
)
KINDS = {
    "vulkan": ("VkBuffer", "VkImage", "VkImageView", "VkSampler", "VkPipeline"),
    "gl": ("buffer", "texture", "texture", "sampler", "program"),
}
"""What holds buffers, images, views, samplers and pipelines."""
LABELLED = {
    "buffer": gl.GL_BUFFER,
    "texture": gl.GL_TEXTURE,
    "sampler": gl.GL_SAMPLER,
    "framebuffer": gl.GL_FRAMEBUFFER,
    "vertex array": gl.GL_VERTEX_ARRAY,
    "program": gl.GL_PROGRAM,
}
"""OpenGL's kinds of objects that take a label as soon as they exist."""


def two_squares():
    """Return squares of two materials, with images and samplers of their own."""
    places = (translated(-1.0), translated(1.0))
    return quad_scene(
        materials=MATERIALS, images=IMAGES, matrices=places, instance_materials=(0, 1), lights=(SUN,)
    )


class Calls(list[Any]):
    """A log of calls that hands each one to `read` before it is made: structs are gone afterwards."""

    def __init__(self, read: Callable[[str, Any], None]) -> None:
        super().__init__()
        self._read = read

    def append(self, call: Any) -> None:
        self._read(*call)


@contextmanager
def heard(chapter, read: Callable[[str, Any], None]) -> Iterator[None]:
    """Call `read(name, arguments)` before each call to the graphics API."""
    if chapter.backend == "gl":
        with noted(chapter.device, read):
            yield
        return
    chapter.device.fn.trace(Calls(read))
    try:
        yield
    finally:
        chapter.device.fn.trace(None)


class Names:
    """The names that were given by calls, and the image of each view."""

    def __init__(self, chapter) -> None:
        self._chapter = chapter
        self._given: dict[tuple[str, int], str] = {}
        self._views: list[tuple[Any, int]] = []  # where the call writes the view, and its image

    def read(self, call: str, arguments: Any) -> None:
        """Note what a call names and makes; a handle that is freed may be that of another object later."""
        if call == "vkSetDebugUtilsObjectNameEXT":
            info = arguments[1]
            word = vk.ffi.string(vk.ffi.cast("VkObjectType", info.objectType))
            kind = word.removeprefix("VK_OBJECT_TYPE_").replace("_", "").lower()
            self._given[kind, int(info.objectHandle)] = vk.text(info.pObjectName)
        elif call == "vkCreateImageView":
            self._views.append((arguments[3], number(arguments[1].image)))
        elif call == "glTextureView":
            self._views.append(([arguments[0]], arguments[2]))
        elif call.startswith("vkDestroy") and len(arguments) == 3:
            self._given.pop((call.removeprefix("vkDestroy").lower(), number(arguments[1])), None)
            self._forget(number(arguments[1]))
        elif call == "glDeleteTextures":
            self._forget(arguments[1][0])

    def _forget(self, view: int) -> None:
        self._views = [one for one in self._views if self._handle(one[0]) != view]

    def _handle(self, out: Any) -> int:
        return number(out[0]) if self._chapter.backend == "vulkan" else int(out[0])

    def of(self, kind: str, handle: int) -> str:
        """Return the name of an object, "" if it has none."""
        if self._chapter.backend == "vulkan":
            return self._given.get((kind[2:].lower(), handle), "")
        out = gl.ffi.new("GLchar[256]")
        self._chapter.device.fn.glGetObjectLabel(LABELLED[kind], handle, 256, gl.NULL, out)
        return gl.text(out)

    def views(self) -> dict[int, int]:
        """Return the image of each view that lives, by their handles."""
        return {self._handle(out): image for out, image in self._views}


def test_every_object_has_a_name_that_says_what_it_is(chapter):
    device = chapter.device
    if chapter.backend == "vulkan" and not device.instance.has_debug_utils:
        pytest.skip("the instance names no objects")
    buffer, image, view, sampler, pipeline = KINDS[chapter.backend]
    names, before = Names(chapter), {*device.alive}
    with heard(chapter, names.read), chapter.open(two_squares(), SIZE, outputs=OUTPUTS) as made:
        made.render(facing())
        labelled = [key for key in device.alive if key not in before and key[0] != "query"]
        nameless = [key for key in labelled if not names.of(*key)]
        living: dict[str, dict[int, str]] = {}
        for kind, handle in labelled:
            living.setdefault(kind, {})[handle] = names.of(kind, handle)
        targets, images_of = targets_of(made), names.views()
    assert not nameless
    kinds = (buffer, image, view, sampler, pipeline)
    assert not [kind for kind in kinds if len({*living[kind].values()}) == 1], "one name for all"
    images = {*living[image].values()}
    assert images >= {"bricks", "leaves"} | targets
    shown = {living[image][of]: living[view][handle] for handle, of in images_of.items()}
    assert shown.keys() >= {"bricks", "leaves"}
    assert not [name for of, name in shown.items() if not name.startswith(of) or name == of]
    for word in ("nearest", "linear"):  # the scene has a sampler of each
        assert any(word in name for name in living[sampler].values()), word
    programs = {*living[pipeline].values()}
    assert {"tonemap", "instance"} <= {name.split()[0] for name in programs}
    assert len([name for name in programs if "base_color_map" in name]) == 2, "one for each material"


@pytest.mark.variants("gl")
def test_every_pass_stands_in_a_debug_group_of_its_name(chapter):
    groups, open_groups, draws = [], [], []

    def read(call, arguments):
        if call == "glPushDebugGroup":
            groups.append(arguments[3].decode())
            open_groups.append(groups[-1])
        elif call == "glPopDebugGroup":
            open_groups.pop()
        elif call.startswith(("glDraw", "glMultiDraw", "glDispatch")):
            draws.append(tuple(open_groups))

    with chapter.open(two_squares(), SIZE, outputs=OUTPUTS) as made:
        made.render(facing())
        record_anew(made)
        with heard(chapter, read):
            frame = made.render(facing())
    passes = [*frame.timings]
    assert {"instance_id", "tonemap"} < {*passes}
    assert groups == [*passes, "copy outputs"] and not open_groups
    assert {*draws} == {(name,) for name in passes} - {("motion_objects",)}  # nothing has moved
