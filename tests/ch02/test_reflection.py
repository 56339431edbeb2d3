"""Reflection: stages merged into one signature, errors that name both places, and layouts that the driver accepts."""

from __future__ import annotations

import itertools
from contextlib import ExitStack
from types import SimpleNamespace

import numpy as np
import pytest

from backends import shader_text
from backends.vulkan import api as vk
from backends.vulkan.barriers import transition
from backends.vulkan.once import submit_once
from backends.vulkan.readback import read_image
from backends.vulkan.resources import create_buffer, create_image, destroy_buffer, destroy_image
from backends.vulkan.shaders.compiler import compile_shader
from chapters.ch02.pipelines import vulkan_layouts
from chapters.ch02.pipelines.description import PipelineDescription
from chapters.ch02.pipelines.vulkan import Pipelines
from chapters.ch02.pipelines.vulkan_cache import PipelineCache
from chapters.ch02.pipelines.vulkan_layouts import CAPACITY, Layouts
from chapters.ch02.pipelines.vulkan_reflection import STAGES, Binding, Push, Signature, Stage, merge
from common.errors import ShaderError, UnsupportedError
from tests.support import snapshots

layout = pytest.mark.feature("reflection/pipeline-layout")
RAYS = ("rgen", "rint", "rahit", "rchit", "rmiss", "rcall")
VERT, FRAG, COMP, TASK, MESH = (STAGES[name] for name in ("vert", "frag", "comp", "task", "mesh"))
OPEN = vk.VK_DESCRIPTOR_BINDING_PARTIALLY_BOUND_BIT | vk.VK_DESCRIPTOR_BINDING_UPDATE_AFTER_BIND_BIT
NONUNIFORM = ("GL_EXT_nonuniform_qualifier",)


def stage(text, kind, extensions=NONUNIFORM):
    source = shader_text.build_text(text, kind, "vulkan", name=f"<{kind}>", extensions=extensions)
    return Stage(compile_shader(source), source)


COMMON = """
layout(set = 0, binding = 0, std140) uniform Frame { mat4 clip_from_world; vec4 tint; } frame;
layout(set = 0, binding = 1, std430) readonly buffer Vertices { vec4 positions[]; };
"""
VERTEX = (
    COMMON
    + """
layout(push_constant) uniform Push { uvec4 draw; } push;
void main() { gl_Position = frame.clip_from_world * positions[VERTEX_ID + push.draw.x]; }
"""
)
FRAGMENT = (
    COMMON
    + """
layout(set = 2, binding = 10) uniform sampler2D flat_textures[];
layout(set = 2, binding = 10) uniform sampler3D deep_textures[];
layout(set = 2, binding = 10) uniform usampler2D whole_textures[];
layout(set = 2, binding = 3) uniform sampler2D noise;
layout(push_constant) uniform Push { uvec4 draw; float gain; } push;
layout(location = 0) out vec4 color;
void main() {
    uint i = push.draw.y;
    color = frame.tint * push.gain + texture(flat_textures[nonuniformEXT(i)], vec2(0)) + texture(noise, vec2(0));
    color += texture(deep_textures[nonuniformEXT(i)], vec3(0));
    color += vec4(texture(whole_textures[nonuniformEXT(i)], vec2(0)));
}
"""
)


@pytest.fixture
def stages():
    return [stage(VERTEX, "vert"), stage(FRAGMENT, "frag")]


@layout
def test_a_signature_holds_the_bindings_of_all_stages(stages):
    merged = merge(stages)
    assert merged.sets == (
        (
            Binding(0, "uniform", 1, "frame", VERT | FRAG),
            Binding(1, "storage", 1, "Vertices", VERT | FRAG),
        ),
        (),
        (Binding(3, "texture", 1, "noise", FRAG), Binding(10, "texture", 0, "flat_textures", FRAG)),
    )
    assert merged.push == Push(0, 20, VERT | FRAG)
    assert merged.stages == VERT | FRAG


def test_what_a_stage_declares_and_does_not_read_counts_too(stages):
    """So shaders that include one file of bindings have one layout, whatever each of them reads."""
    silent = stage(COMMON + "layout(location = 0) out vec4 c;\nvoid main() { c = vec4(1); }", "frag")
    assert merge([silent]).sets[0] == tuple(
        Binding(one.number, one.kind, one.count, one.name, FRAG) for one in merge(stages).sets[0]
    )


