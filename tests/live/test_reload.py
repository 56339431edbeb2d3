"""A shader that is saved while it runs: what is built anew, what stays, and what happens to a text that is wrong."""

from __future__ import annotations

import errno
import itertools
import os
import time
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import chapters
from backends.vulkan.shaders import compiler as compiler
from chapters.ch01.environment.model import files_at_start
from chapters.ch01.frames import stream
from common.errors import ShaderError
from common.files import shader_files
from common.scene import Image, Light, Material
from common.settings import replaced
from tests.live.conftest import PLAIN
from tests.support.chapter import Chapter
from tests.support.drivers import needs_line_marks
from tests.support.scenes import facing, quad_scene, texture
from tests.support.timing import least_time, once_more, timed
from tools.run.live import Live
from tools.window.opening import Opened

SUN = Light("directional", node=0, intensity=np.pi)
SIZE = (32, 32)
ALL = {"color", "instance_id"}
TINTS = {
    "shading/forward.frag": (
        "color += emissive * frame.exposure;",
        "color += emissive * frame.exposure + TINT;",
    ),
    "shading/instance_id.frag": ("out_id = push.draw.x + 1u;", "out_id = push.draw.x + 1u + ID;"),
    "post/tonemap.frag": (PLAIN, PLAIN + "\n    out_color.a -= ALPHA;"),
}
"""Edits that make three passes use a file of the test's own."""


def scene():
    return quad_scene(Material(metallic=0.0, roughness=1.0), lights=(SUN,))


class Session:
    """A renderer whose shaders are followed, with what was said about them."""

    def __init__(self, live, renderer, said):
        self.live, self.renderer, self.said = live, renderer, said
        live.follow(renderer)

    def picture(self, name="color"):
        return self.renderer.render(facing()).image(name)

    def handles(self):
        """Return what the driver has for each pipeline."""
        return {
            described.name: int(np.uint64(_number(built)))
            for described, built in self.renderer._pipelines._built.items()
        }

    def follow(self, looks=400):
        """Look until a change is taken over, or refused."""
        assert any(self.live.follow(self.renderer) for _ in range(looks)), "nothing was noticed"

    def quiet(self, looks=100):
        """Whether nothing is noticed for a while."""
        return not any(self.live.follow(self.renderer) for _ in range(looks))


def _number(built):
    if isinstance(built.handle, int):
        return built.handle
    from backends.vulkan import api as vk

    return int(vk.ffi.cast("uintptr_t", built.handle))


def ticking(step=0.02):
    """Return a clock that goes on when it is looked at, so that no test waits."""
    times = itertools.count()
    return lambda: next(times) * step


@contextmanager
def session(chapter: Chapter, outputs=("color",), timer=None, drawn=None, **more):
    said: list[str] = []
    with (
        Live(timer or ticking(), tell=said.append) as live,
        chapter.open(drawn or scene(), SIZE, outputs=outputs, **more) as renderer,
    ):
        yield Session(live, renderer, said)


def code(*color):
    """Return the 8-bit codes of a colour: of fifths, which lie on codes, so that drivers round them alike."""
    return np.round(np.array(color) * 255).astype(np.uint8)


@pytest.mark.alone
@pytest.mark.feature("tools/live-shaders")
def test_a_saved_shader_is_seen_within_a_second_and_nothing_else_changes(chapter, shaders):
    colors = itertools.cycle([(0.2, 0.4, 0.8), (0.4, 0.2, 0.8)])
    with session(chapter, ALL, time.monotonic) as run:
        took = []
        while once_more(took, 1.0):
            color = next(colors)
            run.said.clear()
            first = run.renderer.render(facing(), 0.25)
            before, handles, settings = first.image("color"), run.handles(), run.renderer.settings
            assert run.renderer.idle(facing(), 0.25)
            began = time.perf_counter()
            shaders.paint(*color)
            run.follow(looks=10**7)
            assert not run.renderer.idle(facing(), 0.25), "or a window would not draw it"
            frame = run.renderer.render(facing(), 0.25)
            assert (frame.image("color") == code(*color)).all()
            took.append(time.perf_counter() - began)
        assert min(took) < 1.0, took
        assert not (before == code(*color)).all(-1).any()
        assert [name for name, handle in run.handles().items() if handle != handles[name]] == ["tonemap"]
        assert frame.index == first.index + 1, "the frames are counted on: no history was reset"
        assert run.renderer.settings is settings
        assert (frame.image("instance_id") == first.image("instance_id")).all()
        (said,) = run.said
        assert "tonemap.frag: 1 pipeline built anew in" in said


