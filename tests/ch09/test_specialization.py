"""Specialization constants: what reflection finds, what the driver is handed, and that values change only speed.

Truths: spirv-dis and a list by hand for reflection, the arguments of the driver's calls, sums in float64, the bits of
numbers, and for the passes that use constants the bits of the picture with the loop that reads its length from memory.
"""

from __future__ import annotations

import itertools
import struct

import numpy as np
import pytest

import chapters
from backends import shader_text
from backends.gl.driver.capabilities import extensions, integer
from backends.vulkan import api as vk
from backends.vulkan.shaders.compiler import compile_shader
from chapters import ch09
from chapters.ch09.pipelines.compute_description import ComputeDescription
from chapters.ch09.pipelines.spirv.parser import parse
from chapters.ch09.pipelines.vulkan import Pipelines
from chapters.ch09.pipelines.vulkan_cache import PipelineCache
from chapters.ch09.settings import Settings
from chapters.ch09.shadows import model as shadows
from common.errors import SettingError, ShaderError
from common.settings import apply_overrides, replaced
from tests.support.chapter import Chapter
from tests.support.disassembly import disassembled
from tests.support.jumble import CAMERA
from tests.support.kernels import kernels_on
from tests.support.occluded import EYE_VIEW, METHODS, RAW, RESULT, room
from tests.support.shadows import PLAIN, point, spot, sun, yard

reflection = pytest.mark.feature("specialization/reflection")
constants = pytest.mark.feature("specialization/pipeline-constants")

KNOWN = """
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
layout(constant_id = 7) const int COUNT = -3;
layout(constant_id = 2) const uint MASK = 0xfffffff0u;
layout(constant_id = 4) const float GAIN = 0.1;
layout(constant_id = 11) const bool FLIP = true;
layout(constant_id = 12) const bool KEEP = false;
layout(constant_id = 5) const double EXACT = 0.1lf;
layout(constant_id = 6) const int64_t LONG = -5000000000l;
layout(local_size_x = 16, local_size_x_id = 20, local_size_z_id = 21) in;
const int TWICE = 2 * COUNT;
layout(set = 0, binding = 0) buffer Out_ { double y[]; };
void main() {
    y[0] = double(GAIN) * EXACT + double(TWICE) + double(FLIP ? MASK : 1u) + (KEEP ? double(LONG) : 0.0lf);
}
"""
TABLE = [
    # id, name, type, bytes, default; computed constants have no id, and sides of a work group have no name
    (2, "MASK", "uint", 4, 0xFFFFFFF0),
    (4, "GAIN", "float", 4, float(np.float32(0.1))),
    (5, "EXACT", "double", 8, 0.1),
    (6, "LONG", "int64_t", 8, -5000000000),
    (7, "COUNT", "int", 4, -3),
    (11, "FLIP", "bool", 4, True),
    (12, "KEEP", "bool", 4, False),
    (20, "", "uint", 4, 16),
    (21, "", "uint", 4, 1),
]

SUM = """
layout(local_size_x = 64) in;
layout(constant_id = 3) const int TAPS = 0;
struct Push { uvec4 numbers; };  // x: elements, y: taps
PUSH(Push, push)
layout(BIND(0, 0, 0)) readonly buffer In_ { float x[]; };
layout(BIND(0, 1, 1)) writeonly buffer Out_ { float y[]; };
void main() {
    uint i = gl_GlobalInvocationID.x, n = push.numbers.x;
    int taps = TAPS > 0 ? TAPS : int(push.numbers.y);
    if (i < n) {
        float sum = 0.0;
        for (int k = 0; k < taps; ++k) {
            sum += x[(i + uint(k)) % n] / float(k + 1);
        }
        y[i] = sum;
    }
}
"""
BITS = """
layout(local_size_x = 1) in;
layout(constant_id = 0) const int COUNT = -7;
layout(constant_id = 1) const uint MASK = 0x80000001u;
layout(constant_id = 2) const float GAIN = 0.1;
layout(constant_id = 3) const bool FLIP = true;
const int TWICE = 2 * COUNT;
layout(BIND(0, 0, 0)) writeonly buffer Out_ { uint y[]; };
void main() {
    y[0] = uint(COUNT);
    y[1] = MASK;
    y[2] = floatBitsToUint(GAIN);
    y[3] = FLIP ? 1u : 0u;
    y[4] = uint(TWICE);
}
"""
GROUP = """
layout(constant_id = 0) const uint SUBGROUP_SIZE = 64u;
layout(local_size_x = 64, local_size_x_id = 0) in;
layout(BIND(0, 0, 0)) buffer Out_ { uint y[]; };
void main() {
    y[0] = gl_WorkGroupSize.x;
    y[1] = SUBGROUP_SIZE;
    atomicAdd(y[2 + gl_WorkGroupID.x], 1u);
}
"""