@layout
def test_the_order_of_stages_makes_no_difference():
    mesh_shader = ("GL_EXT_mesh_shader",)
    task = "layout(local_size_x = 1) in;\nlayout(set = 1, binding = 0) buffer A { uint a[]; } only_task;\n"
    task += COMMON + "void main() { only_task.a[0] = 1; EmitMeshTasksEXT(1, 1, 1); }"
    mesh = (
        COMMON + "layout(local_size_x = 1) in; layout(triangles, max_vertices = 3, max_primitives = 1) out;\n"
    )
    mesh += "layout(push_constant) uniform P { layout(offset = 32) vec2 p; };\n"
    mesh += "void main() { SetMeshOutputsEXT(3, 1); gl_MeshVerticesEXT[0].gl_Position = p.xyxy; }"
    frag = COMMON.replace(" frame;", " other_name;") + "layout(location = 0) out vec4 c;\n"
    frag += "layout(push_constant) uniform P { vec3 q; };\nvoid main() { c = q.xyzz; }"
    made = [stage(task, "task", mesh_shader), stage(mesh, "mesh", mesh_shader), stage(frag, "frag")]
    merged = merge(made)
    assert all(merge(order) == merged for order in itertools.permutations(made))
    assert merged.sets[0][0] == Binding(0, "uniform", 1, "frame", TASK | MESH | FRAG)
    assert merged.sets[1] == (Binding(0, "storage", 1, "only_task", TASK),)
    assert merged.push == Push(0, 40, MESH | FRAG)


@layout
def test_a_buffer_is_dynamic_by_its_name_or_by_an_argument(stages):
    def kinds(text, dynamic=()):
        return [one.kind for one in merge([stage(text, "vert")], dynamic).sets[0]]

    assert kinds(VERTEX) == ["uniform", "storage"]
    assert kinds(VERTEX.replace("frame", "dyn_frame")) == ["dynamic uniform", "storage"]
    assert kinds(VERTEX.replace("Frame", "dyn_Frame")) == ["dynamic uniform", "storage"]
    assert kinds(VERTEX.replace("Vertices", "dyn_Vertices")) == ["uniform", "dynamic storage"]
    assert kinds(VERTEX, ["frame"]) == kinds(VERTEX, ["Frame"]) == ["dynamic uniform", "storage"]
    with pytest.raises(ShaderError, match=r"No stage has a buffer 'frames' .*; did you mean 'Frame'\?$"):
        merge(stages, ["frames"])
    with pytest.raises(ShaderError, match="No stage has a buffer 'noise'"):
        merge(stages, ["noise"])
    # One stage that says so is enough, whichever it is.
    other = stage(FRAGMENT.replace("frame", "dyn_frame"), "frag")
    for order in ([stages[0], other], [other, stages[0]]):
        assert merge(order).sets[0][0].kind == "dynamic uniform"


def test_an_open_array_takes_in_one_to_which_the_compiler_gave_a_length():
    """Whichever of the stages it is that indexes the array by a constant alone."""
    declared = "layout(set = 0, binding = 0) uniform sampler2D maps[];\n"

    def sampling(kind, index):
        target = "gl_Position" if kind == "vert" else "color"
        output = "" if kind == "vert" else "layout(location = 0) out vec4 color;\n"
        push = "layout(push_constant) uniform Push { uint i; };\n"
        body = f"void main() {{ {target} = textureLod(maps[{index}], vec2(0), 0.0); }}"
        return stage(declared + output + push + body, kind)

    for vertex, fragment, count in (("3", "3", 4), ("3", "i", 0), ("i", "3", 0), ("i", "i", 0)):
        made = [sampling("vert", vertex), sampling("frag", fragment)]
        assert merge(made).sets[0][0].count == count
        assert merge(made[::-1]) == merge(made)


# --- disagreements ---