def test_an_include_rebuilds_the_passes_that_use_it_and_no_other(chapter, shaders):
    shaders.save("own.glsl", "const vec3 TINT = vec3(0.0);\nconst uint ID = 0u;\nconst float ALPHA = 0.0;\n")
    for name, (old, new) in TINTS.items():
        shaders.edit(name, old, new)
        path = shaders.chapter / name
        path.write_text('#include "own.glsl"\n' + path.read_text("utf-8"), "utf-8")
    settings = chapters.settings_class(1)(msaa=4)
    with session(chapter, ALL, settings=settings) as run:
        ids = run.picture("instance_id")
        handles = run.handles()
        assert len(handles) == 4
        shaders.edit("own.glsl", "ID = 0u", "ID = 7u")
        run.follow()
        changed = {name for name, handle in run.handles().items() if handle != handles[name]}
        assert changed == set(handles) - {"resolve"}
        assert (run.picture("instance_id") == np.where(ids > 0, ids + 7, 0)).all()
        assert "own.glsl: 3 pipelines" in run.said[0]


def test_only_pipelines_whose_code_changes_are_built_anew(chapter, shaders):
    """On software drivers each takes up to a second: a comment must not cost one, nor another material's line."""
    material = Material(metallic=0.0, roughness=1.0, unlit=True)
    with session(chapter) as run, chapter.open(quad_scene(material), SIZE) as unlit:
        good, handles = run.picture(), run.handles()
        unlit.render(facing())
        shaders.edit(
            "shading/forward.frag", "layout(location = 0) out", "// Says nothing.\n\nlayout(location = 0) out"
        )
        run.follow()
        assert run.handles() == handles
        assert run.renderer.idle(facing(), 0.0), "nothing is to be drawn again"
        assert run.said == ["strata: forward.frag: the code of every pipeline is the same."]
        path = shaders.edit("shading/forward.frag", TINTS["shading/forward.frag"][0], "color += vec3(0.5);")
        run.follow()
        assert "1 pipeline built anew" in run.said[1]
        assert not (run.picture() == good).all()
        with shader_files.refreshed([path]):
            assert unlit.reload_shaders([path]).pipelines == (), "without light this line is left out"


@pytest.mark.feature("tools/live-shaders")
def test_a_broken_shader_leaves_the_last_good_picture_until_it_is_repaired(chapter, shaders):
    with session(chapter) as run:
        good, handles = run.picture(), run.handles()
        path = shaders.edit("post/tonemap.frag", "clamp(color, 0.0, 1.0)", "clamp(colour, 0.0, 1.0)")
        run.follow()
        assert (run.picture() == good).all()
        assert run.handles() == handles
        needs_line_marks(chapter.device)
        lines = path.read_text("utf-8").splitlines()
        number = next(i for i, line in enumerate(lines, 1) if "colour" in line)
        shown = run.live.error.splitlines()
        at = next(i for i, line in enumerate(shown) if line.startswith(f"{path}:{number}: "))
        assert shown[at + 1] == "    " + lines[number - 1]
        assert shown[at + 2].strip() == "^"
        if "colour" in shown[at]:
            assert shown[at + 2].index("^") == shown[at + 1].index("colour")
        assert run.live.error in run.said[0]
        assert run.quiet(), "an error is said once"
        shaders.edit("post/tonemap.frag", "clamp(colour, 0.0, 1.0)", "1.0 - clamp(color, 0.0, 1.0)")
        run.follow()
        assert run.live.error == ""
        assert not (run.picture() == good).all()
        assert len(run.said) == 2


def test_the_error_of_an_include_names_it_and_who_included_it(chapter, shaders):
    with session(chapter) as run:
        good = run.picture()
        shaders.edit("shading/material.glsl", "vec2 image_uv(Material", "vec2 image_uv(Matter")
        run.follow()
        assert f"{shaders.chapter / 'shading/material.glsl'}:" in run.live.error
        assert f"included from {shaders.chapter / 'shading/forward.frag'}:4" in run.live.error
        assert "vec2 image_uv(Matter" in run.live.error
        assert (run.picture() == good).all()


