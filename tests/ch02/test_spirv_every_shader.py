"""The SPIR-V parser against `spirv-dis`: every shader of the project, in the variants that its own conditions allow.

Of a shader that several chapters have, the newest text stands for all; with --long every chapter's is compiled.
"""

from __future__ import annotations

import math
import re
import typing

import pytest

from backends import shader_text
from backends.shader_text import STAGES
from backends.vulkan.shaders.compiler import shared
from chapters.ch02.pipelines.spirv import parser
from chapters.ch02.pipelines.spirv.declared import Kind
from chapters.ch02.pipelines.spirv.words import instructions, words_of
from common.errors import ShaderError
from common.layouts import SNIPPETS
from common.paths import ROOT
from tests.backends.test_glslang import SHADERS as STAGE_SHADERS
from tests.ch02.test_spirv import KINDS, KINDS_EXTENSIONS, RULES, SPECIAL
from tests.ch02.test_spirv import compiled as compiled_text
from tests.support.disassembly import disassembled
from tests.support.once import once

# What the host defines where a shader counts on it, with a value that compiles.
GIVEN = {
    "FORMAT": "rgba16f",
    "SAMPLES": 4,
    "COUNT_FULL": 8,
    "ENERGY": 1,
    "PULLED": 1,
    "SHOWS": 0,
    "ARRAYS": 3,
    "TEXTURES": 6,
    "VOLUMES": 2,
    "SIDE": 4,
    "CELL": 8,
    "ACROSS": 4,
    "DOWN": 4,
    "TAPS": 8,
    "LARGEST_RADIUS": 0.05,
    "F_NUMBER": 2.0,
    "FOCUS_DISTANCE": 3.0,
    "SENSOR_HEIGHT": 0.024,
    "BACKGROUND": 0.02,
    "GROUP": 64,
    "COUNT": 65,
    "TOP": 1000,
    "LOCAL_X": 8,
    "LOCAL_Y": 8,
    "REPEAT": 2,
    "CELLS": 8,
    "THREADS": 64,
    "RESET": "1u",
    "WRITE": "2u",
    "NOWHERE": 0xFFFFFFFF,
}
# The same from chapter 6 on; earlier chapters have other things of these names.
GIVEN_FROM_6 = {
    "CULLING": 3,
    "PHASE": 1,
    "LEVELS": 1,
    "MOST_TASKS": 64,
    "SEGMENTS": 16,
    "SHAPE": 0,
    "MAX_VERTICES": 64,
    "MAX_TRIANGLES": 124,
    "AT_ONCE": 64,
    "COLORS": 1,
    "WAY": 0,
    "SHOW": 0,
    "OPACITY": 1.0,
}
GIVEN_FROM_7 = {
    "LIST_HEADER": 16,
    "LIST_BOUND": 8,
    "LIST_BINS": 512,
    "LIST_STEPS_LOG2": 6,
    "LIST_GROUP": 64,
    "LIT_BINDING": 6,
    "RADIUS": 0.03,
    "OCCLUSION_SCALE": 1.0,
    "OCCLUSION_BIAS": 0.2,
    "TOLERANCE": 0.003,
    "BINS": 256,
    "BIN_WIDTH": 0.140625,
    "LOG2_LOWEST": -16.0,
    "LOG2_LEAST": -16.0,
    "LOG2_MOST": 16.0,
    "LOW": 0.5,
    "HIGH": 0.95,
    "KEY": 0.18,
    "SIDE": 64,
    "MIP_FLOATS": 5461,
    "MODE_MIPS": 0,
    "ADAPT_DARK_S": 1.2,
    "ADAPT_BRIGHT_S": 0.3,
    "ADAPT_SPEED": 0.1,
    "SKIP_EMPTY": 1,
    "THRESHOLD": 1.0,
    "STRENGTH": 0.3,
    "LEVEL": 0,
    "WHITE": 4.0,
    "SHORT": 16,
    "RUN": 16,
    "POOL_SET": 3,
    "STEPS": 64,
    "REFINEMENTS": 5,
    "THICKNESS": 0.1,
    "ROUGHEST": 0.6,
    "BLUR": 10.0,
    "EDGE": 0.1,
    "BACK": "0x80000000u",
    "UNLIT_FLAG": "1u",
    "DOUBLE_SIDED_FLAG": "2u",
    "COLOR_FORMAT": "rgba8",
    "NORMAL_FORMAT": "rgba16f",
    "MATERIAL_FORMAT": "rgba8",
    "EMISSION_FORMAT": "rgba16f",
}
GIVEN_FROM_8 = {
    "MOST_TEXELS": 8192.0,
    "NEEDS_BINDING": 1,
    "SHADOW_BIAS": 0,
    "SHADOW_BLENDED": 4,
    "SHADOW_COARSE": 6,
    "SHADOW_FACES": 8,
    "SHADOW_SOFT": 1,
    "SHADOW_LIGHTS": 8,
    "SHADOW_MOVING": 4,
}
GIVEN_FROM_9 = {
    "COARSE": "5u",
    "COARSE_SIDE": 2,
    "RATE": "5u",
    "RATE_AREA": 16,
    "RATE_FORMAT": "r32ui",
    "RATE_TEXEL": 16,
    "SURFACE": 0.1,
    "TILE": 16,
}
GIVEN_FROM_10 = {"FOG_BOXES": 16, "FORMAT": "rgba16f", "RESULT_BINDING": 2}
GIVEN_FROM_11 = {
    "AMOUNT": 1.0,
    "CONTRAST": 0.125,
    "LEAST_CONTRAST": 0.04,
    "DETAIL": 0.75,
    "SHUTTER": 1.0,
    "LONGEST": 64.0,
    "RAW": 2,
    "SPLIT_AT": 0.5,
}
GIVEN_FROM_12 = {
    "RAYS_SET": 4,
    "RAYS_BINDING": 0,
    "BVH_LEAF": "2147483648u",
    "BVH_COUNT_SHIFT": "29u",
    "BVH_NO_CHILD": "4294967295u",
    "BVH_NON_OPAQUE": "1u",
    "BVH_TWO_SIDED": "2u",
    "BVH_STACK": 32,
    "BVH_NODES_AT": "BIND(3, 0, 5)",
    "BVH_TRIANGLES_AT": "BIND(3, 1, 6)",
    "BVH_INSTANCES_AT": "BIND(3, 2, 7)",
    "BOUNCES": 2,
    "MIRROR": 0.2,
    "CASTING_SIDES": "0u",
    "SHADOW_NEAR": 0.001,
    "RAY_VIEW": 0,
    "MASKED_FLAG": 128,
    "BLENDED_FLAG": 256,
    "TARGET_BINDING": 3,
    "PATH_BINDING": 3,
}
RAY_STAGES = (".rgen", ".rchit", ".rahit", ".rmiss", ".rint", ".rcall")
GIVEN_IN: dict[str, dict[str, int | float | str | None]] = {
    "ssao": {"STEP": "ivec2(1, 0)"},
    "rates": {
        "RADIUS": None,
        "EDGE_TILE": 32,
        "WHOLE": 9,
        "LAST": 10,
        "KEPT": 11,
    },  # a radius is a condition here
    "shading_rates": {"COLUMNS": 8, "ROWS": 6, "BY_PRIMITIVE": 1},
    "bvh": {
        "BVH_LEAF": "2147483648u",
        "BVH_COUNT_SHIFT": "29u",
        "BVH_NO_CHILD": "4294967295u",
        "BVH_NON_OPAQUE": "1u",
        "BVH_TWO_SIDED": "2u",
        "BVH_UNUSABLE": "1u",
        "BVH_STACK": 76,
    },
    "transparency": {"STEP": 1},
    "separable_bloom": {"TAPS": ", ".join(["1.0"] * 11), "AXIS": 0},
    "linear_depth": {"CARDS": 7, "NEAREST": 1.5, "FLOOR": 1.0, "STANDARD": 0},
    "bias_explorer": {
        "SIDE": 16,
        "MARGIN": 4,
        "HEIGHT": 4.0,
        "MIDDLE": 512.37,
        "SAMPLES": 64,
        "RADIUS": 1,
        "TILTS": 18,
        "BIASES": 5,
    },
    "sparse_texture": {"SPARSE": 1, "TILE": 128, "ACROSS": 8},
    "sparse_buffer": {"WORDS": 16384, "PLACES": 64},
    "fog": {"FOG": 1, "NOISE_SIZE": 64, "RADIUS": None},  # a radius is a constant here
    "taa": {"KERNEL_RADIUS": 1.25, "WEIGHT_BEFORE": 2.0, "IMAGE": 1},
    "blue_noise": {"SIZE": 128, "WAYS": 3, "KINDS": 6, "NOISES": 3, "IMAGES": 9},
    "rays": {"ROLE_ARRAYS": "uint[5](0u, 0u, 0u, 0u, 0u)"},
    "hdr_swapchain": {
        "ENCODING": 0,
        "HDR10": 0,
        "SCRGB": 1,
        "STRIPS": 5,
        "STOPS": 8,
        "PAPER_WHITE": 203.0,
        "KNEE": 500.0,
        "PEAK": 1000.0,
        "REC_2020_FROM_709": "1.0",
        "REC_709_FROM_2020": "1.0",
    },
    "phase_functions": {"OCTAVES": 32, "NODES": 16, "POINTS": 512, "LOBES": 8},
    "any_hit_alpha": {"TEXELS": 64},
    "wavefront": {"WAVE_PATHS": "1024u", "TOLD_ROUNDS": "16u"},
}
"""The same in folders of chapters 7 to 11, whose things of these names are others; None where it is not given."""
VIEWS = 13
OWN = ("GL_", "INCLUDED_", "VIEW_OF")  # macros that are not the host's