PLAIN_VERTEX = """// A comment that names maps.
layout(location = 0) out vec2 uv;

{declared}
void main() {{
    uv = vec2(0);
    gl_Position = vec4(0);
}}
"""
PLAIN_FRAGMENT = """layout(location = 0) out vec4 color;
{declared}
void main() {{ color = vec4(0); }}
"""
PLACE = "layout(set = 0, binding = 4) "
DISAGREEMENTS = {
    "kind": (
        PLACE + "uniform sampler2D maps;",
        PLACE + "uniform texture2D maps;",
        ("the texture 'maps'", "the sampled image 'maps'"),
    ),
    "count": (
        PLACE + "uniform sampler2D maps[4];",
        PLACE + "uniform sampler2D maps[8];",
        ("the texture 'maps' with 4 elements", "the texture 'maps' with 8 elements"),
    ),
    "size": (
        PLACE + "uniform Block { vec4 a; } block;",
        PLACE + "uniform Block {\n    vec4 a;\n    float b;\n} block;",
        ("the uniform block 'block' of 16 bytes", "the uniform block 'block' of 20 bytes"),
    ),
    "buffer": (
        PLACE + "readonly buffer Words { uint words[]; };",
        PLACE + "uniform Words { uvec4 words[4]; };",
        ("the storage block 'Words' of 0 bytes", "the uniform block 'Words' of 64 bytes"),
    ),
}


@layout
@pytest.mark.parametrize("what", DISAGREEMENTS)
def test_a_disagreement_names_both_files_and_lines(what, tmp_path):
    one, two, said = DISAGREEMENTS[what]
    vertex, fragment = tmp_path / "one.vert", tmp_path / "two.frag"
    vertex.write_text(PLAIN_VERTEX.format(declared=one), "utf-8")
    fragment.write_text(PLAIN_FRAGMENT.format(declared=two), "utf-8")
    sources = [shader_text.build(path, "vulkan") for path in (vertex, fragment)]
    made = [Stage(compile_shader(source), source) for source in sources]
    texts = set()
    for order in (made, made[::-1]):
        with pytest.raises(ShaderError) as caught:
            merge(order)
        texts.add(str(caught.value))
        assert {vertex, fragment} <= caught.value.files, "an edit of either may repair it"
    (text,) = texts
    assert f"Set 0, binding 4 is {said[0]} in {vertex}:4 and {said[1]} in {fragment}:2" in text
    assert "\n" not in text


def test_a_declaration_in_an_include_names_the_shader_too(tmp_path):
    include = "// Bindings.\n#ifdef MANY\nlayout(BIND(0, 4, 0)) uniform sampler2D maps[8];\n#else\n"
    include += "layout(set = 0, binding = 4) uniform sampler2D maps;\n#endif\n"
    (tmp_path / "bindings.glsl").write_text(include, "utf-8")
    for name, text in (("one.vert", PLAIN_VERTEX), ("two.frag", PLAIN_FRAGMENT)):
        many = "#define MANY 1\n" if name == "one.vert" else "\n"
        (tmp_path / name).write_text(many + text.format(declared='#include "bindings.glsl"'), "utf-8")
    sources = [shader_text.build(tmp_path / name, "vulkan") for name in ("one.vert", "two.frag")]
    with pytest.raises(ShaderError) as caught:
        merge([Stage(compile_shader(source), source) for source in sources])
    for name in ("one.vert", "two.frag"):
        assert f"{tmp_path / name} ({tmp_path / 'bindings.glsl'}:" in str(caught.value)


def test_two_kinds_at_one_place_of_one_stage_disagree_too():
    text = PLAIN_FRAGMENT.format(declared=PLACE + "uniform sampler2D a;\n" + PLACE + "uniform texture2D b;")
    with pytest.raises(
        ShaderError, match=r"the texture 'a' in <frag>:2 and the sampled image 'b' in <frag>:3"
    ):
        merge([stage(text, "frag")])


def test_what_the_parser_refuses_names_the_file():
    text = "layout(constant_id = 0) const int n = 2;\nlayout(set = 0, binding = 0) uniform sampler2D maps[n * 2];\n"
    with pytest.raises(ShaderError, match=r"^<frag>: The length of 'maps' is computed"):
        merge([stage(text + PLAIN_FRAGMENT.format(declared=""), "frag")])


# --- layouts ---


@pytest.fixture
def layouts(vulkan_device):
    made = Layouts(vulkan_device)
    yield made
    made.close()


def traced(device, call, do):
    """Return the infos with which `do` calls `call`, and what it returns."""
    log: list = []
    device.fn.trace(log)
    try:
        result = do()
    finally:
        device.fn.trace(None)
    return [arguments[1] for name, arguments in log if name == call], result