def test_all_pipelines_are_exchanged_or_none(chapter, shaders):
    """Two files are saved together, one of them is wrong: the other one waits for it."""
    with session(chapter) as run:
        good = run.picture()
        shaders.paint(1.0, 0.0, 0.0)
        shaders.edit("shading/forward.frag", "base.a = 1.0;", "base.a = one;")
        run.follow()
        assert (run.picture() == good).all()
        shaders.edit("shading/forward.frag", "base.a = one;", "base.a = 1.0;")
        run.follow()
        assert (run.picture() == code(1.0, 0.0, 0.0)).all()


def test_what_waits_is_tried_again_with_every_further_edit(chapter, shaders):
    with session(chapter) as run:
        good = run.picture()
        shaders.edit("shading/forward.frag", "base.a = 1.0;", "base.a = one;")
        run.follow()
        shaders.edit("post/tonemap.frag", PLAIN, "out_color = two;")
        run.follow()
        shaders.edit("post/tonemap.frag", "out_color = two;", "out_color = vec4(0.0, 0.0, 1.0, 1.0);")
        run.follow()
        assert "one" in run.live.error, "the file that was not touched is still wrong"
        assert (run.picture() == good).all()
        shaders.edit("shading/forward.frag", "base.a = one;", "base.a = 1.0;")
        run.follow()
        assert run.live.error == ""
        assert (run.picture() == code(0.0, 0.0, 1.0)).all()


def test_a_file_that_is_replaced_by_rename_is_a_saved_file(chapter, shaders):
    with session(chapter) as run:
        run.picture()
        text = (shaders.chapter / "post/tonemap.frag").read_text("utf-8")
        shaders.replace("post/tonemap.frag", text.replace(PLAIN, "out_color = vec4(0.0, 1.0, 0.0, 1.0);"))
        run.follow()
        assert (run.picture() == code(0.0, 1.0, 0.0)).all()
        assert run.quiet()


def test_a_file_that_is_included_before_it_exists_is_waited_for(chapter, shaders):
    with session(chapter) as run:
        good = run.picture()
        shaders.edit(
            "post/tonemap.frag", '#include "tone.glsl"', '#include "tone.glsl"\n#include "later.glsl"'
        )
        shaders.edit("post/tonemap.frag", PLAIN, "out_color = vec4(LATER, 1.0);")
        run.follow()
        assert "there is no file 'later.glsl'" in run.live.error
        assert (run.picture() == good).all()
        shaders.save("later.glsl", "const vec3 LATER = vec3(1.0, 0.0, 1.0);\n")
        run.follow()
        assert (run.picture() == code(1.0, 0.0, 1.0)).all()


def test_a_file_that_comes_before_another_of_its_name_is_found(chapter, shaders):
    """An include is looked for beside its includer first: one that appears there is a change too."""
    with session(chapter) as run:
        run.picture()
        text = (shaders.common / "srgb.glsl").read_text("utf-8")
        assert not (shaders.chapter / "srgb.glsl").exists()
        shaders.save(
            "srgb.glsl",
            text.replace("srgb_from_linear(", "wrong(")
            + "vec3 srgb_from_linear(vec3 c) { return vec3(0.0, 0.0, 1.0); }",
        )
        run.follow()
        assert (run.picture() == code(0.0, 0.0, 1.0)).all()


SPOILT = {
    "deleted": (lambda path: path.unlink(), "tonemap.frag cannot be read: No such file"),
    "a folder": (lambda path: (path.unlink(), path.mkdir()), "tonemap.frag cannot be read: Is a directory"),
    "nonsense": (
        lambda path: path.write_bytes(os.urandom(999) + b"\xff\xfe"),
        "tonemap.frag is not UTF-8 text",
    ),
    "zeros": (lambda path: path.write_bytes(b"void main() {}\0"), "it has a zero byte"),
    "empty": (lambda path: path.write_bytes(b""), "post/tonemap.frag"),
    "a story": (lambda path: path.write_text("Once upon a time\n" * 50), "tonemap.frag:1: "),
}


