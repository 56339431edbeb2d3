"""Creation descriptors: chains, fields and `reset`, and what Vulkan is asked for, field by field."""

from __future__ import annotations

import copy
import itertools
import random
from contextlib import ExitStack
from dataclasses import MISSING, fields, replace
from types import SimpleNamespace

import numpy as np
import pytest

from backends.creation import BufferCreation, ImageCreation, SamplerCreation
from backends.gl.resources import FORMATS as GL_FORMATS
from backends.vulkan import api as vk
from backends.vulkan.creation import BUFFER_USAGES, IMAGE_USAGES, buffer_from, image_from, sampler_from
from backends.vulkan.resources import (
    FORMATS,
    Buffer,
    Image,
    create_buffer,
    create_image,
    create_sampler,
    destroy_buffer,
    destroy_image,
)
from common.errors import UserError
from common.scene import Sampler
from tests.support.creations import (
    BUFFERS,
    DEFAULTS,
    IMAGES,
    KINDS,
    ONE_FIELD,
    OTHERS,
    SAMPLERS,
    SETTERS,
    chained,
    held,
    ways,
)
from tests.support.raw_calls import vulkan_calls

creation = pytest.mark.feature("device/creation-descriptors")
COPY, SAMPLED, STORAGE = (
    vk.VK_IMAGE_USAGE_TRANSFER_DST_BIT,
    vk.VK_IMAGE_USAGE_SAMPLED_BIT,
    vk.VK_IMAGE_USAGE_STORAGE_BIT,
)
COLOR, DEPTH = vk.VK_IMAGE_USAGE_COLOR_ATTACHMENT_BIT, vk.VK_IMAGE_USAGE_DEPTH_STENCIL_ATTACHMENT_BIT
TEXTURE = ("rgba8", (16, 8), COPY | SAMPLED, "leaves")
CUBES = ("rgba16f", (8, 8), COPY | SAMPLED, "sky")
CUBE = vk.VK_IMAGE_CREATE_CUBE_COMPATIBLE_BIT

KEYWORDS = {
    "texture": (TEXTURE, {"levels": 5}),
    "target": (("rgba16f", (33, 17), COLOR | SAMPLED, "light"), {}),
    "depth": (("d32f", (33, 17), DEPTH, "depth"), {}),
    "samples": (("rgba8", (32, 32), COLOR, "many"), {"samples": 4}),
    "array": (TEXTURE, {"layers": 3, "levels": 2}),
    "array of one": (TEXTURE, {"array": True}),
    "volume": (TEXTURE, {"depth": 5}),
    "cube": (CUBES, {"layers": 6, "levels": 2, "flags": CUBE}),
    "cubes": (CUBES, {"layers": 12, "levels": 2, "flags": CUBE}),
    "sRGB": (("rgba8", (16, 8), STORAGE | SAMPLED, "leaves"), {"view_format": "rgba8_srgb"}),
    "swizzled": (TEXTURE, {"swizzle": "0rg1"}),
}
"""`tests.support.creations.IMAGES` as arguments of `create_image`."""

BUFFER_ARGUMENTS = {
    "uniforms": (1000, vk.VK_BUFFER_USAGE_UNIFORM_BUFFER_BIT, "upload", "matrices"),
    "vertices": (
        4096,
        vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT
        | vk.VK_BUFFER_USAGE_VERTEX_BUFFER_BIT
        | vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT,
        "device",
        "vertices",
    ),
    "readback": (77, vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT, "readback", "picture"),
    "nothing": (0, vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT, "device", ""),
}

# --- the description --------------------------------------------------------------------------------------------------


@creation
@pytest.mark.parametrize("kind", KINDS)
def test_the_tables_of_this_test_have_every_field_and_every_setter(kind):
    """So that a field which is new is set, reset and made below, or is missed here."""
    names = {field.name for field in fields(kind)}
    assert names == {*DEFAULTS[kind]} == {*OTHERS[kind]} == {*kind.RULES}
    assert {name for name in dir(kind) if name.startswith("set_")} == {*SETTERS[kind]}
    assert sorted(itertools.chain(*SETTERS[kind].values())) == sorted(names)
    assert {*ONE_FIELD[kind]} == names - {"place", "families"}
    assert not [name for name in names if OTHERS[kind][name] == DEFAULTS[kind][name]]


@creation
@pytest.mark.parametrize("kind", KINDS)
def test_reset_restores_every_default(kind):
    for described in (kind(**OTHERS[kind]), chained(kind, OTHERS[kind])):
        assert held(described) == OTHERS[kind]
        assert described != kind()
        assert described.reset() is described
        for field in fields(kind):
            assert field.default is not MISSING, f"{field.name} has no default of its own"
            assert getattr(described, field.name) == DEFAULTS[kind][field.name], field.name
        assert described == kind()
        assert held(described.set_name("again")) == DEFAULTS[kind] | {"name": "again"}