def files():
    """Return every shader file of the project that is a stage."""
    suffixes = tuple(f".{stage}" for stage in STAGES)
    folders = [ROOT / "shaders", *sorted((ROOT / "chapters").glob("ch*"))]
    return [path for folder in folders for path in sorted(folder.rglob("*")) if path.name.endswith(suffixes)]


def built(path, defines):
    """Return a shader with the extension that some of them need; it changes nothing where nobody uses it."""
    own = path.relative_to(ROOT).parts
    later = [
        (GIVEN_FROM_6, "ch06"),
        (GIVEN_FROM_7, "ch07"),
        (GIVEN_FROM_8, "ch08"),
        (GIVEN_FROM_9, "ch09"),
        (GIVEN_FROM_10, "ch10"),
        (GIVEN_FROM_11, "ch11"),
        (GIVEN_FROM_12, "ch12"),
        *((it, "ch07") for folder, it in GIVEN_IN.items() if folder in own),
    ]
    host: dict[str, int | float | str | None] = {}
    for more, first in later:
        host |= more if own[0] == "chapters" and own[1] >= first else {}
    given = {name: value for name, value in host.items() if value is not None}
    given |= {name: value for name, value in defines.items() if own[-2] not in GIVEN_IN or name not in given}
    own_text = path.read_text("utf-8")
    needs = ["GL_EXT_mesh_shader"] if path.suffix in (".task", ".mesh") else []
    if path.suffix in RAY_STAGES:
        needs = ["GL_EXT_ray_tracing"]
    elif "RAYS_QUERY" in defines:
        needs = ["GL_EXT_ray_query"]
    return shader_text.build(
        path,
        "vulkan",
        roots=[ROOT.joinpath(*own[:2])] if own[0] == "chapters" else (),
        defines={name: value for name, value in given.items() if f"#define {name} " not in own_text},
        snippets=SNIPPETS,
        extensions=["GL_EXT_nonuniform_qualifier", *needs],
    )