def bindings_of(info):
    return [
        tuple(getattr(info.pBindings[i], name) for name in ("binding", "descriptorType", "descriptorCount"))
        for i in range(info.bindingCount)
    ]


def all_graphics(device):
    return vk.VK_SHADER_STAGE_ALL_GRAPHICS | (TASK | MESH if device.has("mesh-shader") else 0)


def visible(device, node):
    """Return the stages that share the sets of draws: kernels do from chapter 7 on, and rays from chapter 12 on."""
    number = snapshots.tested(node).number
    rays = sum(STAGES[name] for name in RAYS) if number >= 12 and device.has("ray-tracing") else 0
    return all_graphics(device) | (COMP if number >= 7 else 0) | rays


def fixed(text):
    """Return the fragment shader without its open arrays, for a device without descriptor indexing."""
    kept = [line for line in text.splitlines() if "_textures" not in line]
    return "\n".join(kept).replace(
        "uint i = push.draw.y;", "color = frame.tint * push.gain + texture(noise, vec2(0));"
    )


@layout
def test_equal_tables_share_their_layouts_and_any_order_of_stages_is_one(layouts, vulkan_device, request):
    made = [stage(VERTEX, "vert"), stage(fixed(FRAGMENT), "frag")]
    infos, (handle, sets) = traced(
        vulkan_device, "vkCreateDescriptorSetLayout", lambda: layouts.pipeline(merge(made))
    )
    tables = [bindings_of(info) for info in infos]
    uniform, storage, texture = (vulkan_layouts.TYPES[kind] for kind in ("uniform", "storage", "texture"))
    assert tables == [[(0, uniform, 1), (1, storage, 1)], [(3, texture, 1)], []]
    stages = {info.pBindings[i].stageFlags for info in infos for i in range(info.bindingCount)}
    assert stages == {visible(vulkan_device, request.node)}
    assert sets[1] is None and sets[0].bindings == merge(made).sets[0]
    assert [one.counts for one in (sets[0], sets[2])] == [(1, 1), (1,)]
    log: list = []
    vulkan_device.fn.trace(log)
    assert layouts.pipeline(merge(made[::-1])) == (handle, sets)
    alone = layouts.pipeline(merge([stage(VERTEX.replace("frame", "constants"), "vert")]))[1][0]
    vulkan_device.fn.trace(None)
    assert alone.handle == sets[0].handle, (
        "the names of bindings, and who declares them, make no other layout"
    )
    assert alone.bindings[0].name == "constants" and alone.bindings[0].stages == VERT
    made_now = [name for name, _ in log if name.startswith("vkCreate")]
    assert made_now == ["vkCreatePipelineLayout"], "its push constants are shorter"


@pytest.mark.until(6, "from chapter 7 on kernels and draws share layouts")
def test_compute_has_layouts_of_its_own(layouts, vulkan_device):
    made = [stage("layout(local_size_x = 1) in;" + COMMON + "void main() {}", "comp"), stage(VERTEX, "vert")]
    infos, sets = traced(
        vulkan_device,
        "vkCreateDescriptorSetLayout",
        lambda: [layouts.sets(merge([one]))[0] for one in made],
    )
    assert sets[0].handle != sets[1].handle
    flags = [{info.pBindings[i].stageFlags for i in range(info.bindingCount)} for info in infos]
    assert flags == [{COMP}, {all_graphics(vulkan_device)}]


@layout
def test_push_constants_reach_the_layout(layouts, vulkan_device, request):
    made = [stage(VERTEX, "vert"), stage(fixed(FRAGMENT), "frag")]
    (info,), _ = traced(vulkan_device, "vkCreatePipelineLayout", lambda: layouts.pipeline(merge(made)))
    assert (info.setLayoutCount, info.pushConstantRangeCount) == (3, 1)
    (range_,) = (info.pPushConstantRanges[i] for i in range(1))
    assert (range_.offset, range_.size, range_.stageFlags) == (0, 20, visible(vulkan_device, request.node))