@creation
@pytest.mark.parametrize("kind", KINDS)
def test_a_chain_in_any_order_is_the_same_as_fields(kind):
    truth, setters = kind(**OTHERS[kind]), len(SETTERS[kind])
    random_ = random.Random(7)
    for _ in range(50):
        order = random_.sample(range(setters), setters)
        assert chained(kind, OTHERS[kind], order) == truth, order
        again = [*order, *random_.choices(range(setters), k=3)]
        assert chained(kind, OTHERS[kind], again) == truth, again


@creation
def test_descriptions_are_values():
    """Equal by what they hold, whatever the order of words and the type of numbers; a copy is another one."""
    one = BufferCreation(size=64, uses=("storage", "vertex"))
    assert one == BufferCreation().set_uses("vertex", "storage", "vertex").set_size(np.int64(64))
    assert type(BufferCreation(size=np.int64(64)).size) is int
    assert one != BufferCreation(size=64, uses=("storage",))
    other = replace(one, name="other")
    assert (one.name, other.name, other.size) == ("", "other", 64)
    assert copy.copy(one).set_size(8) != one and one.size == 64
    assert ImageCreation() != SamplerCreation() and BufferCreation() != ImageCreation()
    with pytest.raises(TypeError, match="unhashable"):
        hash(one)


@creation
def test_the_sampler_of_materials_is_described_as_it_is():
    assert SamplerCreation().sampler == Sampler()
    words = Sampler("nearest", "linear", None, "clamp", "mirror")
    described = SamplerCreation().set_filters("nearest", "linear", None).set_wraps("clamp", "mirror")
    assert described.sampler == words


@creation
def test_each_use_and_each_format_has_its_constant():
    """Words with the values of the Vulkan specification's `VkBufferUsageFlagBits` and `VkImageUsageFlagBits`."""
    assert BUFFER_USAGES == {
        "copy_source": 0x1,
        "copy_target": 0x2,
        "uniform": 0x10,
        "storage": 0x20,
        "index": 0x40,
        "vertex": 0x80,
        "indirect": 0x100,
        "address": 0x20000,
    }
    assert IMAGE_USAGES == {
        "copy_source": 0x1,
        "copy_target": 0x2,
        "sampled": 0x4,
        "storage": 0x8,
        "color": 0x10,
        "depth": 0x20,
    }
    assert BufferCreation(uses=tuple(BUFFER_USAGES)).uses and ImageCreation(uses=tuple(IMAGE_USAGES)).uses
    assert {*FORMATS} == {*GL_FORMATS}


# --- what is refused --------------------------------------------------------------------------------------------------

WRONG = [
    (BufferCreation, "size", -1, "BufferCreation 'b': size=-1: give a whole number from 0 on."),
    (BufferCreation, "size", 1.5, "size=1.5: give a whole number"),
    (BufferCreation, "memory", "uplod", "BufferCreation 'b': memory='uplod'; did you mean 'upload'?"),
    (BufferCreation, "memory", None, "memory=None; known are 'device', 'readback', 'upload'."),
    (BufferCreation, "uses", ("storage", "uniforms"), "'uniforms'); did you mean 'uniform'?"),
    (BufferCreation, "uses", "storage", "uses='storage': give a tuple."),
    (BufferCreation, "uses", ("sampled",), "known are 'address'"),
    (BufferCreation, "families", (0, -1), "families=(0, -1): give a whole number from 0 on."),
    (BufferCreation, "place", (None,), "place=(None,): give 2 values."),
    (BufferCreation, "place", (None, -4), "place=(None, -4): give a whole number from 0 on."),
    (BufferCreation, "name", 7, "BufferCreation 'b': name=7: give a text."),
    (ImageCreation, "size", (16, 0), "ImageCreation 'b': size=(16, 0): give a whole number from 1 on."),
    (ImageCreation, "size", 16, "size=16: give 2 values."),
    (ImageCreation, "shape", "cubes", "shape='cubes'; did you mean 'cube'?"),
    (ImageCreation, "levels", 0, "levels=0: give a whole number from 1 on."),
    (ImageCreation, "samples", 0, "samples=0: give a whole number from 1 on."),
    (ImageCreation, "samples", 3, "samples=3: give 1, 2, 4, 8, 16, 32 or 64."),
    (ImageCreation, "samples", 128, "samples=128: give 1, 2, 4, 8, 16, 32 or 64."),
    (ImageCreation, "swizzle", "rgb", "swizzle='rgb': give four of the letters 0, 1, r, g, b and a."),
    (ImageCreation, "swizzle", "rgbx", "swizzle='rgbx': give four of the letters"),
    (ImageCreation, "format", 8, "format=8: give a text."),
    (SamplerCreation, "mag", "trilinear", "mag='trilinear'; did you mean 'linear'?"),
    (SamplerCreation, "mag", None, "mag=None"),
    (SamplerCreation, "wrap_u", "clamped", "wrap_u='clamped'; did you mean 'clamp'?"),
    (SamplerCreation, "anisotropy", 0.5, "anisotropy=0.5: give a number from 1 on."),
    (SamplerCreation, "anisotropy", float("nan"), "anisotropy=nan: give a number from 1 on."),
]