def conditions(path):
    """Return the names that conditions of a shader ask about, and its text where all of them hold."""
    names: list[str] = []
    while True:  # a condition may decide about an include that has further ones
        text = built(path, GIVEN | dict.fromkeys(names, 1)).text
        found = re.findall(r"#\s*(?:ifdef|ifndef)\s+(\w+)|defined\((\w+)\)", text)
        now = [name for pair in found for name in pair if name and not name.startswith(OWN)]
        if not set(now) - set(names):
            return names, text
        names = list(dict.fromkeys([*names, *now]))


def variants(names, long):
    """Yield the definitions of each variant: nothing, all, each condition alone, every view; with `long` all but each.

    Of the last ones two thirds do not compile, and the others add a third to the modules.
    """
    everything = dict.fromkeys(names, 1)
    yield GIVEN
    yield GIVEN | everything
    for name in names:
        yield GIVEN | {name: 1}
        if long:
            yield GIVEN | {other: 1 for other in names if other != name}
    if "VIEW" in names:
        for view in range(VIEWS):
            yield GIVEN | everything | {"VIEW": view}


def bare(text):
    """Return a text without marks of lines, and without macros in front of it that it does not name.

    Most shaders are the same in several chapters, but for their paths and what other shaders of a chapter are given.
    """
    head, _, body = text.partition("#line 1 1\n")
    named = {*re.findall(r"\w+", body)}
    kept = [line for line in head.splitlines() if not line.startswith("#define ") or line.split()[1] in named]
    return "\n".join(kept) + re.sub(r"#line.*", "", body)


def modules_of(path, names, known, long):
    """Return the distinct modules of a file; a variant that no program asks for may not compile.

    `known` are texts of any file, with their module; None for one that does not compile.
    """
    codes = {}
    for defines in variants(names, long):
        source = built(path, defines)
        key = source.stage, bare(source.text)
        if key not in known:
            try:
                known[key] = shared().compile(source)
            except ShaderError:
                known[key] = None
        codes[known[key]] = None
    return [code for code in codes if code is not None]


def compiled(request, part):
    """Return what the parts up to this one of three hold. With none compiled, all take longer than one test may."""
    before = compiled(request, part - 1) if part else ({}, {}, set())
    long = request.config.getoption("--long")
    return once(request.config, f"shaders of part {part}", lambda: compile_part(part, before, long))