SIZE = (48, 32)


@pytest.fixture(scope="module")
def kernels(chapter):
    with kernels_on(chapter.device, ch09.__name__) as made:
        yield made


@pytest.fixture
def shader(tmp_path):
    """Write the text of a kernel to a file of its own."""
    numbers = itertools.count()

    def write(text, file=None):
        file = file or tmp_path / f"kernel{next(numbers)}.comp"
        file.write_bytes(text.encode())
        return file

    return write


def compiled(text):
    return compile_shader(shader_text.build_text(text, "comp", "vulkan"))


# --- reflection ---


@reflection
def test_constants_of_a_known_module_are_those_that_spirv_dis_shows():
    code = compiled(KNOWN)
    found = [(one.id, one.name, one.type, one.size, one.default) for one in parse(code).constants]
    assert found == TABLE
    (shown,) = disassembled([code])
    assert [(id_, name) for id_, name, _ in shown.constants()] == [row[:2] for row in TABLE]
    for (_, _, of), (_, _, type_, _, default) in zip(shown.constants(), TABLE, strict=True):
        # spirv-dis prints a float with the digits that give it back.
        assert (np.float32(of) == np.float32(default)) if type_ == "float" else (of == float(default))
    widths = {"OpTypeInt": 8, "OpTypeFloat": 8}
    for id_, marks in shown.marks.items():
        if "SpecId" in marks:
            kind, words = shown.made[shown.made[id_][1][0]]
            size = 4 if kind == "OpTypeBool" else int(words[0]) // widths[kind]
            assert size == next(row[3] for row in TABLE if row[0] == int(marks["SpecId"]))


@reflection
def test_a_module_without_constants_has_none_and_a_number_of_another_kind_is_noticed():
    plain = KNOWN.replace("layout(constant_id = 4) const float GAIN", "const float GAIN")
    assert [one.id for one in parse(compiled(plain)).constants] == [row[0] for row in TABLE if row[0] != 4]
    assert parse(compiled("layout(local_size_x = 8) in;\nvoid main() {}\n")).constants == ()


@reflection
def test_values_have_the_bytes_of_their_type_and_what_does_not_fit_is_refused():
    known = {one.name or one.id: one for one in parse(compiled(KNOWN)).constants}
    right = {
        "COUNT": (-(2**31), "<i"),
        "MASK": (2**32 - 1, "<I"),
        "GAIN": (0.7, "<f"),
        "EXACT": (0.7, "<d"),
        "LONG": (-(2**63), "<q"),
        20: (128, "<I"),
    }
    for name, (value, form) in right.items():
        assert known[name].encoded(value) == struct.pack(form, value)
    assert known["GAIN"].encoded(2) == struct.pack("<f", 2.0), "a whole number is a float, too"
    assert known["COUNT"].encoded(np.int64(5)) == struct.pack("<i", 5)
    assert [known["FLIP"].encoded(value) for value in (False, True)] == [bytes(4), b"\1\0\0\0"]
    wrong = {
        "COUNT": (2**31, 0.5, 1.0, True, "3", None),
        "MASK": (-1, 2**32, False),
        "GAIN": (1e39, float("nan"), float("inf"), True, "1"),
        "EXACT": (float("-inf"), None),
        "LONG": (2**63, 0.25),
        "FLIP": (1, 0, 5, 1.0, "yes"),
    }
    for name, values in wrong.items():
        for value in values:
            with pytest.raises(ShaderError) as error:
                known[name].encoded(value)
            sentence = f"The specialization constant '{name}' is {known[name].type}: it cannot be {value!r}."
            assert str(error.value) == sentence


# --- pipelines ---