@creation
@pytest.mark.parametrize(("kind", "field", "value", "said"), WRONG)
def test_a_wrong_value_is_refused_where_it_is_set(kind, field, value, said):
    """By the same sentence as a keyword and as an assignment, and what was there stays."""
    described = kind(name="b")
    before = held(described)
    for attempt in (lambda: setattr(described, field, value), lambda: replace(described, **{field: value})):
        with pytest.raises(UserError) as raised:
            attempt()
        text = str(raised.value)
        # A keyword `name` that is wrong names nothing yet.
        assert said in text or (field == "name" and said.replace(" 'b'", "") in text)
        assert "\n" not in text and text.endswith((".", "?"))
    assert held(described) == before


@creation
def test_setters_refuse_the_same_and_unknown_fields_are_named():
    with pytest.raises(UserError, match="memory='gpu'; known are 'device'"):
        BufferCreation().set_memory("gpu")
    with pytest.raises(UserError, match="wrap_v='edge'"):
        SamplerCreation().set_wraps("clamp", "edge")
    with pytest.raises(UserError, match=r"^ImageCreation has no field 'level'; did you mean 'levels'\?$"):
        ImageCreation().level = 3
    with pytest.raises(TypeError, match="level"):
        ImageCreation(level=3)


MISFITS = [
    ({"layers": 3}, "layers=3: a '2d' image has one; give the shape 'array'."),
    ({"shape": "cube", "size": (8, 4)}, "size=(8, 4): the faces of a cube are square."),
    ({"shape": "cube", "layers": 2}, "layers=2: a cube has six."),
    ({"shape": "cube_array", "layers": 8}, "layers=8: a cube has six."),
    ({"samples": 4, "levels": 2, "size": (8, 8)}, "samples=4: several are for a '2d' image of one level."),
    ({"samples": 4, "shape": "array"}, "samples=4: several are"),
    ({"levels": 5, "size": (8, 8)}, "levels=5: an image of this size has 4 at most."),
    ({"format": "rgba9"}, "format='rgba9'; did you mean 'rgba8'?"),
    ({"view_format": "rgba8srgb"}, "view_format='rgba8srgb'; did you mean 'rgba8_srgb'?"),
]


@creation
@pytest.mark.parametrize(("values", "said"), MISFITS)
def test_fields_that_do_not_fit_together_are_refused_when_the_image_is_made(values, said):
    for described in (ImageCreation(name="x", **values), chained(ImageCreation, {"name": "x"} | values)):
        with pytest.raises(UserError) as raised:
            described.check(FORMATS)
        assert str(raised.value) == f"ImageCreation 'x': {said}" or said in str(raised.value)
    ImageCreation(shape="3d", layers=16, levels=5, size=(8, 8)).check(FORMATS)


@creation
def test_vulkan_makes_nothing_for_no_use(vulkan_device):
    with pytest.raises(UserError, match="BufferCreation 'b' says no use, and Vulkan must know them all"):
        buffer_from(vulkan_device, BufferCreation(size=64, name="b"))
    with pytest.raises(UserError, match="ImageCreation 'i' says no use"):
        image_from(vulkan_device, ImageCreation(uses=(), name="i"))
    with pytest.raises(UserError, match="did you mean 'rgba8'"):
        image_from(vulkan_device, ImageCreation(format="rgba9"))


# --- what Vulkan is asked for -----------------------------------------------------------------------------------------


class Bench:
    """Makes resources, notes the calls, and frees each before the next: memory then lies where it lay."""

    def __init__(self, device):
        self.device = device

    def calls(self, make, *arguments, **keywords):
        """Return the calls, and for which use memory was asked: a software driver has one type of it for all."""
        made, uses, memory = [], [], self.device.memory

        def allocate(requirements, use, *more, **others):
            uses.append(("memory", use))
            return type(memory).allocate(memory, requirements, use, *more, **others)

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(memory, "allocate", allocate)
            log = vulkan_calls(self.device, lambda: made.append(make(self.device, *arguments, **keywords)))
        self.free(made[0])
        return log + uses

    def free(self, made):
        if isinstance(made, Image):
            destroy_image(self.device, made)
        elif isinstance(made, Buffer):
            destroy_buffer(self.device, made)
        else:
            self.device.destroy("VkSampler", made)