@pytest.mark.parametrize("how", SPOILT)
def test_a_shader_that_is_spoilt_while_it_runs_is_one_message_and_comes_back(chapter, shaders, how):
    spoil, sentence = SPOILT[how]
    with session(chapter) as run:
        good = run.picture()
        path = shaders.chapter / "post/tonemap.frag"
        text = path.read_text("utf-8")
        spoil(path)
        run.follow()
        if not chapter.device.capabilities.is_software:  # NVIDIA's compiler gives some errors no line
            sentence = sentence.partition(":")[0]
        assert sentence in run.live.error
        assert (run.picture() == good).all()
        with chapter.open(scene(), SIZE) as another:
            assert (another.render(facing()).image("color") == good).all(), "so can other settings be chosen"
        if path.is_dir():
            path.rmdir()
        path.write_text(text.replace(PLAIN, "out_color = vec4(1.0, 1.0, 0.0, 1.0);"), "utf-8")
        run.follow()
        assert run.live.error == ""
        assert (run.picture() == code(1.0, 1.0, 0.0)).all()
        assert len(run.said) == 2


def test_a_shader_that_may_not_be_read_any_more(chapter, shaders, monkeypatch):
    def read(path, *arguments, **options):
        if not path.stat().st_mode & 0o400:  # whom rights do not bind is told so all the same
            raise PermissionError(errno.EACCES, "Permission denied")
        return real(path, *arguments, **options)

    real = Path.read_text
    monkeypatch.setattr(Path, "read_text", read)
    with session(chapter) as run:
        good = run.picture()
        path = shaders.chapter / "post/tonemap.frag"
        path.chmod(0)
        run.follow()
        assert "cannot be read: Permission denied" in run.live.error
        assert (run.picture() == good).all()
        path.chmod(0o644)
        run.follow()
        assert run.live.error == ""


REFUSED = {
    # name of the file: (old, new, what is said)
    "a block grows": ("shading/material.glsl", "vec4 uv_rows[10];", "vec4 uv_rows[11];", "208"),
    "a field moves": (
        "scene/scene.glsl",
        '#include "frame_constants.glsl"',
        'vec4 first;\n#include "frame_constants.glsl"',
        "went from 1440 to 1456 bytes",
    ),
    "a field changes": ("scene/scene.glsl", "uvec4 draw;", "ivec4 draw;", "was a uvec4 and is a ivec4"),
    "a texture changes": (
        "post/tonemap.frag",
        "uniform sampler2D color",
        "uniform isampler2D color",
        "color_hdr",
    ),
    "a vertex input is new": (
        "shading/forward.vert",
        "invariant gl_Position;",
        "layout(location = 9) in vec4 more;\ninvariant gl_Position;",
        "vertex input 9 'more': this vec4 is new",
    ),
    "an output changes": (
        "shading/forward.frag",
        "out vec4 out_color;",
        "out ivec4 out_color;",
        "output 0 'out_color'",
    ),
}
USES = {
    "a texture changes": ("post/tonemap.frag", "texelFetch(", "vec4(texelFetch("),
    "a vertex input is new": (
        "shading/forward.vert",
        "out_position = world;",
        "out_position = world + more.xyz;",
    ),
}


@pytest.mark.feature("tools/live-shaders")
@pytest.mark.parametrize("how", REFUSED)
def test_another_layout_is_refused_until_it_is_taken_back(chapter, shaders, how):
    name, old, new, sentence = REFUSED[how]
    texts = {path: path.read_text("utf-8") for path in shaders.chapter.rglob("*.*")}
    with session(chapter) as run:
        good, handles = run.picture(), run.handles()
        shaders.edit(name, old, new)
        if how == "an output changes":
            text = (shaders.chapter / name).read_text("utf-8")
            for kind in ("base.rgb", "color"):
                text = text.replace(
                    f"vec4(finite_color({kind}), base.a)", f"ivec4(vec4(finite_color({kind}), base.a))"
                )
            shaders.save(name, text)
        elif how == "a texture changes":
            shaders.edit(
                name,
                "texelFetch(color_hdr, ivec2(gl_FragCoord.xy), 0).rgb",
                "vec3(texelFetch(color_hdr, ivec2(gl_FragCoord.xy), 0).rgb)",
            )
        elif how in USES:
            shaders.edit(*USES[how])
        run.follow()
        assert sentence in run.live.error
        assert name in run.live.error
        assert "start again" in run.live.error
        assert "\n" not in run.live.error
        assert run.handles() == handles
        assert (run.picture() == good).all()
        (shaders.chapter / name).write_text(texts[shaders.chapter / name], "utf-8")
        run.follow()
        assert run.live.error == ""
        assert (run.picture() == good).all()