@constants
@pytest.mark.parametrize("taps", [1, pytest.param(1024, marks=pytest.mark.core)])
def test_a_constant_loop_equals_the_sum_and_the_dynamic_loop(kernels, shader, taps):
    """Each of N terms is rounded, and so is each addition: N + 2 roundings of 2^-24, of the sum of magnitudes."""
    count, file = 1500, shader(SUM)
    dynamic, constant = kernels.pipeline(file), kernels.pipeline(file, specialization=(("TAPS", taps),))
    x = np.random.default_rng(taps).uniform(-1, 1, count).astype(np.float32)
    wrong = np.array([count, 3, 0, 0], np.uint32)  # the constant one does not read it
    _, found = kernels.run(constant, [x, np.zeros_like(x)], (count,), wrong)
    _, looped = kernels.run(
        dynamic, [x, np.zeros_like(x)], (count,), np.array([count, taps, 0, 0], np.uint32)
    )
    terms = np.stack([np.roll(x.astype(np.float64), -k) / (k + 1) for k in range(taps)])
    # Vulkan and OpenGL allow a division 2.5 units in the last place.
    bound = (taps + 2 + 5) * 2.0**-24 * np.abs(terms).sum(0) + 1e-37
    assert (np.abs(found - terms.sum(0)) <= bound).all()
    assert (np.abs(found.astype(np.float64) - looped) <= 2 * bound).all()
    _, other = kernels.run(dynamic, [x, np.zeros_like(x)], (count,), wrong)
    assert np.abs(other - found).max() > 0.1, "another number of taps is another sum"


@constants
@pytest.mark.core
def test_equal_values_share_a_pipeline_and_other_values_have_another(kernels, shader):
    file, before = shader(SUM), len(kernels.pipelines)
    one, many, plain = (
        kernels.pipeline(file, specialization=it) for it in ((("TAPS", 1),), (("TAPS", 1024),), ())
    )
    assert len({id(one), id(many), id(plain)}) == len({one.handle, many.handle, plain.handle}) == 3
    assert kernels.pipeline(file, specialization=(("TAPS", 1024),)) is many
    assert len(kernels.pipelines) == before + 3


@constants
@pytest.mark.variants("gl")
def test_on_opengl_a_value_by_name_and_by_id_is_one_program(kernels, shader):
    file = shader(SUM)
    programs = [kernels.pipeline(file, specialization=((key, 5),)).handle for key in ("TAPS", 3)]
    assert programs[0] == programs[1]


@constants
def test_values_keep_their_bits_and_defaults_stay(kernels, shader):
    file = shader(BITS)

    def bits(*values):
        (found,) = kernels.run(kernels.pipeline(file, specialization=values), [np.zeros(5, np.uint32)], (1,))
        return found.tolist()

    def of_float(value):
        return int(np.float32(value).view(np.uint32))

    def of_int(value):
        return value % 2**32

    assert bits() == [of_int(-7), 0x80000001, of_float(0.1), 1, of_int(-14)]
    assert bits(("FLIP", False)) == [of_int(-7), 0x80000001, of_float(0.1), 0, of_int(-14)]
    assert bits(("COUNT", 5)) == [5, 0x80000001, of_float(0.1), 1, 10], "computed constants follow"
    for count, mask, gain in (
        (-(2**31), 2**32 - 1, 1e-30),
        (2**31 - 1, 0, -3.4028234663852886e38),
        (-1, 2**31, 16777217.0),  # between two floats
        (0, 7, 0.30000001192092896),
        (12, 1, 3),
    ):
        found = bits(("COUNT", count), (1, mask), ("GAIN", gain), (3, False))
        assert found == [of_int(count), mask, of_float(gain), 0, of_int(2 * count)]


WRONG = {
    "a name that is nearly right": (
        (("TAPSS", 3),),
        "No stage has a specialization constant 'TAPSS'; did you mean 'TAPS'?",
    ),
    "an id": (((9, 3),), "No stage has a specialization constant 9"),
    "no name": ((("", 3),), "No stage has a specialization constant ''"),
    "a fraction": ((("TAPS", 0.5),), "The specialization constant 'TAPS' is int: it cannot be 0.5."),
    "a bool": ((("TAPS", True),), "The specialization constant 'TAPS' is int: it cannot be True."),
    "a text": ((("TAPS", "8"),), "The specialization constant 'TAPS' is int: it cannot be '8'."),
    "too much": (((3, 2**40),), f"The specialization constant 'TAPS' is int: it cannot be {2**40}."),
    "two values": (
        (("TAPS", 4), (3, 5)),
        "The specialization constant 'TAPS' has two values, 4 and 5: leave one of them out.",
    ),
}


@constants
@pytest.mark.parametrize("what", WRONG)
def test_wrong_names_and_values_are_one_sentence_on_both_apis(kernels, shader, what):
    values, sentence = WRONG[what]
    file, before = shader(SUM), len(kernels.pipelines)
    with pytest.raises(ShaderError) as error:
        kernels.pipeline(file, specialization=values)
    assert str(error.value).startswith(sentence) and "\n" not in str(error.value)
    assert len(kernels.pipelines) == before