@pytest.fixture(scope="module")
def bench(vulkan_device):
    """A bench on a device that has blocks of all kinds of memory, which no test then makes anew."""
    with ExitStack() as stack:
        for memory in ("device", "upload", "readback"):
            buffer = create_buffer(vulkan_device, 64, BUFFER_USAGES["storage"], memory, memory)
            stack.callback(destroy_buffer, vulkan_device, buffer)
        image = create_image(vulkan_device, "rgba8", (4, 4), SAMPLED, "image")
        stack.callback(destroy_image, vulkan_device, image)
        yield Bench(vulkan_device)


@creation
@pytest.mark.parametrize("case", BUFFERS)
def test_a_buffer_is_that_of_the_keyword_function(bench, case):
    truth = bench.calls(create_buffer, *BUFFER_ARGUMENTS[case])
    assert truth[0][0] == "vkCreateBuffer"
    for described in ways(BufferCreation, BUFFERS[case]):
        assert bench.calls(buffer_from, described) == truth


@creation
@pytest.mark.parametrize("case", IMAGES)
def test_an_image_is_that_of_the_keyword_function(bench, case):
    arguments, keywords = KEYWORDS[case]
    truth = bench.calls(create_image, *arguments, **keywords)
    assert truth[0][0] == "vkCreateImage" and "vkCreateImageView" in dict(truth)
    for described in ways(ImageCreation, IMAGES[case]):
        assert bench.calls(image_from, described) == truth


@creation
@pytest.mark.parametrize("case", SAMPLERS)
def test_a_sampler_is_that_of_the_keyword_function(bench, case):
    values = dict(SAMPLERS[case])
    name, anisotropy = values.pop("name"), values.pop("anisotropy", 1.0)
    truth = bench.calls(create_sampler, Sampler(**values), anisotropy, name)
    assert truth[0][0] == "vkCreateSampler"
    for described in ways(SamplerCreation, SAMPLERS[case]):
        assert bench.calls(sampler_from, described) == truth


@creation
@pytest.mark.parametrize(
    ("kind", "field"), [(kind, field) for kind, table in ONE_FIELD.items() for field in table]
)
def test_each_field_reaches_vulkan(bench, kind, field):
    """A field that the functions forgot would make the same resource with another value."""
    make = {BufferCreation: buffer_from, ImageCreation: image_from, SamplerCreation: sampler_from}[kind]
    around, other = ONE_FIELD[kind][field]
    plain = bench.calls(make, kind(**around))
    assert plain == bench.calls(make, chained(kind, around))
    assert plain != bench.calls(make, kind(**around | {field: other}))


@creation
def test_a_place_of_the_callers_is_taken(bench):
    """Both kinds are bound where they are told, and no memory is asked for."""
    device = bench.device
    buffer = create_buffer(device, 1 << 16, BUFFER_USAGES["storage"], "device", "place")
    image = create_image(device, "rgba8", (64, 64), COPY | SAMPLED, "place")
    try:
        for make, call, held_by, described in (
            (buffer_from, "vkBindBufferMemory", buffer, BufferCreation(size=64, uses=("storage",))),
            (image_from, "vkBindImageMemory", image, ImageCreation(size=(64, 64))),
        ):
            place = held_by.allocation.memory, held_by.allocation.offset
            log = []
            device.fn.trace(log)
            made = make(device, described.set_place(*place))
            device.fn.trace(None)
            bound = [arguments[2:] for name, arguments in log if name == call]
            assert bound == [place] and made.allocation is None
            bench.free(made)
    finally:
        destroy_image(device, image)
        destroy_buffer(device, buffer)


@creation
def test_queue_families_share_a_buffer():
    """On a device that only takes notes: the software driver has one family."""
    made = []
    device = SimpleNamespace(
        create=lambda call, info, name: made.append(info) or vk.NULL,
        fn=SimpleNamespace(vkBindBufferMemory=lambda *_: 0),
        handle=vk.NULL,
    )
    buffer_from(device, BufferCreation(uses=("storage",)).set_families(2, 0).set_place(vk.NULL, 0))
    (info,) = made
    assert info.sharingMode == vk.VK_SHARING_MODE_CONCURRENT
    assert [info.pQueueFamilyIndices[n] for n in range(info.queueFamilyIndexCount)] == [2, 0]
