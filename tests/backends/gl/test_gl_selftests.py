"""Self-tests of OpenGL: each use has one, which is right here and sees a spoiled result, and the faults of old Mesa."""

from __future__ import annotations

import importlib
import importlib.util
import json
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from backends.features import FEATURES
from backends.gl.driver import capabilities as gc
from backends.gl.selftests import anisotropy_sampled, texturing_edges
from backends.gl.selftests.bench import NEAREST, Bench
from backends.selftest import data, verdicts
from backends.selftest import run as selftest
from common.errors import DeviceError, ShaderError
from common.paths import ROOT

USES = selftest.uses_of("gl", gc.OPTIONAL)

OLD_MESA = {"texturing/edges", "anisotropy/sampled", "pipeline-statistics/draw"}
"""What the llvmpipe of Mesa 22 gets wrong. It counts fragments by whole blocks of pixels."""


def module_of(use: str) -> str:
    return selftest.module_of("gl", use)


class Spoiled(Bench):
    """A bench whose results have one bit of a word turned over, as on a driver that is nearly right."""

    def read(self, buffer, dtype):
        words = super().read(buffer, np.uint32)
        if not (words == data.UNSET).all():  # what nothing was written to is left alone
            words[len(words) // 2 & ~1] ^= 1 << 23
        return words.view(dtype)

    def render(self, *arguments, **more):
        pixels = super().render(*arguments, **more)
        pixels[4, 4] ^= 1 << 14 | 1 << 30
        return pixels


class Slow(Bench):
    """A bench with a clock by which a draw takes 1 s, and the next anisotropic ones take `seconds`, in order."""

    def __init__(self, context, seconds):
        super().__init__(context)
        self.now, self.seconds, self.ratio_drawn = 0.0, list(seconds), 1.0

    def texture(self, format, size, levels, how, anisotropy=1.0):
        self.ratio_drawn = anisotropy
        return super().texture(format, size, levels, how, anisotropy)

    def render(self, *arguments, **more):
        self.now += self.seconds.pop(0) if self.ratio_drawn > 1.0 else 1.0
        return super().render(*arguments, **more)


def test_every_use_that_opengl_may_have_is_tried() -> None:
    assert {use.partition("/")[0] for use in USES} & FEATURES.keys() == gc.OPTIONAL.keys()
    missing = [use for use in USES if importlib.util.find_spec(module_of(use)) is None]
    assert not missing
    folder = ROOT / "backends" / "gl" / "selftests"
    names = {path.stem for path in folder.glob("*.py")} - {"__init__", "bench"}
    assert names == {module_of(use).rpartition(".")[2] for use in USES}


@pytest.mark.parametrize("use", USES)
def test_a_workload_is_right_and_sees_a_wrong_number(use: str, gl_context) -> None:
    feature = use.partition("/")[0]
    if feature in FEATURES and not gl_context.has(feature):
        pytest.skip(f"the device has no {feature}")
    run, alive = importlib.import_module(module_of(use)).run, dict(gl_context.alive)
    with Bench(gl_context) as bench:
        wrong = run(bench)
    with Spoiled(gl_context) as bench:
        spoiled = run(bench)
    said = gl_context.capabilities
    old = "llvmpipe" in said.device and "Mesa 22." in said.driver
    assert bool(wrong) == (old and use in OLD_MESA), wrong
    assert spoiled != ""
    assert gl_context.alive == alive


def test_the_child_tries_every_use_and_leaves_nothing_alive() -> None:
    """It ends with a traceback and code 1 where an object outlives its context."""
    command = [*selftest.CHILD, "gl", "0", *USES]
    done = subprocess.run(
        command, env=selftest.child_environment(), capture_output=True, timeout=120, check=False
    )
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    if lines[0]["verdict"] != selftest.OK:
        pytest.skip(f"no OpenGL: {lines[0]['verdict']}")
    assert done.returncode == 0, done.stderr.decode()
    assert [line["use"] for line in lines] == [selftest.OPENED, *USES]


def test_a_session_has_what_the_driver_says_whatever_verdicts_say(
    gl_context, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not gl_context.has("wireframe"):
        pytest.skip("the device has no wireframe, which is taken away here")
    monkeypatch.setenv("STRATA_VERDICTS", str(tmp_path))
    verdicts.write(gc.identity(gl_context.capabilities), {"wireframe": {"draw": "wrong: no lines"}})
    # In a process of its own: beside this context, NVIDIA's driver crashes when another one is made.
    code = """
from backends.gl.context import Context
from backends.gl.selftests.bench import Session
with Context() as context:
    assert not context.has("wireframe")
with Session(0) as session, session.bench() as bench:
    assert bench.context.has("wireframe")
    assert bench.context.validates
"""
    done = subprocess.run(
        [sys.executable, "-P", "-c", code], env=selftest.child_environment(), capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


def test_what_fails_halfway_is_freed(gl_context) -> None:
    alive = dict(gl_context.alive)

    def half() -> None:
        with Bench(gl_context) as bench:
            bench.texture("rgba8", (16, 16), data.gray_levels((0,) * 5), NEAREST)
            bench.dispatch("void main() { fault; }", [bench.output(4)])

    with pytest.raises(ShaderError, match="fault"):
        half()
    assert gl_context.alive == alive


def test_a_call_that_the_driver_refuses_is_no_wrong_result(gl_context) -> None:
    with Bench(gl_context) as bench:
        program = bench.graphics(data.FULL_SCREEN, data.MIPS_FRAGMENT)
        with pytest.raises(DeviceError, match="glDrawArrays"):
            bench.render(program, lambda: bench.fn.glDrawArrays(0xFFFF, 0, 3))
    gl_context.sink.messages.clear()  # that the driver objects is wanted


def test_resources_are_bound_by_kind_in_their_order(gl_context) -> None:
    source = """
        layout(local_size_x = 1) in;
        layout(BIND(0, 0, 0)) uniform sampler2D one;
        layout(BIND(0, 1, 0), std430) readonly buffer A { uint a[]; };
        layout(BIND(0, 2, 1)) uniform sampler2D two;
        layout(BIND(0, 3, 1), std430) writeonly buffer B { uint b[]; };
        void main() {
            b[0] = a[0];
            b[1] = uint(round(255.0 * texelFetch(one, ivec2(0), 0).r));
            b[2] = uint(round(255.0 * texelFetch(two, ivec2(0), 0).r));
        }
    """
    with Bench(gl_context) as bench:
        one, two = (bench.texture("r8", (1, 1), [np.full((1, 1), n, np.uint8)], NEAREST) for n in (5, 6))
        output = bench.output(4)
        bench.dispatch(source, [one, bench.input(np.array([7], np.uint32)), two, output])
        assert bench.read(output, np.uint32).tolist() == [7, 5, 6, data.UNSET]


def test_helpers_that_read_zeros_are_seen(gl_context, monkeypatch: pytest.MonkeyPatch) -> None:
    """As on the llvmpipe of Mesa 22: fragments beside a triangle have coordinates 0."""
    zeros = (
        "vec4 held = gl_HelperInvocation ? vec4(0.0) : transform[0];\n    vec2 at = uv * held.xy + held.zw;"
    )
    text = data.EDGES_FRAGMENT.replace("vec2 at = uv * transform[0].xy + transform[0].zw;", zeros)
    assert "gl_HelperInvocation" in text
    monkeypatch.setattr(data, "EDGES_FRAGMENT", text)
    with Bench(gl_context) as bench:
        assert "in place of 0: textures get seams" in texturing_edges.run(bench)


@pytest.mark.parametrize(
    ("seconds", "wrong"),
    [
        ([1.0], ""),
        ([48.0], ""),  # 16 times as much is read, and three times that is forgiven
        ([1000.0, 48.0], ""),  # another process had the machine
        ([1000.0, 49.0], "256 fragments along edges take 49.0 s, 49 times as long as without anisotropy"),
    ],
)
def test_anisotropic_edges_that_take_too_long_are_seen(
    seconds: list[float], wrong: str, gl_context, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not gl_context.has("anisotropy"):
        pytest.skip("the device has no anisotropy")
    with Slow(
        gl_context, [0.0, 0.0, *seconds]
    ) as bench:  # two pictures come first, of which no time is taken
        monkeypatch.setattr(data, "time", SimpleNamespace(perf_counter=lambda: bench.now))
        assert anisotropy_sampled.run(bench) == wrong
        assert not bench.seconds