@constants
@pytest.mark.variants("gl")
def test_types_that_opengl_lacks_are_refused_and_messages_keep_their_lines(kernels, shader):
    with pytest.raises(
        ShaderError, match=r"'LONG' is int64_t, and specialization constants on OpenGL are int, "
    ):
        kernels.pipeline(shader("layout(constant_id = 1) const int64_t LONG = 3l;" + SUM))
    text = SUM.replace("TAPS = 0;", "TAPS =\n    0;").replace("y[i] = sum;", "y[i] = summ;")
    line = text[: text.index("summ")].count("\n") + 1
    with pytest.raises(ShaderError, match=rf"kernel\d+\.comp:{line}"):
        kernels.pipeline(shader(text), specialization=(("TAPS", 4),))


@constants
@pytest.mark.variants("gl")
def test_doubles_of_opengl_have_64_bits(kernels, shader):
    text = """
layout(local_size_x = 1) in;
layout(constant_id = 5) const double EXACT = 0.5lf;
layout(BIND(0, 0, 0)) writeonly buffer Out_ { uvec2 y[]; };
void main() { y[0] = unpackDouble2x32(EXACT); }
"""
    pipeline = kernels.pipeline(shader(text), specialization=(("EXACT", 0.1),))
    (found,) = kernels.run(pipeline, [np.zeros(2, np.uint32)], (1,))
    # NVIDIA's compiler reads the decimal to the last bit but one; 32 bits would be 1.5e-9 away.
    assert abs(found.view(np.float64)[0] - 0.1) <= 2.0**-56


@constants
def test_an_edit_keeps_the_values_of_the_description(kernels, shader):
    file = shader(BITS)
    changed = kernels.pipeline(file, specialization=(("COUNT", 5),))
    shader(BITS.replace("GAIN = 0.1", "GAIN = 0.5").replace("COUNT = -7", "COUNT = -9"), file)
    assert len(kernels.reload(file)) == 1
    (found,) = kernels.run(changed, [np.zeros(5, np.uint32)], (1,))
    assert found[0] == 5 and found[2:3].view(np.float32)[0] == 0.5
    shader(BITS.replace("int COUNT", "int NUMBER").replace("COUNT", "NUMBER"), file)
    with pytest.raises(ShaderError, match="No stage has a specialization constant 'COUNT'"):
        kernels.reload(file)
    (found,) = kernels.run(changed, [np.zeros(5, np.uint32)], (1,))
    assert found[0] == 5, "what is wrong changes nothing"
    shader(BITS, file)
    kernels.reload(file)


# --- what Vulkan is handed ---


def handed(device, build):
    """Return what `build` hands to vkCreateComputePipelines: (cache, [(id, bytes)] or None) of each call."""
    log = []
    device.fn.trace(log)
    try:
        build()
    finally:
        device.fn.trace(None)
    calls = []
    for name, arguments in log:
        if name != "vkCreateComputePipelines":
            continue
        info = arguments[3][0].stage.pSpecializationInfo
        if info == vk.NULL:
            calls.append((arguments[1], None))
            continue
        data = bytes(vk.ffi.buffer(info.pData, info.dataSize))
        entries = [info.pMapEntries[number] for number in range(info.mapEntryCount)]
        values = [(one.constantID, data[one.offset : one.offset + one.size]) for one in entries]
        calls.append((arguments[1], values))
    return calls


@reflection
@constants
@pytest.mark.variants("vulkan")
def test_the_driver_gets_values_by_id_and_nothing_without_values(vulkan_device, shader, tmp_path):
    file = str(shader(BITS))
    values = (("FLIP", False), ("COUNT", -2), ("GAIN", 0.25))
    described = [ComputeDescription(file, specialization=it) for it in ((), values, values[1:2])]
    for run in range(2):  # the second one reads the file that the first one left
        cache = PipelineCache(vulkan_device, tmp_path / "cache")
        assert (cache.loaded_bytes > 0) == (run > 0)
        pipelines = Pipelines(vulkan_device, cache)
        try:
            calls = handed(vulkan_device, lambda made=pipelines: made.get([*described, *described]))
            known = cache.handle
        finally:
            pipelines.close()
            cache.close()
        assert [handle == known for handle, _ in calls] == [True] * 3, "one call for each description"
        count, gain, flip = (0, struct.pack("<i", -2)), (2, struct.pack("<f", 0.25)), (3, bytes(4))
        assert [values and sorted(values) for _, values in calls] == [None, [count, gain, flip], [count]]


