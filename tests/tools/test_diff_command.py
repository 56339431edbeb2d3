"""`strata diff`: its sides, the order of a lesson, the terminal, the page with its pictures, and every bad input."""

from __future__ import annotations

import base64
import io
import re
import shutil
from html.parser import HTMLParser

import numpy as np
import pytest
from PIL import Image
from rich.console import Console

import chapters
from chapters import scenes
from chapters.__main__ import run
from common.errors import UnsupportedError, UserError
from tests.tools.test_diff import RENDERER, SHADER, tree
from tools.diff import pictures, style, terminal
from tools.diff.files import Source, sources
from tools.diff.lesson import compare, pass_of
from tools.diff.page import highlighted, page
from tools.diff.pictures import Pictures
from tools.diff.sides import files_of, tree_of, twin

pytestmark = pytest.mark.feature("tools/diff")

LESSON = """from common.lessons import Lesson

raise SystemExit("nobody may run this")
LESSON = Lesson(number={number}, title="{title}", adds=tuple(computed), reading=("renderer.py", "passes/fog.py"))
"""
FOG = '"""The fog pass: <script>alert(1)</script> air & light."""\n\n\ndef blend(a):\n    return "[red]</code>"\n'
OLD = {
    "__init__.py": LESSON.format(number=8, title="Before"),
    "renderer.py": RENDERER,
    "logic/plumbing.py": "import a\n\nx = 1\n",
    "logic/knobs.py": "y = 1\n",
    "logic/same.py": "same = 1\n",
    "shading/forward.frag": SHADER,
}
NEW = {
    **OLD,
    "__init__.py": LESSON.format(number=9, title="Fog"),
    "renderer.py": RENDERER.replace("import time", "import fog\nimport time").replace(
        "self.forward(view)", "self.fog(view)  # \x1b[31m \u202e"
    ),
    "passes/fog.py": FOG,
    "logic/plumbing.py": "import b\n\nx = 1\n",
    "logic/knobs.py": "y = 2\n",
    "shading/forward.frag": SHADER.replace("vec3(0.0)", "vec3(0.5)"),
}


@pytest.fixture
def command(tmp_path, monkeypatch, capsys):
    """Run a command in an empty folder; return (exit code, stdout, stderr)."""
    monkeypatch.chdir(tmp_path)

    def made(*words) -> tuple[int, str, str]:
        code = run(["diff", *map(str, words)])
        printed = capsys.readouterr()
        return code, printed.out, printed.err

    return made


@pytest.fixture
def sides(tmp_path, monkeypatch):
    """Folders "old" and "new", each with a small chapter, in the current folder."""
    monkeypatch.chdir(tmp_path)
    tree(tmp_path / "old", OLD)
    tree(tmp_path / "new", NEW)
    return tree_of("old"), tree_of("new")


@pytest.fixture(scope="module")
def versions():
    """The frames and pipelines of chapter 1 on Vulkan beside those on OpenGL."""
    return compare(tree_of("1"), tree_of("1@gl"), ["frames", "pipelines"])


def printed(made, everything=False, width=100, stat=False, **more) -> str:
    """Return what the terminal shows."""
    to = Console(file=io.StringIO(), width=width, highlight=False, **more)
    terminal.show_stat(made, to) if stat else terminal.show(made, to, everything)
    return to.file.getvalue()


# --- sides ------------------------------------------------------------------------------------------------------------


def test_a_side_is_a_chapter_or_a_folder_whose_lesson_is_read_without_running_it(sides):
    old, new = sides
    assert (new.name, new.number, new.title) == ("new", 9, "Fog")
    assert new.reading == ("renderer.py", "passes/fog.py")
    for text in ("1", "01", "ch01", "CH01"):
        assert (tree_of(text).number, tree_of(text).name) == (1, "chapter 1")
    assert tree_of("1").reading == tuple(chapters.lesson(1).reading)
    assert tree_of("1@gl").name == "chapter 1 on OpenGL"
    assert tree_of("./old/").folder.resolve() == old.folder.resolve()
    assert (
        tree_of(str(old.folder.resolve())).name == "old"
    )  # a page says nothing of the machine it was made on