def test_what_is_no_longer_used_may_be_used_again(chapter, shaders):
    """OpenGL forgets a texture that nobody reads; the host still binds it."""
    with session(chapter) as run:
        good = run.picture()
        text = (shaders.chapter / "post/tonemap.frag").read_text("utf-8")
        shaders.paint(1.0, 1.0, 1.0)
        shaders.edit("post/tonemap.frag", "layout(BIND(0, 0, 0)) uniform sampler2D color_hdr;", "")
        shaders.edit("post/tonemap.frag", "texelFetch(color_hdr, ivec2(gl_FragCoord.xy), 0).rgb", "vec3(1.0)")
        run.follow()
        assert (run.picture() == 255).all()
        shaders.save("post/tonemap.frag", text)
        run.follow()
        assert run.live.error == ""
        assert (run.picture() == good).all()


def test_a_texture_of_another_pass_is_refused_and_a_buffer_that_was_declared_is_not(chapter, shaders):
    """OpenGL has no sets: what another program reads at a place looks as if it were bound for this one."""
    grey = Image("grey", np.full((2, 2, 4), 128, np.uint8))
    textured = quad_scene(Material(base_color_texture=texture()), lights=(SUN,), images=(grey,))
    with session(chapter, ALL, drawn=textured) as run:
        good, ids = run.picture(), run.picture("instance_id")
        text = (shaders.chapter / "shading/instance_id.frag").read_text("utf-8")
        wanted = "layout(BIND(1, 0, 0)) uniform sampler2D base_color_map_;\nlayout(location = 0) out"
        shaders.edit("shading/instance_id.frag", "layout(location = 0) out", wanted)
        shaders.edit("shading/instance_id.frag", "+ 1u;", "+ 1u + uint(textureSize(base_color_map_, 0).x);")
        run.follow()
        assert "'base_color_map_': this sampler2D is new" in run.live.error
        assert (run.picture("instance_id") == ids).all()
        shaders.save(
            "shading/instance_id.frag", text.replace("+ 1u;", "+ 1u + uint(materials[0].base_color.a);")
        )
        run.follow()
        assert run.live.error == ""
        assert (run.picture("instance_id") == np.where(ids > 0, ids + 1, 0)).all()
        assert (run.picture() == good).all()


def test_a_fragment_shader_reads_what_a_vertex_shader_writes(chapter, shaders):
    with session(chapter) as run:
        good = run.picture()
        shaders.edit(
            "post/tonemap.frag", "in vec2 in_uv;", "in vec2 in_uv;\nlayout(location = 5) in vec3 more;"
        )
        shaders.edit("post/tonemap.frag", PLAIN, "out_color = vec4(more, 1.0);")
        run.follow()
        assert "more" in run.live.error
        assert (run.picture() == good).all()


@pytest.mark.feature("tools/live-shaders")
def test_a_hundred_reloads_leave_nothing_behind(chapter, shaders):
    path = shaders.chapter / "post/tonemap.frag"
    with session(chapter) as run:
        run.picture()

        def edits(numbers):
            for number in numbers:
                shaders.paint(number / 255, 0.0, 0.0)
                with shader_files.refreshed([path]):
                    assert len(run.renderer.reload_shaders([path]).pipelines) == 1
                if number % 10 == 0:  # between two frames a file may be saved several times
                    assert (run.picture() == (number, 0, 0)).all()

        edits(range(1, 41))
        objects, codes = dict(chapter.device.alive), len(compiler.shared()._memory)
        memory = _resident()
        edits(range(101, 201))
        assert len(chapter.device.alive) == len(objects)
        assert len(compiler.shared()._memory) == codes
        assert _resident() - memory < 8 << 20


def test_an_old_pipeline_lives_until_no_frame_in_flight_uses_it(chapter, shaders):
    if chapter.backend == "gl":
        return  # the driver keeps a deleted program as long as it is needed
    with session(chapter) as run:

        def alive():
            return sum(kind == "VkPipeline" for kind, _ in chapter.device.alive)

        run.renderer.render(facing())
        count = alive()
        path = shaders.paint(1.0, 0.0, 0.0)
        with shader_files.refreshed([path]):
            run.renderer.reload_shaders([path])
        counts = [alive()]
        for _ in range(3):
            run.renderer.render(facing())
            counts.append(alive())
        assert counts == [count + 1, count + 1, count, count], (
            "the frame before the edit has one that follows"
        )