@constants
@pytest.mark.variants("vulkan")
def test_pipelines_of_other_values_are_of_one_module(kernels, shader):
    file = shader(SUM)
    codes_of = [kernels.pipeline(file, specialization=(("TAPS", it),)).code.codes for it in (1, 1024)]
    assert codes_of[0] == codes_of[1]


# --- work groups ---


def expected_group(chapter):
    """Return the invocations that run together, asked from the driver here; 64, as shaders say, where nothing tells."""
    device = chapter.device
    if chapter.backend == "gl":
        return integer(device.fn, 0x9532) if "GL_KHR_shader_subgroup" in extensions(device.fn) else 64
    subgroup = vk.new("VkPhysicalDeviceSubgroupProperties")
    properties = vk.new("VkPhysicalDeviceProperties2", pNext=subgroup)
    device.instance.fn.vkGetPhysicalDeviceProperties2(device.physical.handle, properties)
    return int(subgroup.subgroupSize)


@constants
def test_a_work_group_read_back_has_the_size_of_a_subgroup(chapter, kernels, shader):
    size = expected_group(chapter)
    pipeline = kernels.pipeline(shader(GROUP))
    assert pipeline.group == (size, 1, 1)
    groups = 3
    (found,) = kernels.run(pipeline, [np.zeros(2 + groups, np.uint32)], (groups * size,))
    assert found.tolist() == [size, size] + [size] * groups
    other = kernels.pipeline(shader(GROUP), specialization=(("SUBGROUP_SIZE", 16),))
    (found,) = kernels.run(other, [np.zeros(2 + groups, np.uint32)], (groups * 16,))
    assert other.group == (16, 1, 1) and found.tolist() == [16, 16] + [16] * groups, (
        "a given value comes first"
    )


@constants
@pytest.mark.variants("vulkan", "gl", long=("gl",))
def test_a_report_that_a_subgroup_copies_at_a_time_is_that_of_the_chapter_before(chapter):
    """There a work group copies 64 words. Every word arrives: as many tiles get memory, and the picture is the same."""
    scene = yard(spot((1.5, 4.0, 1.0), (0.0, 0.0, 0.0)), point((-1.5, 2.5, 1.0)))
    found = []
    for it in (chapter, Chapter(8, chapter.backend, chapter.device)):
        settings = chapters.settings_class(it.which)(**PLAIN, graph="forward", shadow_detail=4.0)
        with it.open(scene, SIZE, settings, outputs=("color_linear",)) as renderer:
            for _ in range(6):
                frame = renderer.render(CAMERA)
            passes = renderer._plan.implementations().values()
            (tell,) = (one for one in passes if one.name == "shadow_need_tell")
            found.append(
                (tell.pipelines[0].group[0], frame.work["shadow_pages"], frame.image("color_linear"))
            )
    assert [group for group, _, _ in found] == [expected_group(chapter), 64]
    assert found[0][1] == found[1][1] > 2 and np.array_equal(found[0][2], found[1][2])


# --- passes ---


def images(chapter, scene, view, names=("color_linear",), size=SIZE, frames=1, **turned):
    """Return images of the last of some frames, with settings of any chapter."""
    kind = chapters.settings_class(chapter.which)
    with chapter.open(
        scene, size, replaced(kind(**PLAIN), **turned), outputs=("color_linear",), inspect=True
    ) as made:
        for _ in range(frames):
            frame = made.render(view)
        return [frame.image(name) for name in names]


@constants
@pytest.mark.parametrize("method", METHODS)
def test_occlusion_by_constants_has_the_bits_of_the_chapter_before(chapter, method):
    """There, radius and steps are text that is compiled."""
    knobs = {"ambient": 0.5, "graph": "deferred", "ssao": method, "ssao_radius": 0.15}
    before = Chapter(8, chapter.backend, chapter.device)
    found, known = (images(it, room(), EYE_VIEW, (RAW, RESULT), **knobs) for it in (chapter, before))
    for one, other in zip(found, known, strict=True):
        assert one.min() < 255 and np.array_equal(one, other)
    other = images(chapter, room(), EYE_VIEW, (RAW,), **(knobs | {"ssao_radius": 0.3}))
    assert not np.array_equal(other[0], found[0]), "another value of the constant is another picture"


