"""Pictures and tables that show themselves, in each place that shows them: what they hold, and what they say."""

from __future__ import annotations

import gc
import io
import json
import subprocess
import sys
import tempfile
import weakref
from base64 import b64decode
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import chapters
from chapters.ch01.settings import Settings
from common.errors import StaleFrameError, UserError
from common.images import read_image
from common.scene import Light, Material
from tests.support import notebooks
from tests.support.scenes import facing, quad_scene
from tools.compare import sheet
from tools.run import shown
from tools.run.shown import Figures, Picture, Table, compared, figures

SIZE = (12, 8)
EVERYTHING = ("color", "color_linear", "depth", "instance_id")


def opened(device, backend="vulkan", which=1, **more):
    scene = quad_scene(Material(base_color=(0.8, 0.4, 0.1, 1.0)), lights=(Light("directional", node=0),))
    return chapters.open(which, backend, scene=scene, size=SIZE, device=device, **more)


def decoded(code: str) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(b64decode(code))))


@pytest.fixture
def gray() -> Picture:
    return Picture(np.full((4, 6, 3), 120, np.uint8), "a <grey> & quiet picture", "gray")


@pytest.fixture
def temporary(tmp_path, monkeypatch) -> Path:
    """The folder for temporary files, empty."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


# --- a frame ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", chapters.available())
def test_a_frame_shows_what_its_image_holds(number, either_device):
    with opened(either_device, either_device.capabilities.backend, number) as renderer:
        frame = renderer.render(facing())
        picture, image = frame.picture(), frame.image("color")
        bundle = frame._repr_mimebundle_()
        assert frame.timings and all(f">{name}, GPU ms<" in bundle["text/html"] for name in frame.timings)
    assert np.array_equal(picture.pixels, image) and len(np.unique(image)) > 1
    assert np.array_equal(decoded(bundle["image/png"]), image)
    assert f"Chapter {number}, " in picture.caption and "12x8" in picture.caption
    assert picture.name == f"ch{number:02d}-color"


def test_light_is_shown_as_the_screen_would(vulkan_device):
    """Without a tone curve the shader's codes are those of clipped light at the view's exposure."""
    settings = Settings(tone_curve="none", color_format="rgba32f")
    with opened(vulkan_device, settings=settings, outputs=EVERYTHING) as renderer:
        frame = renderer.render(replace(facing(), ev100=1.5))
        shown_light = frame.picture("color_linear").pixels.astype(int)
        assert np.abs(shown_light - frame.image("color")).max() <= 1
        assert shown_light.max() > 20


def test_depth_and_ids_say_what_their_colours_mean(vulkan_device):
    with opened(vulkan_device, outputs=EVERYTHING) as renderer:
        view = facing()
        frame = renderer.render(view)
        depth, ids = frame.picture("depth"), frame.picture("instance_id")
    assert "distance from white at" in depth.caption and "depth" in depth.caption
    assert "a hue for each id; 1 of them" in ids.caption
    assert depth.name == "ch01-depth"


def test_without_color_the_first_output_is_shown(vulkan_device):
    with opened(vulkan_device, outputs=("depth",)) as renderer:
        frame = renderer.render(facing())
        assert np.array_equal(frame.picture().pixels, frame.picture("depth").pixels)
        with pytest.raises(StaleFrameError, match="is not among this renderer's outputs"):
            frame.show("color")


def test_what_a_pass_left_is_shown_by_its_declared_format(vulkan_device):
    with opened(vulkan_device, inspect=True) as renderer:
        frame = renderer.render(facing())
        assert "light at the frame's exposure" in frame.picture("forward/color_hdr").caption
        assert "distance from white" in frame.picture("forward/depth").caption
        assert frame.picture("forward/depth").name == "ch01-forward-depth"


def test_a_study_s_frame_shows_itself_too(vulkan_device):
    from common.scene.primitive import nothing

    with chapters.open(
        "1/first-triangle", "vulkan", scene=nothing("none"), size=SIZE, device=vulkan_device
    ) as study:
        frame = study.render(facing())
        assert np.array_equal(frame.picture().pixels, frame.image("color"))
        assert "Study 1/first-triangle" in repr(study) and study.table().rows


def test_a_frame_that_is_gone_says_so_and_keeps_its_figures(vulkan_device):
    with opened(vulkan_device) as renderer:
        frame = renderer.render(facing())
        picture = frame.picture()
        kept = picture.pixels.copy()
        for _ in range(2):
            renderer.render(facing())
        bundle = frame._repr_mimebundle_()
        assert "image/png" not in bundle and "Frame 0 is gone" in bundle["text/html"]
        assert "forward" in bundle["text/html"] and frame.work["draws"] == 2
        with pytest.raises(StaleFrameError):
            frame.show()
    assert np.array_equal(picture.pixels, kept)


def test_frames_that_nobody_holds_go(vulkan_device):
    with opened(vulkan_device) as renderer:
        inner = weakref.ref(renderer.render(facing())._frame)
        gc.collect()
        assert inner() is None


def test_a_renderer_is_of_its_chapter_and_says_what_draws(vulkan_device):
    from chapters.ch01.renderer import Renderer

    with opened(vulkan_device, settings=Settings(background=0.5)) as renderer:
        html = renderer._repr_mimebundle_()["text/html"]
        assert isinstance(renderer, Renderer) and repr(renderer).startswith("<renderer of Chapter 1, ")
    assert vulkan_device.capabilities.device in html
    assert "background=0.5" in html and "anisotropy=" not in html and "forward, tonemap" in html


# --- a picture --------------------------------------------------------------------------------------------------------


def test_its_png_has_its_bytes_and_says_that_they_are_srgb(tmp_path):
    pixels = np.random.default_rng(3).integers(0, 256, (9, 7, 3)).astype(np.uint8)
    bundle = Picture(pixels, "noise")._repr_mimebundle_()
    Picture(pixels).save(tmp_path / "a.png")
    for data in (b64decode(bundle["image/png"]), (tmp_path / "a.png").read_bytes()):
        found = Image.open(io.BytesIO(data))
        assert np.array_equal(np.asarray(found), pixels)
        assert found.info["srgb"] == 0
    assert bundle["image/png"] in bundle["text/html"]


def test_captions_are_text(gray):
    html = gray._repr_mimebundle_()["text/html"]
    assert html.count("a &lt;grey&gt; &amp; quiet picture") == 2  # for eyes, and for ears as alt


@pytest.mark.parametrize(
    ("array", "said"),
    [
        (np.zeros((4, 4, 3), np.float32), "float32 (4, 4, 3)"),
        (np.zeros((4, 4), np.uint8), "uint8 (4, 4)"),
        (np.zeros((0, 4, 3), np.uint8), "uint8 (0, 4, 3)"),
        ([1, 2], "list"),
    ],
)
def test_an_array_that_is_no_picture_is_refused(array, said):
    with pytest.raises(UserError) as caught:
        Picture(array)
    assert str(caught.value).startswith(f"{said} is no picture: ")


@pytest.mark.parametrize(("name", "said"), [("a.exr", "written as .png"), ("no/a.png", "there is no folder")])
def test_a_path_that_cannot_be_is_refused(name, said, gray, tmp_path):
    with pytest.raises(UserError, match=said):
        gray.save(tmp_path / name)


# --- where it is shown ------------------------------------------------------------------------------------------------


def test_in_a_notebook_it_is_displayed_and_no_file_is_written(gray, monkeypatch, temporary):
    displayed = notebooks.install(monkeypatch, notebooks.Kernel())
    gray.show()
    assert np.array_equal(decoded(displayed.bundles[0]["image/png"]), gray.pixels)
    assert not [*temporary.iterdir()]


@pytest.mark.parametrize("shell", [None, notebooks.TerminalInteractiveShell()])
def test_in_a_terminal_ipython_displays_nothing(shell, gray, monkeypatch, temporary):
    displayed = notebooks.install(monkeypatch, shell)
    monkeypatch.setattr(shown, "open_viewer", lambda path: True)
    gray.show()
    assert not displayed.bundles and len([*temporary.iterdir()]) == 1


@pytest.mark.parametrize("opens", [True, False])
def test_elsewhere_a_sentence_says_where_the_file_is(opens, gray, monkeypatch, temporary, capsys):
    monkeypatch.setattr(shown, "open_viewer", lambda path: opens)
    gray.show()
    gray.show()
    first, second = sorted(temporary.iterdir())
    said = capsys.readouterr().err
    assert np.array_equal(read_image(first), gray.pixels) and first.name.startswith("strata-gray-")
    assert str(first) in said and str(second) in said
    assert ('.save("picture.png")' in said) != opens and len(said.splitlines()) == 2


def test_a_folder_for_temporary_files_that_cannot_be_written_is_told(gray, monkeypatch, tmp_path):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "gone"))
    with pytest.raises(UserError, match="No picture can be written to the folder for temporary files"):
        gray.show()


class Launched:
    """A launcher of viewers: it ends with a code, or goes on."""

    def __init__(self, code: int | None) -> None:
        self.code = code
        self.command: list[str] = []

    def __call__(self, command, **options):
        self.command = command
        return self

    def wait(self, timeout):
        if self.code is None:
            raise subprocess.TimeoutExpired(self.command, timeout)
        return self.code


@pytest.mark.parametrize(("code", "opened_it"), [(0, True), (3, False), (None, True)])
@pytest.mark.parametrize(("platform", "program"), [("linux", "xdg-open"), ("darwin", "open")])
def test_the_system_s_viewer_gets_the_file(code, opened_it, platform, program, monkeypatch, tmp_path):
    launched = Launched(code)
    monkeypatch.setattr(sys, "platform", platform)
    monkeypatch.setattr(subprocess, "Popen", launched)
    monkeypatch.setattr(shown, "_viewers", [])
    monkeypatch.setenv("DISPLAY", ":0")
    assert shown.open_viewer(tmp_path / "a.png") is opened_it
    assert launched.command == [program, str(tmp_path / "a.png")]


@pytest.mark.parametrize("opens", [True, False])
def test_windows_opens_the_file_by_its_own_call(opens, monkeypatch, tmp_path):
    launched = []

    def startfile(path):
        launched.append(path)
        if not opens:
            raise OSError("no program is set for .png")

    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setattr(shown.os, "startfile", startfile, raising=False)
    monkeypatch.setattr(subprocess, "Popen", lambda *_, **__: pytest.fail("another viewer was launched"))
    assert shown.open_viewer(tmp_path / "a.png") is opens and launched == [tmp_path / "a.png"]


def test_without_a_display_or_a_viewer_none_is_opened(monkeypatch, tmp_path):
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(subprocess, "Popen", lambda *_, **__: pytest.fail("a viewer was launched"))
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert not shown.open_viewer(tmp_path / "a.png")

    def missing(*_, **__):
        raise FileNotFoundError("xdg-open")

    monkeypatch.setattr(subprocess, "Popen", missing)
    monkeypatch.setenv("WAYLAND_DISPLAY", "wayland-0")
    assert not shown.open_viewer(tmp_path / "a.png")


# --- tables -----------------------------------------------------------------------------------------------------------


def test_a_table_is_html_and_text():
    table = Table("A < B", ("pass", ">ms"), (("forward & sky", "1.500"), ("tonemap", "12.250")))
    assert str(table).splitlines() == [
        "A < B",
        "pass               ms",
        "forward & sky   1.500",
        "tonemap        12.250",
    ]
    html = table._repr_mimebundle_()["text/html"]
    assert "A &lt; B</caption>" in html and "forward &amp; sky" in html
    assert html.count('<td style="text-align: right">') == 2 and html.count('scope="col"') == 2


def test_figures_are_a_dict_that_shows_itself():
    work = Figures({"draws": 1234, "bytes_written": 0}, "Work", ("counter", "count"))
    assert work == {"draws": 1234, "bytes_written": 0} and json.loads(json.dumps(work)) == work
    html = work._repr_mimebundle_()["text/html"]
    assert "1,234" in html and "bytes written" not in html  # what is zero was not done
    times = Figures({"forward": 0.25, "sky": 0.0}, "Time", ("pass", "ms"))
    assert "0.250" in times.table().html() and "0.000" in times.table().html()


class Fixed:
    """A frame with these figures."""

    def __init__(self, timings, work):
        self.timings, self.work, self.cpu_ms = timings, work, 0.5


def test_figures_of_frames_are_in_the_order_of_the_frame_and_tell_what_differs():
    one = Fixed({"forward": 1.0, "tonemap": 0.5}, {"draws": 8, "samples": 1})
    four = Fixed({"forward": 2.0, "resolve": 0.25, "tonemap": 0.5}, {"draws": 8, "samples": 4, "binds": 2})
    table = figures({"1": one, "4": four})
    assert table.columns == ("", ">1", ">4")
    assert table.rows == (
        ("forward, GPU ms", "1.000", "2.000"),
        ("resolve, GPU ms", "-", "0.250"),
        ("tonemap, GPU ms", "0.500", "0.500"),
        ("all passes, GPU ms", "1.500", "2.750"),
        ("recording, CPU ms", "0.500", "0.500"),
        ("work: samples", "1", "4"),
        ("work: binds", "-", "2"),
    )
    alone = figures({"1": one})
    assert alone.rows[-2:] == (("work: draws", "8"), ("work: samples", "1"))


@pytest.mark.parametrize("given", [{}, [1, 2], None])
def test_figures_need_titles(given):
    with pytest.raises(UserError, match="Titles are missing"):
        figures(given)


# --- comparing --------------------------------------------------------------------------------------------------------


def panel(picture: Picture, index: int) -> np.ndarray:
    """Return picture `index` of a sheet of pictures of `SIZE`."""
    times, (x, y) = sheet.magnification(SIZE), sheet.origin(index, SIZE)
    return picture.pixels[y : y + SIZE[1] * times : times, x : x + SIZE[0] * times : times]


def test_compared_pictures_stand_beside_the_map_of_their_difference():
    a = np.random.default_rng(5).integers(0, 200, (SIZE[1], SIZE[0], 3)).astype(np.uint8)
    b = a.copy()
    b[2, 3] += 50
    made = compared({"before": Picture(a, "as it was"), "after": b})
    assert np.array_equal(panel(made, 0), a) and np.array_equal(panel(made, 1), b)
    heat = panel(made, 2).astype(int).sum(axis=-1)
    assert np.unravel_index(heat.argmax(), heat.shape) == (2, 3)
    assert f"{1 / 96:.3%} of the pixels changed" in made.caption
    assert "the same to the bit" in compared({"before": a, "after": a}).caption


def test_frames_are_compared_by_what_they_show(vulkan_device):
    with opened(vulkan_device) as renderer:
        frame = renderer.render(facing())
        made = compared({"one": frame, "same": frame.image("color")})
        assert np.array_equal(panel(made, 0), frame.image("color")) and "same to the bit" in made.caption


def test_what_cannot_be_compared_is_refused():
    a, wide = np.zeros((8, 12, 3), np.uint8), np.zeros((8, 13, 3), np.uint8)
    with pytest.raises(UserError, match="Two pictures are compared, not 1"):
        compared({"a": a})
    with pytest.raises(UserError, match="a is 12x8 and wide is 13x8: draw both in one size"):
        compared({"a": a, "wide": wide})
    with pytest.raises(UserError, match="Titles are missing"):
        compared([a, a])