@layout
@pytest.mark.variants("vulkan")
def test_open_arrays_are_partially_bound_and_written_while_bound(vulkan_device):
    if not vulkan_device.has("bindless"):
        pytest.skip("the device has no descriptor indexing")
    layouts = Layouts(vulkan_device, 5000)
    infos, sets = traced(
        vulkan_device,
        "vkCreateDescriptorSetLayout",
        lambda: layouts.sets(merge([stage(FRAGMENT, "frag")])),
    )
    found = sets[2]
    assert (found.runtime, found.variable, found.counts) == (True, True, (1, 5000))
    assert not sets[0].runtime and not sets[0].variable
    plain, info = infos
    assert plain.flags == 0
    assert info.flags == vk.VK_DESCRIPTOR_SET_LAYOUT_CREATE_UPDATE_AFTER_BIND_POOL_BIT
    flags = vk.ffi.cast("VkDescriptorSetLayoutBindingFlagsCreateInfo *", info.pNext)
    assert [flags.pBindingFlags[i] for i in range(flags.bindingCount)] == [
        0,
        OPEN | vk.VK_DESCRIPTOR_BINDING_VARIABLE_DESCRIPTOR_COUNT_BIT,
    ]
    # The open array is not the last binding of the set: its length is fixed when the layout is made.
    _, sets = traced(
        vulkan_device,
        "vkCreateDescriptorSetLayout",
        lambda: layouts.sets(merge([stage(FRAGMENT.replace("binding = 3", "binding = 11"), "frag")])),
    )
    assert (sets[2].runtime, sets[2].variable, sets[2].counts) == (True, False, (5000, 1))
    layouts.close()


@pytest.mark.variants("vulkan")
def test_an_open_array_gets_no_more_than_the_device_has(vulkan_device):
    if not vulkan_device.has("bindless"):
        pytest.skip("the device has no descriptor indexing")
    layouts = Layouts(vulkan_device, 10**6)
    merged = merge([stage(FRAGMENT, "frag")])
    limits = {
        "maxPerStageDescriptorUpdateAfterBindSampledImages": 1000,
        "maxDescriptorSetUpdateAfterBindSamplers": 700,
        "maxPerStageUpdateAfterBindResources": 800,
    }
    most = {name for name in dir(layouts._indexing) if "UpdateAfterBind" in name and name.startswith("max")}
    layouts._indexing = SimpleNamespace(**dict.fromkeys(most, 10**7) | limits)
    for room in (700, 800, 1000, 10**7):
        limits = {name: limit for name, limit in limits.items() if limit >= room}
        layouts._indexing = SimpleNamespace(**dict.fromkeys(most, 10**7) | limits)
        counts = layouts.sets(merged)[2].counts
        assert counts[0] == 1 and sum(counts) == min(room - vulkan_layouts._RESERVED, 10**6 + 1)
    two = FRAGMENT.replace("binding = 10) uniform sampler3D", "binding = 12) uniform sampler3D")
    layouts._indexing = SimpleNamespace(
        **dict.fromkeys(most, 10**7) | {"maxUpdateAfterBindDescriptorsInAllPools": 1065}
    )
    assert layouts.sets(merge([stage(two, "frag")]))[2].counts == (1, 500, 500), "two open arrays share it"
    layouts.close()


OPEN_ARRAYS = {
    "texture": ("SampledImages", "Samplers"),
    "sampled image": ("SampledImages",),
    "sampler": ("Samplers",),
    "image": ("StorageImages",),
    "uniform texels": ("SampledImages",),
    "storage texels": ("StorageImages",),
    "storage": ("StorageBuffers",),
    "uniform": ("UniformBuffers",),
}
"""What the descriptors of an open array count as: the definitions of the members of
VkPhysicalDeviceDescriptorIndexingProperties in the Vulkan specification."""


@pytest.mark.variants("vulkan")
@pytest.mark.parametrize("kind", OPEN_ARRAYS)
@pytest.mark.parametrize("owner", ["maxPerStageDescriptorUpdateAfterBind", "maxDescriptorSetUpdateAfterBind"])
def test_each_limit_holds_for_its_kinds_of_open_arrays(vulkan_device, kind, owner):
    if not vulkan_device.has("bindless"):
        pytest.skip("the device has no descriptor indexing")
    layouts = Layouts(vulkan_device, 10**5)
    array = Signature(((Binding(0, kind, 0, "open", FRAG),),), None, FRAG)
    most = {name for name in dir(layouts._indexing) if "UpdateAfterBind" in name and name.startswith("max")}
    try:
        for name in ("SampledImages", "Samplers", "StorageImages", "StorageBuffers", "UniformBuffers"):
            few = {owner + name: 500}
            layouts._indexing = SimpleNamespace(**dict.fromkeys(most, 10**7) | few)
            layout = layouts.sets(array)[0]
            holds = name in OPEN_ARRAYS[kind]
            assert layout.counts == (500 - vulkan_layouts._RESERVED if holds else 10**5,), name
    finally:
        layouts.close()