@constants
@pytest.mark.variants("vulkan", "gl")
def test_more_points_on_a_ray_miss_less_of_a_wall(chapter):
    """Points that are far apart step over the wall. The truth is the part of rays, distributed as the cosine, that meet
    a wall within the radius: an integral over the hemisphere, by lot in float64."""
    size, knobs = (64, 48), {"ambient": 0.5, "graph": "deferred", "ssao": "normals", "ssao_radius": 0.15}
    rng = np.random.default_rng(2)
    towards = np.sqrt(rng.random(100_000)) * np.cos(2 * np.pi * rng.random(100_000))
    errors = []
    for steps in (1, 4, 16):
        found, depth = images(chapter, room(), EYE_VIEW, (RAW, "depth"), size, **knobs, ssao_steps=steps)
        x, y = np.meshgrid((np.arange(64) + 0.5) / 32 - 1, (np.arange(48) + 0.5) / 24 - 1)
        clip = np.stack([x, y, depth.astype(np.float64), np.ones_like(x)], axis=-1)
        places = clip @ np.linalg.inv(EYE_VIEW.clip_from_view(64 / 48)).T
        places = (places / places[..., 3:]) @ EYE_VIEW.world_from_view.T
        away = places[..., 2] / (0.15 * room().length_scale)
        band = (np.abs(places[..., 1]) < 1e-3) & (np.abs(places[..., 0]) < 2) & (away > 0.02) & (away < 0.8)
        truth = np.mean([(towards < a).mean() for a in away[band]])
        errors.append(found.reshape(size[::-1])[band].mean() / 255 - truth)
    # Measured: 0.152, 0.044 and 0.002. Eight rays in sixteen turns leave a mean well within 0.02.
    assert errors[0] > 0.1 > errors[1] > 0.02 > abs(errors[2])


@constants
@pytest.mark.variants("vulkan")
def test_both_passes_of_the_blur_are_of_one_module(chapter):
    kind = chapters.settings_class(chapter.which)
    settings = kind(**(PLAIN | {"ambient": 0.5}), graph="deferred", ssao="normals")
    with chapter.open(room(), SIZE, settings, outputs=("color_linear",)) as renderer:
        passes = renderer._plan.implementations()
        across, down = (passes[name].pipelines[0] for name in ("ssao_blur_x", "ssao_blur"))
    assert across.code.codes == down.code.codes and across.handle != down.handle


@constants
@pytest.mark.parametrize("graph", ["forward", "deferred", "compute"])
def test_a_constant_radius_of_the_shadow_filter_has_the_bits_of_the_record(chapter, graph):
    """Every light and every kernel; the record is what chapter 8 holds against rays."""
    lights = sun((-1, -3, -1)), spot((1.5, 4.0, 1.0), (0.0, 0.0, 0.0)), point((-1.5, 2.5, 1.0))
    knobs = {"graph": graph, "shadow_memory": "full", "shadow_size": 128, "shadow_sun_size": 256}
    before = None
    for kernel in (1, 3, 13):
        constant, record = (
            images(chapter, yard(*lights), CAMERA, shadow_kernel=kernel, shadow_loop=loop, **knobs)[0]
            for loop in ("constant", "record")
        )
        assert constant.max() > 0 and np.array_equal(constant, record), kernel
        assert before is None or not np.array_equal(before, constant), "another kernel is another picture"
        before = constant


@constants
@pytest.mark.parametrize(
    ("knob", "said"),
    [
        ("ssao_steps=0", "must be 1 to 16, not '0'"),
        ("ssao_steps=17", "must be 1 to 16, not '17'"),
        ("ssao_steps=2.5", "must be a whole number, not '2.5'"),
        ("shadow_loop=unrolled", "must be one of auto, constant, record, not 'unrolled'"),
    ],
)
def test_counts_out_of_range_are_one_sentence(knob, said):
    with pytest.raises(SettingError) as refused:
        apply_overrides(Settings(), [knob])
    assert str(refused.value) == f"setting {knob.partition('=')[0]} {said}"


def test_only_kernels_that_gain_are_constants():
    kind = Settings()
    for kernel, loop, wanted in (
        (3, "record", ()),
        (13, "constant", (("SHADOW_RADIUS", 6),)),
        (1, "auto", (("SHADOW_RADIUS", 0),)),
    ):
        assert shadows.shadow_constants(replaced(kind, shadow_kernel=kernel, shadow_loop=loop)) == wanted
    assert shadows.shadow_constants(replaced(kind, shadow_filter="pcss", shadow_loop="constant")) == ()