def test_of_a_broken_lesson_the_other_side_gives_the_order(sides, tmp_path):
    (tmp_path / "new" / "__init__.py").write_text("LESSON = Lesson(\n")
    side = tree_of("new")
    assert (side.number, side.reading) == (None, ())
    made = compare(tree_of("old"), side)
    assert made.tree.reading == tree_of("old").reading
    assert "cannot be parsed" in printed(made)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("99", "no chapter 99"),
        ("chapter", "no chapter or folder 'chapter': chapters are 1"),
        ("nwe", "did you mean 'new'?"),
        ("empty", "empty holds no chapter: there is no renderer.py"),
        ("file.txt", "file.txt is a file"),
        ("1@metal", "no backend 'metal'; known are 'gl', 'vulkan'"),
        ("old@gl", "no OpenGL version"),
        ("", "no chapter or folder ''"),
        ("no/such", "no chapter or folder 'no/such'"),
    ],
)
def test_what_is_no_side_is_said_in_a_sentence(sides, command, tmp_path, text, said):
    (tmp_path / "empty").mkdir()
    (tmp_path / "file.txt").write_text("x")
    for words in ((text, "1"), ("1", text)):
        code, out, err = command(*words)
        assert (code, out) == (2, "")
        assert said in err and len(err.strip().splitlines()) == 1


def test_each_file_of_opengl_stands_beside_its_twin_on_vulkan():
    vulkan, opengl = (files_of(tree_of(text), versions=True) for text in ("1@vulkan", "1@gl"))
    pairs = {key: opengl[key].path for key in vulkan.keys() & opengl.keys()}
    assert pairs["renderer.py"] == "gl_renderer.py"
    assert pairs["frames/vulkan_commands.py"] == "frames/gl_commands.py"
    assert pairs["frames/vulkan.py"] == "frames/gl.py"
    own = [path for path in (chapters.FOLDER / "ch01").rglob("gl*.py") if "studies" not in path.parts]
    drawn = {path.name for path in own}
    assert {path.split("/")[-1] for path in pairs.values()} | {
        path.split("/")[-1] for path in opengl.keys() - vulkan.keys()
    } == drawn
    made = compare(tree_of("1"), tree_of("1@gl"))
    assert made.versions and made.title == "Chapter 1 on Vulkan beside chapter 1 on OpenGL"
    assert all(file.old and file.new for file in made.ideas)
    assert not {file.path.split("/")[0] for file in made.tree.files} & {"shading", "post"}, (
        "both APIs share passes"
    )
    assert made.tree.moves == () and made.tree.of_status("renamed") == ()


def test_only_what_draws_on_vulkan_is_a_twin():
    known = [
        "settings.py",
        "frames/__init__.py",
        "frames/vulkan_commands.py",
        "frames/commands.py",
        "renderer.py",
    ]
    twins = {
        "frames/gl_commands.py": "frames/vulkan_commands.py",
        "gl_renderer.py": "renderer.py",
        "frames/gl_settings.py": "frames/gl_settings.py",
        "scene/gl.py": "scene/gl.py",
    }
    assert {path: twin(path, known) for path in twins} == twins


def test_one_api_alone_leaves_out_the_other(sides):
    opengl, vulkan = (files_of(tree_of(text), versions=False) for text in ("1@gl", "1@vulkan"))
    assert opengl and all(path.rpartition("/")[2].startswith("gl") for path in opengl)
    assert not any(path.rpartition("/")[2].startswith("gl") for path in vulkan)
    assert opengl.keys() | vulkan.keys() == sources(chapters.FOLDER / "ch01").keys()


# --- order ------------------------------------------------------------------------------------------------------------