@pytest.fixture(scope="module")
def modules(request):
    """Every distinct module, with its disassembly and where it came from: for whichever chapter's parser, the same."""
    return once(request.config, "modules of every shader", lambda: every_module(compiled(request, 2)))


def newest(paths):
    """Return the files without those that a later chapter has too: most differ in what they include alone."""
    last = {}
    for path in paths:
        own = path.relative_to(ROOT).parts
        last[own[2:] if own[0] == "chapters" else own] = path
    return [*last.values()]


def compile_part(first, made, long):
    """Add the modules of every third file to what is made: where each came from, texts, and texts of files."""
    found, known, texts = made
    for path in (files() if long else newest(files()))[first::3]:
        names, text = conditions(path)
        text = path.suffix, bare(text)
        if text in texts:
            continue
        texts.add(text)
        codes = modules_of(path, names, known, long)
        assert codes, f"{path} compiles in no variant"
        for code in codes:
            found.setdefault(code, path.relative_to(ROOT).as_posix())
    return made


def every_module(made):
    found = dict(made[0])
    for stage, (extensions, text) in STAGE_SHADERS.items():
        source = shader_text.build_text(text, stage, "vulkan", extensions=extensions)
        found.setdefault(shared().compile(source), f"a .{stage} shader")
    rules = [RULES.replace("LAYOUT_KIND", "buffer").replace("LAYOUT", rule) for rule in ("std430", "scalar")]
    for text in (KINDS, SPECIAL, *rules):
        found.setdefault(compiled_text(text, extensions=KINDS_EXTENSIONS), "a text of the tests")
    return list(zip(found, found.values(), disassembled(list(found)), strict=True))


@pytest.mark.feature("reflection/spirv-parser")
@pytest.mark.parametrize("part", [0, 1, 2])
def test_every_third_file_compiles_in_a_variant(request, part):
    assert len(compiled(request, part)[0]) > 60 * (part + 1)


@pytest.mark.feature("reflection/spirv-parser")
def test_there_are_many_and_of_every_stage(modules):
    assert len(modules) > 100
    assert {stage for _, _, text in modules for stage, _, _ in text.entries()} == set(STAGES)


@pytest.mark.feature("reflection/spirv-parser")
def test_every_instruction_begins_at_its_word_and_has_its_opcode(modules):
    opcodes: dict[str, int] = {}
    for code, where, text in modules:
        found = list(instructions(words_of(code)))
        assert [4 * at for at, _, _ in found] == [offset for offset, *_ in text.instructions], where
        for (_, opcode, operands), (_, name, result, words) in zip(found, text.instructions, strict=True):
            assert opcodes.setdefault(name, opcode) == opcode, f"{where}: {name}"
            if result:
                assert int(result) in operands[:2], f"{where}: {name}"
            ids = [int(word[1:]) for word in words if re.fullmatch(r"%\d+", word)]
            left = list(operands)
            for id_ in ids:
                left.remove(id_)  # raises where the id is not among the operands
    assert len(set(opcodes.values())) == len(opcodes), "two instructions have one opcode"
    assert {name: opcodes[name] for name in ("OpSetMeshOutputsEXT", "OpTypeAccelerationStructureKHR")} == {
        "OpSetMeshOutputsEXT": 5295,
        "OpTypeAccelerationStructureKHR": 5341,
    }


@pytest.mark.feature("reflection/spirv-parser")
def test_declarations_are_what_the_disassembly_says(modules):
    def table(members):
        return tuple(
            (m.name, m.type, m.offset, m.counts, m.strides, m.matrix_stride, m.row_major, table(m.members))
            for m in members
        )

    seen = set()
    for code, where, text in modules:
        module = parser.parse(code)
        assert (module.version, module.bound) == (text.version, text.bound), where
        assert [(one.stage, one.name, one.local_size) for one in module.entries] == text.entries(), where
        resources = [
            (
                one.set,
                one.binding,
                one.kind,
                one.count,
                one.name,
                table(one.block.members) if one.block else (),
            )
            for one in module.resources
        ]
        assert sorted(resources) == sorted(text.resources()), where
        assert (table(module.push.members) if module.push else None) == text.push(), where
        constants = [(one.id, one.name, float(one.default)) for one in module.constants]
        for ours, theirs in zip(constants, text.constants(), strict=True):
            assert ours[:2] == theirs[:2] and math.isclose(ours[2], theirs[2], rel_tol=1e-8), where
        seen |= {one.kind for one in module.resources}
    assert seen == {*typing.get_args(Kind)} - {"dynamic uniform", "dynamic storage", "input attachment"}