@pytest.mark.variants("without-all")
def test_without_descriptor_indexing_an_open_array_is_refused_by_name(layouts):
    with pytest.raises(UnsupportedError, match="The array 'flat_textures' has no end"):
        layouts.sets(merge([stage(FRAGMENT, "frag")]))


@pytest.mark.variants("vulkan")
def test_what_no_device_takes_is_one_sentence(layouts, vulkan_device):
    most = vulkan_device.limits.maxBoundDescriptorSets
    if most < 2**16:
        text = PLAIN_FRAGMENT.format(
            declared=PLACE.replace("set = 0", f"set = {most}") + "uniform sampler2D a;"
        )
        with pytest.raises(UnsupportedError, match=f"uses set {most}, and this device binds {most}"):
            layouts.pipeline(merge([stage(text, "frag")]))
    size = vulkan_device.limits.maxPushConstantsSize + 16
    text = f"layout(push_constant) uniform P {{ vec4 a[{size // 16}]; }};"
    with pytest.raises(UnsupportedError, match=f"{size} bytes of push constants"):
        layouts.pipeline(merge([stage(PLAIN_FRAGMENT.format(declared=text), "frag")]))
    if vulkan_device.has("bindless"):
        moving = FRAGMENT.replace("set = 0", "set = 2").replace("frame", "dyn_frame")
        with pytest.raises(
            ShaderError, match="dynamic buffer 'dyn_frame' is in one set with an array without"
        ):
            layouts.sets(merge([stage(moving, "frag")]))


# --- pipelines ---


@pytest.fixture
def pipelines(vulkan_device):
    made = Pipelines(vulkan_device)
    yield made
    made.close()


def written(folder, vertex, fragment, **more):
    """Return the pipeline of two shaders that are written to `folder`."""
    for name, text in (("own.vert", vertex), ("own.frag", fragment)):
        (folder / name).write_text(text, "utf-8")
    paths = tuple(str(folder / name) for name in ("own.vert", "own.frag"))
    return PipelineDescription(paths, color="rgba32f", depth=None, **more)


@pytest.mark.feature("reflection/spirv-parser")
@layout
@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_the_projects_shaders_need_no_layout_by_hand(pipelines, order):
    names = ("post/fullscreen.vert", "post/tonemap.frag")
    shaders = tuple(names[number] for number in order)
    (built,) = pipelines.get([PipelineDescription(shaders, color="rgba8", depth=None)])
    assert built.sets[0].bindings == (Binding(0, "texture", 1, "color_hdr", FRAG),)
    assert (len(built.sets), built.push_stages) == (1, 0)


COVER = "vec4(VERTEX_ID == 1 ? 3.0 : -1.0, VERTEX_ID == 2 ? 3.0 : -1.0, 0.0, 1.0)"
DRAWN_VERTEX = f"""
layout(constant_id = 7) const float depth = 0.5;
void main() {{ gl_Position = {COVER} + vec4(0, 0, depth, 0); }}
"""
DRAWN_FRAGMENT = """
layout(constant_id = 1) const float gain = 1.0;
layout(constant_id = 2) const bool flip = false;
layout(constant_id = 3) const int count = 2;
layout(constant_id = 4) const uint mask = 0u;
layout(set = 1, binding = 2) uniform dyn_Tint { vec4 tint; };
layout(push_constant) uniform Push { vec4 added; };
layout(location = 0) out vec4 color;
void main() {
    color = vec4(gain, flip ? 1.0 : 0.0, count, float(mask >> 24)) * tint + added;
}
"""