def _resident() -> int:
    """Return the bytes of memory that this process has, 0 where nobody says."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except OSError:
        return 0
    return pages * os.sysconf("SC_PAGE_SIZE")


def test_a_reload_that_fails_leaves_nothing_behind(chapter, shaders):
    with session(chapter) as run:
        run.picture()
        path = shaders.edit("post/tonemap.frag", PLAIN, "out_color = nothing;")
        objects = dict(chapter.device.alive)
        for _ in range(3):
            with pytest.raises(ShaderError), shader_files.refreshed([path]):
                run.renderer.reload_shaders([path])
        shaders.edit("post/tonemap.frag", "out_color = nothing;", PLAIN)
        shaders.edit("shading/material.glsl", "vec4 uv_rows[10];", "vec4 uv_rows[11];")
        with pytest.raises(ShaderError), shader_files.refreshed([shaders.chapter / "shading/material.glsl"]):
            run.renderer.reload_shaders([shaders.chapter / "shading/material.glsl"])
        assert dict(chapter.device.alive) == objects


class Study:
    """A renderer that cannot exchange its shaders, as the small programs beside the chapters are."""

    def __init__(self, renderer):
        self._renderer, self.closed = renderer, False
        self.shader_files = frozenset()

    def __getattr__(self, name):
        return getattr(self._renderer, name)

    def close(self):
        self.closed = True
        self._renderer.close()


def test_a_renderer_that_cannot_exchange_shaders_is_opened_anew(chapter, shaders):
    opened: list[Study] = []

    def renew(**options):
        opened.append(Study(chapter.open(scene(), options.pop("size", SIZE), **options)))
        return opened[-1]

    said: list[str] = []
    with Live(ticking(), said.append) as live:
        window = Opened(renew, SIZE, {})
        live.renew = window.renew
        run = Session(live, window.renderer, said)
        good = run.picture()
        path = shaders.edit("post/tonemap.frag", PLAIN, "out_color = wrong;")
        run.follow()
        assert f"{path}:" in live.error
        assert live.renderer is run.renderer is window.renderer
        assert (run.picture() == good).all()
        shaders.paint(0.0, 1.0, 0.0)
        run.follow()
        assert live.renderer is window.renderer is opened[-1] is not run.renderer
        assert (live.renderer.render(facing()).image("color") == code(0.0, 1.0, 0.0)).all()
        assert [one.closed for one in opened] == [True, False]
        assert "tonemap.frag: all pipelines built anew" in said[-1]
        window.close()


def test_a_kernel_that_ran_at_the_start_is_named_and_changes_nothing(chapter, shaders, monkeypatch):
    kernels = frozenset({shaders.chapter / "environment/cube.comp"})
    monkeypatch.setattr(stream, "files_at_start", lambda scene, settings: kernels)
    with session(chapter) as run:
        good, handles = run.picture(), run.handles()
        text = (shaders.chapter / "environment/cube.comp").read_text("utf-8")
        shaders.save("environment/cube.comp", text + "// more\n")
        run.follow()
        assert (run.picture() == good).all()
        assert run.handles() == handles
        (said,) = run.said
        assert "environment/cube.comp runs when a scene is opened: start again to see the edit there." in said


def test_kernels_run_at_the_start_where_there_is_an_environment():
    settings = chapters.settings_class(1)()
    assert files_at_start(scene(), settings) == frozenset()
    around = replace(scene(), environment=SimpleNamespace())
    names = {path.name for path in files_at_start(around, settings)}
    assert {"cube.comp", "table.comp", "ggx_sampling.glsl"} <= names
    assert files_at_start(around, replaced(settings, environment_intensity=0.0)) == frozenset()


def test_files_that_nobody_uses_are_nobodys_business(chapter, shaders):
    with session(chapter) as run:
        run.picture()
        assert run.renderer.reload_shaders([shaders.chapter / "shading/sky.frag"]).pipelines == ()
        assert run.renderer.idle(facing())
        used = {path.name for path in run.renderer.shader_files if path.is_file()}
        assert {"forward.vert", "forward.frag", "tonemap.frag", "scene.glsl", "brdf.glsl"} <= used
        assert not {"sky.frag", "resolve.frag", "ibl.glsl", "cube.comp"} & used


@pytest.mark.alone
def test_a_look_at_the_files_is_cheap(chapter, shaders):
    with session(chapter) as run:
        run.picture()

        def look():
            run.live._due = 0.0
            run.live.follow(run.renderer)

        least = least_time(timed(look, calls=20), 1e-3)
        assert least < 1e-3  # 0.1 ms where nothing else runs
        print(f"{least * 1e3:.3f} ms a look")