def test_ideas_come_in_the_order_of_reading_and_plumbing_is_folded(sides):
    made = compare(*sides)
    assert [file.path for file in made.ideas] == ["renderer.py", "passes/fog.py"]
    assert [(why, [f.path for f in files]) for why, files in made.folded()] == [
        ("imports alone", ["logic/plumbing.py"]),
        ("not in the order of reading", ["__init__.py", "logic/knobs.py", "shading/forward.frag"]),
    ]
    assert made.title == "From old to new: Fog"
    assert made.totals() == "1 file new, 5 changed; +11 -5 lines of Python and GLSL."
    assert [pass_of(file) for file in made.ideas] == ["", "fog"]


def test_of_a_copy_of_the_same_chapter_all_but_imports_is_an_idea(sides, tmp_path):
    (tmp_path / "new" / "__init__.py").write_bytes((tmp_path / "old" / "__init__.py").read_bytes())
    made = compare(tree_of("old"), tree_of("new"))
    assert [file.path for file in made.plumbing] == ["logic/plumbing.py"]
    assert {file.path for file in made.ideas} >= {"logic/knobs.py", "renderer.py"}


def test_where_no_idea_changed_all_is_shown(sides):
    made = compare(*sides, ["logic"])
    assert [file.path for file in made.ideas] == ["logic/knobs.py", "logic/plumbing.py"]
    assert made.plumbing == ()


def test_only_leaves_out_the_rest_with_its_counts(sides, versions):
    made = compare(*sides, ["shading", "passes"])
    assert {file.path for file in made.tree.files} == {"passes/fog.py", "shading/forward.frag"}
    assert (made.tree.insertions, made.tree.deletions) == (6, 1)
    assert versions.ideas[0].path == "frames/vulkan.py"
    assert {file.path.split("/")[0] for file in versions.tree.files} == {"frames", "pipelines"}
    with pytest.raises(UserError, match="--only shadin: there is no such part; did you mean 'shading'"):
        compare(*sides, ["shadin"])


# --- terminal ---------------------------------------------------------------------------------------------------------


def test_the_terminal_shows_changed_functions_and_of_new_files_what_they_define(sides):
    shown = printed(compare(*sides))
    assert "\nrenderer.py  changed  +2 -1\nA frame, from top to bottom.\n" in shown
    assert "~ method Renderer.render  +1 -1" in shown
    assert "\n-         self.forward(view)\n+         self.fog(view)" in shown
    assert "+ function blend  2 lines" in shown and "return" not in shown.split("passes/fog.py")[1]
    assert "imports, folded: 1" in shown and "import fog" not in shown
    assert "Folded, not in the order of reading: 3, +3 -3; --all unfolds" in shown
    whole = printed(compare(*sides), everything=True)
    assert '+     return "[red]</code>"' in whole and "+ import fog" in whole and "+ y = 2" in whole
    assert "Folded" not in whole


def test_what_a_source_holds_cannot_act_on_the_terminal(sides):
    for shown in (printed(compare(*sides), everything=True), printed(compare(*sides), stat=True)):
        assert not re.search(r"[\x00-\x08\x0b-\x1f\x7f\u202e]", shown)
    assert "\\x1b[31m \\u202e" in printed(compare(*sides))


def test_colours_are_for_terminals_that_have_them(sides, monkeypatch):
    made = compare(*sides)
    assert "\x1b[32m+         self.fog" in printed(made, force_terminal=True, color_system="standard")
    monkeypatch.setenv("NO_COLOR", "1")
    assert "\x1b[32m" not in printed(made, force_terminal=True)


def test_versions_stand_side_by_side_where_there_is_room(versions):
    wide, narrow = printed(versions, width=160), printed(versions, width=100)
    row = re.search(r"^ +\d+ - +self\._device = device +\d+ \+ +self\._context = context", wide, re.M)
    assert row, wide[:3000]
    assert not row.re.search(narrow)
    assert (
        "-         self._device = device\n"
        "-         self.slots = [FrameSlot(device, index) for index in range(SLOTS)]\n"
        "+     def __init__(self, context: Context) -> None:\n"
        "+         self._context = context\n"
    ) in narrow
    assert max(len(line) for line in wide.splitlines()) <= 160