@pytest.mark.feature("device/uniform-buffers")
@layout
def test_a_draw_reads_constants_push_constants_and_a_dynamic_buffer(pipelines, vulkan_device, tmp_path):
    """Everything that was derived, at work: values by name and by id, an offset at the bind, 16 pushed bytes."""
    device, fn = vulkan_device, vulkan_device.fn
    special = (("gain", 0.25), ("flip", True), (3, -5), ("mask", 0xC0000000), ("depth", 0.25))
    described = written(tmp_path, DRAWN_VERTEX, DRAWN_FRAGMENT, specialization=special)
    plain, built = pipelines.get([written(tmp_path, DRAWN_VERTEX, DRAWN_FRAGMENT), described])
    assert plain.layout == built.layout and built.sets[0] is None
    assert built.sets[1].bindings == (Binding(2, "dynamic uniform", 1, "dyn_Tint", FRAG),)
    step = max(int(device.limits.minUniformBufferOffsetAlignment), 16)
    with ExitStack() as stack:
        buffer = create_buffer(device, 2 * step, vk.VK_BUFFER_USAGE_UNIFORM_BUFFER_BIT, "upload", "tints")
        stack.callback(destroy_buffer, device, buffer)
        buffer.mapped[:] = 0
        buffer.mapped[step : step + 16] = np.array([1, 2, 3, 4], np.float32).view(np.uint8)
        info = vk.new(
            "VkDescriptorPoolCreateInfo",
            maxSets=1,
            pPoolSizes=[{"type": vulkan_layouts.TYPES["dynamic uniform"], "descriptorCount": 1}],
        )
        pool = device.create("vkCreateDescriptorPool", info, "tints")
        stack.callback(device.destroy, "VkDescriptorPool", pool)
        sets = vk.ffi.new("VkDescriptorSet[1]")
        info = vk.new("VkDescriptorSetAllocateInfo", descriptorPool=pool, pSetLayouts=[built.sets[1].handle])
        vk.check(fn.vkAllocateDescriptorSets(device.handle, info, sets), "vkAllocateDescriptorSets")
        write = vk.new(
            "VkWriteDescriptorSet",
            dstSet=sets[0],
            dstBinding=2,
            descriptorCount=1,
            descriptorType=vulkan_layouts.TYPES["dynamic uniform"],
            pBufferInfo=[{"buffer": buffer.handle, "range": 16}],
        )
        fn.vkUpdateDescriptorSets(device.handle, 1, write, 0, vk.NULL)
        usage = vk.VK_IMAGE_USAGE_COLOR_ATTACHMENT_BIT | vk.VK_IMAGE_USAGE_TRANSFER_SRC_BIT
        found = {}
        for name, pipeline in (("plain", plain), ("special", built)):
            target = create_image(device, "rgba32f", (4, 4), usage, name)
            stack.callback(destroy_image, device, target)
            attachment = {
                "imageView": target.view,
                "imageLayout": vk.VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL,
                "storeOp": vk.VK_ATTACHMENT_STORE_OP_STORE,
                "loadOp": vk.VK_ATTACHMENT_LOAD_OP_CLEAR,
            }
            area = {"extent": {"width": 4, "height": 4}}
            rendering = vk.new(
                "VkRenderingInfo", renderArea=area, layerCount=1, pColorAttachments=[attachment]
            )
            added = np.array([10, 20, 30, 40], np.float32)
            with submit_once(device) as commands:
                transition(device, commands, target, "undefined", "color")
                fn.vkCmdBeginRendering(commands, rendering)
                fn.vkCmdBindPipeline(commands, vk.VK_PIPELINE_BIND_POINT_GRAPHICS, pipeline.handle)
                fn.vkCmdSetViewport(commands, 0, 1, vk.new("VkViewport", width=4.0, height=4.0, maxDepth=1.0))
                fn.vkCmdSetScissor(commands, 0, 1, vk.new("VkRect2D", **area))
                fn.vkCmdSetCullMode(commands, vk.VK_CULL_MODE_NONE)
                fn.vkCmdSetFrontFace(commands, vk.VK_FRONT_FACE_COUNTER_CLOCKWISE)
                offsets = vk.array("uint32_t", [step])
                fn.vkCmdBindDescriptorSets(
                    commands, vk.VK_PIPELINE_BIND_POINT_GRAPHICS, pipeline.layout, 1, 1, sets, 1, offsets
                )
                fn.vkCmdPushConstants(
                    commands, pipeline.layout, pipeline.push_stages, 0, 16, vk.ffi.from_buffer(added)
                )
                fn.vkCmdDraw(commands, 3, 1, 0, 0)
                fn.vkCmdEndRendering(commands)
            found[name] = read_image(device, target, "color")
    assert (found["plain"] == [1 + 10, 0 + 20, 2 * 3 + 30, 0 + 40]).all()
    assert (found["special"] == [0.25 + 10, 2 + 20, -5 * 3 + 30, 0xC0 * 4 + 40]).all()