def test_the_table_has_each_file_that_differs_and_the_sum(sides):
    for width in (60, 120):
        shown = printed(compare(*sides), stat=True, width=width)
        assert [shown.index(name) for name in ("renderer.py", "passes/fog.py", "logic/knobs.py")] == sorted(
            shown.index(name) for name in ("renderer.py", "passes/fog.py", "logic/knobs.py")
        )
        assert "+11 -5 lines" in shown and "same.py" not in shown
        assert max(len(line) for line in shown.splitlines()) <= width


def test_identical_trees_are_a_sentence(command, sides):
    assert command("1", "1")[:2] == (0, "Nothing differs between chapter 1 and chapter 1.\n")
    assert command("1", "1", "--stat", "--only", "shading")[1].startswith(
        "Nothing differs in shading between chapter 1"
    )
    code, out, err = command("old", "old", "--html", "d.html")
    assert (code, out, err) == (0, "", "Nothing differs between old and old. Wrote d.html\n")


def test_moved_and_removed_code_is_said(sides, tmp_path):
    moved = "\n".join(f"value_{n} = compute_something({n})" for n in range(5)) + "\n"
    (tmp_path / "old" / "logic" / "knobs.py").write_text("y = 1\n" + moved)
    (tmp_path / "new" / "passes" / "fog.py").write_text(FOG + moved)
    (tmp_path / "new" / "logic" / "same.py").unlink()
    shown = printed(compare(tree_of("old"), tree_of("new")), everything=True)
    assert "Moved, not new: 5 lines at line 6 are from logic/knobs.py, line 2." in shown
    assert "Moved, not gone: 5 lines from line 2 are in passes/fog.py, line 6." in shown
    assert "logic/same.py  removed  +0 -1" in shown
    assert compare(tree_of("old"), tree_of("new"), ["shading"]).tree.moves == ()


# --- page -------------------------------------------------------------------------------------------------------------