def test_constants_that_do_not_exist_or_do_not_fit_are_refused(pipelines, tmp_path):
    for special, sentence in (
        ((("gian", 1.0),), "No stage has a specialization constant 'gian'; did you mean 'gain'"),
        (((9, 1.0),), "No stage has a specialization constant 9"),
        ((("count", 0.5),), "'count' is int: it cannot be 0.5"),
        ((("mask", -1),), "'mask' is uint: it cannot be -1"),
    ):
        described = written(tmp_path, DRAWN_VERTEX, DRAWN_FRAGMENT, specialization=special)
        with pytest.raises(ShaderError, match=sentence):
            pipelines.get([described])
    assert len(pipelines) == 0


def test_an_array_has_the_length_that_its_constant_is_given(pipelines, tmp_path):
    fragment = """
    layout(constant_id = 0) const int many = 3;
    layout(set = 0, binding = 0) uniform sampler2D maps[many];
    layout(location = 0) out vec4 color;
    void main() { color = texture(maps[many - 1], vec2(0)); }
    """
    few, more = pipelines.get(
        [written(tmp_path, DRAWN_VERTEX, fragment, specialization=one) for one in ((), (("many", 6),))]
    )
    assert [built.sets[0].counts for built in (few, more)] == [(3,), (6,)]


def test_a_vertex_shader_that_wants_vertex_buffers_is_refused(pipelines, tmp_path):
    vertex = (
        "\nlayout(location = 3) in vec3 in_position;\nvoid main() { gl_Position = vec4(in_position, 1.0); }"
    )
    with pytest.raises(ShaderError) as caught:
        pipelines.get([written(tmp_path, vertex, DRAWN_FRAGMENT)])
    assert str(caught.value).startswith(f"{tmp_path / 'own.vert'}:2: 'in_position' at location 3 ")
    assert len(pipelines) == 0


def test_an_edited_shader_keeps_its_layout_and_its_sets(vulkan_device, tmp_path):
    cache = PipelineCache(vulkan_device)
    pipelines = Pipelines(vulkan_device, cache)
    try:
        _edit(pipelines, vulkan_device, tmp_path)
    finally:
        pipelines.close()
        cache.close()


def _edit(pipelines, vulkan_device, tmp_path):
    described = written(tmp_path, DRAWN_VERTEX, DRAWN_FRAGMENT)
    (built,) = pipelines.get([described])
    handle, before, sets = built.handle, built.layout, built.sets
    path = tmp_path / "own.frag"
    retired: list = []
    # The buffer goes: the layout keeps its place, or the set that is bound would no longer fit.
    path.write_text(
        DRAWN_FRAGMENT.replace("* tint", "").replace("layout(set = 1, binding = 2)", "//"), "utf-8"
    )
    log: list = []
    vulkan_device.fn.trace(log)
    names = pipelines.reload({path}, retired.append)
    vulkan_device.fn.trace(None)
    assert len(names) == 1 and built.handle != handle
    assert (built.layout, built.sets) == (before, sets)
    _, cache, _, infos, *_ = dict(log)["vkCreateGraphicsPipelines"]
    assert infos[0].layout == before
    assert cache == vk.NULL, "an edit that lives until the next one is not kept on disk"
    assert len(retired) == 1
    retired[0]()
    for wrong, sentence in (
        (
            DRAWN_FRAGMENT.replace("binding = 2", "binding = 3"),
            "set 1, binding 3 'tint': this uniform block is new",
        ),
        (DRAWN_FRAGMENT.replace("vec4 added", "vec4 added; vec4 more"), "push constants"),
        (DRAWN_FRAGMENT.replace("tint", "tint)"), "error"),
    ):
        path.write_text(wrong, "utf-8")
        handle = built.handle
        with pytest.raises(ShaderError, match=sentence):
            pipelines.reload({path}, retired.append)
        assert built.handle == handle and len(retired) == 1


def test_capacity_is_the_callers(vulkan_device):
    made = Pipelines(vulkan_device, capacity=77)
    assert (made.layouts.capacity, CAPACITY) == (77, 4096)
    made.close()