class Reader(HTMLParser):
    """Holds that every element is closed, and collects attributes and the text of each element `code` of a line."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.code: list[str] = []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag == "code":
            self.code.append("")
        if tag not in ("meta", "img", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if "code" in self.open:
            self.code[-1] += data

    def all(self, name: str) -> list[str]:
        return [attrs[name] for _, attrs in self.tags if attrs.get(name) is not None]


def picture(value: int) -> bytes:
    held = io.BytesIO()
    Image.new("RGB", (4, 3), (value, 0, 0)).save(held, "PNG")
    return held.getvalue()


def test_a_page_is_whole_works_without_a_network_and_shows_sources_as_text(sides):
    text = page(compare(*sides), Pictures())
    read = Reader(text)
    assert not re.search(r"https?:|//cdn|@import|url\(", text)
    assert {tag for tag, _ in read.tags} & {"link", "iframe", "object"} == set()
    assert [tag for tag, _ in read.tags].count("script") == 1
    assert "alert(1)" in text and "<script>alert" not in text
    assert {*read.all("href")} <= {f"#{name}" for name in read.all("id")}
    assert len(read.all("id")) == len({*read.all("id")})
    lines = [*FOG.splitlines(), "        self.forward(view)", "        self.fog(view)  # \\x1b[31m \\u202e"]
    for line in lines:
        assert line in read.code, line


def test_every_hunk_can_be_focused_and_says_where_it_is(sides):
    read = Reader(page(compare(*sides), Pictures()))
    steps = [attrs for _, attrs in read.tags if "step" in (attrs.get("class") or "").split()]
    assert all(step["tabindex"] == "0" and step["role"] == "group" for step in steps)
    labels = [step["aria-label"] for step in steps]
    assert labels[:3] == [
        "renderer.py, part 1 of 1, in Renderer.render",
        "renderer.py, imports",
        "passes/fog.py, part 1 of 1",
    ]
    assert [tag for tag, _ in read.tags].count(
        "details"
    ) == 3  # imports of the renderer, and two kinds of plumbing


def test_pictures_of_a_pass_are_inside_the_page_once(sides):
    made = compare(*sides)
    shown = Pictures(
        {"fog": (None, picture(9)), "forward": (picture(1), picture(1))}, ("New has none here.",)
    )
    text = page(made, shown)
    images = Reader(text).all("src")
    assert len(images) == 3 and all(value.startswith("data:image/png;base64,") for value in images)
    assert base64.b64decode(images[0].partition(",")[2]) == picture(9)
    assert (
        "No picture of it by old." in text
        and "The pass forward, before and after; both are the same to the bit" in text
    )
    assert "New has none here." in text


def test_pictures_of_a_pass_with_several_files_stand_beside_the_first(sides, tmp_path):
    (tmp_path / "new" / "passes" / "gl_fog.py").write_text("x = 1\n")
    tree(tmp_path / "new" / "passes" / "more", {"fog.frag": "// Fog.\n"})
    (tmp_path / "new" / "passes" / "fog.frag").write_text("// Fog.\n")
    text = page(compare(tree_of("old"), tree_of("new")), Pictures({"fog": (None, picture(9))}))
    assert len(Reader(text).all("src")) == 1
    sections = text.split("<section")
    assert ["passes/fog.py" in one for one in sections if "<img" in one] == [True]


def test_a_page_of_versions_has_two_columns(versions):
    read = Reader(page(versions, Pictures()))
    kinds = read.all("class")
    assert kinds.count("pair both") > 5 and kinds.count("pair") > 5


@pytest.mark.parametrize("name", ["renderer.py", "shading/forward.frag", "README.md", "scene/packing.py"])
def test_colours_lose_no_character(name):
    source = Source(name, (chapters.FOLDER / "ch01" / name).read_bytes())
    made = highlighted(source)
    assert len(made) == len(source.lines)
    for html, line in zip(made, source.lines, strict=True):
        assert "".join(Reader(f"<code>{html}</code>").code) == line
    assert name.endswith(".md") or any("<span" in line for line in made)


@pytest.mark.parametrize(
    "text", ["\n\n\nx = 1\n\n\n", "", "\ufeffx = 1\n", "x = '\t\x0c'\n", "def f(:\n  '''", "x" * 99999]
)
def test_odd_sources_keep_their_lines(text):
    source = Source("a.py", text.encode())
    assert len(highlighted(source)) >= len(source.lines)


@pytest.mark.parametrize("colors", [style.LIGHT, style.DARK])
def test_all_text_can_be_read_on_its_ground(colors):
    """The contrast of WCAG 2.1, level AA, of every colour of text on every ground that it can stand on."""

    def luminance(code: str) -> float:
        values = [int(code[place : place + 2], 16) / 255 for place in (1, 3, 5)]
        linear = [value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4 for value in values]
        return float(np.dot(linear, (0.2126, 0.7152, 0.0722)))

    for ink in ("text", "soft", "link", "plus", "minus", "k", "s", "c", "m", "f", "p"):
        for ground in ("back", "card", "add", "del"):
            dark, light = sorted((luminance(colors[ink]), luminance(colors[ground])))
            assert (light + 0.05) / (dark + 0.05) >= 4.5, (ink, ground)


# --- command ----------------------------------------------------------------------------------------------------------


def test_the_command_writes_a_page_and_says_so(command, sides, tmp_path):
    code, out, err = command("old", "new", "--html", "d.html", "--no-pictures")
    assert (code, out) == (0, "")
    assert err.replace("\n", " ").endswith("Wrote d.html ")
    assert (tmp_path / "d.html").read_text("utf-8") == page(compare(*sides), Pictures())
    code, out, _ = command("old", "new", "--html", "d.html", "--no-pictures", "--stat")
    assert code == 0 and "passes/fog.py" in out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--html", "folder"], "--html folder is a folder"),
        (["--html", "none/d.html"], "cannot be written: there is no folder"),
        (["--html", "old/renderer.py"], "must end in .html"),
        (["--only", "passe"], "did you mean 'passes'?"),
        (["--pictures"], "--html FILE"),
    ],
)
def test_a_wrong_wish_is_said_before_anything_is_written(command, sides, tmp_path, words, said):
    (tmp_path / "folder").mkdir()
    before = (tmp_path / "old" / "renderer.py").read_bytes()
    code, out, err = command("old", "new", *words)
    assert (code, out) == (2, "") and said in err
    assert (tmp_path / "old" / "renderer.py").read_bytes() == before


def test_a_disk_that_refuses_is_said(command, sides, monkeypatch):
    def refuse(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("tools.diff.command.write_whole", refuse)
    code, _, err = command("old", "new", "--html", "d.html", "--no-pictures")
    assert code == 2 and "--html d.html cannot be written: Permission denied." in err


def test_the_chapters_differ_in_what_their_lessons_say(command):
    code, out, _ = command("1", "2")
    assert code == 0 and out.startswith("From chapter 1 to chapter 2: Bindless")
    code, out, _ = command("1@gl", "1", "--stat", "--only", "frames")
    assert code == 0 and "2 files with a twin, 2 only on Vulkan" in out


# --- pictures ---------------------------------------------------------------------------------------------------------


@pytest.fixture
def fork(tmp_path, monkeypatch):
    """A copy of chapter 1 whose forward pass is brighter; pictures are of a small scene."""
    monkeypatch.setattr(scenes, "DEFAULT", "cornell")
    monkeypatch.setattr(pictures, "SIZE", (48, 27))
    folder = tmp_path / "my-ch01"
    ignored = shutil.ignore_patterns("studies", "__pycache__")
    shutil.copytree(chapters.FOLDER / "ch01", folder, ignore=ignored)
    shader = folder / "shading" / "forward.frag"
    text = shader.read_text("utf-8")
    assert text.count("vec3 color = vec3(0.0);") == 1
    shader.write_text(text.replace("vec3 color = vec3(0.0);", "vec3 color = vec3(0.5);"), "utf-8")
    return folder


def brightness(png: bytes) -> float:
    return float(np.asarray(Image.open(io.BytesIO(png))).mean())


@pytest.mark.usefixtures("vulkan_instance")
def test_a_changed_pass_is_drawn_before_and_after(command, fork):
    made = compare(tree_of("1@vulkan"), tree_of(f"{fork}@vulkan"))
    steps = pictures.Steps(enabled=False)
    found = pictures.draw(made, steps)
    assert found.problems == () and found.passes.keys() == {"forward"}
    before, after = found.passes["forward"]
    assert brightness(after) > brightness(before) + 10
    assert Image.open(io.BytesIO(before)).size == (48, 27)


@pytest.mark.usefixtures("vulkan_instance")
def test_a_pass_that_writes_buffers_alone_has_no_picture_and_costs_none(monkeypatch):
    """Cloth writes vertices."""
    monkeypatch.setattr(scenes, "DEFAULT", "cloth")
    found = pictures.passes_of(tree_of("5@vulkan"), {"cloth", "tonemap"})
    assert set(found) == {"tonemap"} and Image.open(io.BytesIO(found["tonemap"])).size == pictures.SIZE


@pytest.mark.usefixtures("vulkan_instance")
def test_a_copy_that_cannot_be_drawn_costs_its_pictures_only(command, fork):
    (fork / "renderer.py").write_text("def broken(:\n")
    code, _, err = command("1@vulkan", f"{fork}@vulkan", "--html", "d.html")
    assert code == 0, err
    text = (fork.parent / "d.html").read_text("utf-8")
    assert "No pictures of my-ch01 on Vulkan: SyntaxError" in text
    assert len(Reader(text).all("src")) == 1


def test_a_machine_without_a_device_gets_a_page_all_the_same(command, fork, monkeypatch):
    def none(_):
        raise UnsupportedError("No Vulkan device was found.")

    monkeypatch.setattr(chapters, "choose_backend", none)
    code, _, err = command("1", fork, "--html", "d.html")
    assert code == 0, err
    text = (fork.parent / "d.html").read_text("utf-8")
    assert "No pictures of chapter 1: No Vulkan device was found." in text
    assert "vec3 color = vec3(0.5);" in "".join(Reader(text).code)
