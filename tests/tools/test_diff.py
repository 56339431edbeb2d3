"""The difference of two trees: statuses, counts, hunks, functions, renamed and moved code, on trees made here."""

from __future__ import annotations

import random
import tempfile
from pathlib import Path

import pytest

import chapters
from tools.diff.diff import TreeDifference, difference
from tools.diff.files import Source
from tools.diff.functions import outline

pytestmark = pytest.mark.feature("tools/diff")

RENDERER = '''"""A frame, from top to bottom. More is said here."""

import time

SLOTS = 2


class Renderer:
    """The chapter."""

    def render(self, view):
        """Draw."""
        started = time.perf_counter()
        self.forward(view)
        return started

    def close(self):
        """Free everything."""
        self.forward = None
'''

SHADER = """// Fragments of the forward pass: one light.
// It has no shadow.

#include "scene.glsl"

struct Light {
    vec4 color;
};

vec3 shade(vec3 n) {
    if (n.z > 0.0) {  // void fake() {
        return n;
    }
    return vec3(0.0);
}

void main() {
    shade(vec3(1.0));
}
"""


def tree(folder: Path, files: dict[str, str | bytes]) -> Path:
    """Write files by their path and return the folder."""
    folder.mkdir()
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return folder


@pytest.fixture
def of(tmp_path):
    """Return the difference of two trees, given as dictionaries of their files."""

    def made(a, b, reading=()) -> TreeDifference:
        place = Path(tempfile.mkdtemp(dir=tmp_path))
        return difference(tree(place / "a", a), tree(place / "b", b), reading)

    return made


def functions(file):
    return [(f.name, f.kind, f.status, f.insertions, f.deletions) for f in file.functions]


def rebuilt(file, side: str) -> list[str]:
    """Return one side's lines made from the other side's and the hunks."""
    lines = list((file.old if side == "new" else file.new).lines)
    gone, come = ("-", "+") if side == "new" else ("+", "-")
    number = (lambda line: line.old) if side == "new" else (lambda line: line.new)
    for hunk in reversed(file.hunks):
        kept = [line for line in hunk.lines if line.mark != come]
        start = number(kept[0]) - 1
        assert [line.text for line in kept] == lines[start : start + len(kept)]
        lines[start : start + len(kept)] = [line.text for line in hunk.lines if line.mark != gone]
    return lines


def test_new_removed_changed_and_same_in_the_order_of_the_reading(of):
    a = {"same.py": "x = 1\n", "z.py": "a = 1\n", "b.py": "b = 1\n", "old.py": "gone = 1\n"}
    b = {"same.py": "x = 1\n", "z.py": "a = 2\n", "b.py": "b = 2\n", "new.py": "come = 1\ncome2 = 2\n"}
    made = of(a, b, ["z.py", "new.py"])
    assert [(f.path, f.status, f.insertions, f.deletions) for f in made.files] == [
        ("z.py", "changed", 1, 1),
        ("new.py", "new", 2, 0),
        ("b.py", "changed", 1, 1),
        ("old.py", "removed", 0, 1),
        ("same.py", "same", 0, 0),
    ]
    assert (made.insertions, made.deletions) == (4, 3)
    assert [f.path for f in made.changed] == ["z.py", "new.py", "b.py", "old.py"]
    assert [f.path for f in made.of_status("new", "removed")] == ["new.py", "old.py"]


def test_changed_methods_are_named_with_their_counts(of):
    changed = RENDERER.replace(
        "        self.forward(view)\n", "        self.cull(view)\n        self.draw()\n"
    )
    changed = changed.replace("SLOTS = 2", "SLOTS = 3")
    changed += "\n    def resize(self, size):\n        self.size = size\n"
    changed += "\n\nclass Extra:\n    def one(self):\n        pass\n"
    (file,) = of({"renderer.py": RENDERER}, {"renderer.py": changed}).files
    assert functions(file) == [
        ("SLOTS", "constant", "changed", 1, 1),
        ("Renderer.render", "method", "changed", 2, 1),
        ("Renderer.resize", "method", "new", 2, 0),
        ("Extra", "class", "new", 3, 0),
    ]
    assert file.sentence == "A frame, from top to bottom."
    assert [hunk.within for hunk in file.hunks] == ["SLOTS", "Renderer.render"]


def test_a_removed_class_counts_with_its_methods_and_decorators_belong_to_their_function(of):
    old = "class Gone:\n    def a(self):\n        return 1\n\n\n@cache\ndef kept():\n    return 1\n"
    new = "@cached\ndef kept():\n    return 1\n"
    (file,) = of({"x.py": old}, {"x.py": new}).files
    assert functions(file) == [("kept", "function", "changed", 1, 1), ("Gone", "class", "removed", 0, 3)]


def test_functions_of_shaders_are_found_behind_comments_and_branches(of):
    found = [
        (one.name, one.kind, one.first, one.last)
        for one in outline(Source("a.frag", SHADER.encode())).definitions
    ]
    assert found == [
        ("Light", "struct", 6, 8),
        ("shade", "function", 10, 15),
        ("main", "function", 17, 19),
    ]
    new = SHADER.replace("return vec3(0.0);", "return vec3(0.5);").replace("scene.glsl", "other.glsl")
    (file,) = of({"shaders/a.frag": SHADER}, {"shaders/a.frag": new}).files
    assert functions(file) == [("shade", "function", "changed", 1, 1)]
    assert file.sentence == "Fragments of the forward pass: one light."


def test_every_function_of_the_chapters_shaders_is_found():
    """Against another way: at depth 0, a closing bracket before an opening brace is a function's."""
    shaders = [
        path
        for path in chapters.FOLDER.glob("ch01/**/*")
        if path.suffix in (".frag", ".vert", ".comp", ".glsl")
    ]
    assert len(shaders) > 10
    for path in shaders:
        found = outline(Source(path.name, path.read_bytes())).definitions
        names = [one.name for one in found if one.kind == "function"]
        lines = path.read_text("utf-8").splitlines()
        heads = [line for line in lines if line.endswith(") {") and not line.startswith((" ", "#", "//"))]
        assert [head.partition("(")[0].split()[-1] for head in heads] == names, path.name


@pytest.mark.parametrize("seed", range(8))
def test_hunks_turn_each_side_into_the_other(of, seed):
    random.seed(seed)
    a = [f"line {random.randrange(12)}" for _ in range(60)]
    b = [line for line in a if random.random() > 0.2]
    for _ in range(9):
        b.insert(random.randrange(len(b)), f"new {random.randrange(3)}")
    (file,) = of({"x.txt": "\n".join(a) + "\n"}, {"x.txt": "\n".join(b) + "\n"}).files
    assert rebuilt(file, "new") == b
    assert rebuilt(file, "old") == a
    assert file.insertions - file.deletions == len(b) - len(a)
    for hunk in file.hunks:  # side by side, each line stands once on its side, in order
        left = [row[0].text for row in hunk.rows() if row[0]]
        right = [row[1].text for row in hunk.rows() if row[1]]
        assert left == [line.text for line in hunk.lines if line.mark != "+"]
        assert right == [line.text for line in hunk.lines if line.mark != "-"]


def test_a_renamed_file_is_one_file_and_its_changes_are_counted_alone(of):
    made = of({"old.py": RENDERER}, {"new.py": RENDERER.replace("SLOTS = 2", "SLOTS = 3")})
    (file,) = made.files
    assert (file.path, file.status, file.old.path, file.insertions, file.deletions) == (
        "new.py",
        "renamed",
        "old.py",
        1,
        1,
    )
    (file,) = of({"o.bin": b"\0\1"}, {"n.bin": b"\0\1"}).of_status("renamed")
    assert (file.old.path, file.hunks) == ("o.bin", ())


def test_empty_files_are_no_renames(of):
    made = of({"a/__init__.py": ""}, {"b/__init__.py": ""})
    assert [(f.path, f.status) for f in made.files] == [
        ("a/__init__.py", "removed"),
        ("b/__init__.py", "new"),
    ]


def test_moved_code_is_said_even_where_its_indentation_changed(of):
    body = [f"value_{n} = compute_something({n})" for n in range(5)]
    a = {"a.py": "x = 1\n" + "\n".join(body) + "\ny = 2\n", "b.py": "z = 3\n"}
    b = {"a.py": "x = 1\ny = 2\n", "b.py": "z = 3\ndef f():\n" + "".join(f"    {one}\n" for one in body)}
    (move,) = of(a, b).moves
    assert (move.old_path, move.old_line, move.new_path, move.new_line, move.lines) == (
        "a.py",
        2,
        "b.py",
        3,
        5,
    )


def test_a_line_is_the_new_place_of_one_line_only(of):
    body = "".join(f"value_{n} = compute_something({n})\n" for n in range(4))
    made = of(
        {"a.txt": f"a\n{body}b\n{body}c\n", "b.txt": "d\n"}, {"a.txt": "a\nb\nc\n", "b.txt": f"d\n{body}"}
    )
    assert [(move.old_line, move.new_line, move.lines) for move in made.moves] == [(2, 2, 4)]


def test_brackets_imports_and_two_lines_are_not_moved(of):
    imports = "import alpha_beta_gamma\nimport delta_epsilon_zeta\nimport eta_theta_iota_kappa\n"
    short = "first_value = compute_something(1)\nsecond_value = compute_something(2)\n"
    brackets = "    )\n    ]\n    }\n"
    for text in (imports, short, brackets):
        made = of({"a.txt": text + "end\n", "b.txt": "x\n"}, {"a.txt": "end\n", "b.txt": "x\n" + text})
        assert made.changed and made.moves == ()


def test_binary_files_are_compared_by_their_bytes(of):
    made = of({"a.bin": b"\0\1\2", "b.txt": b"\xff\xfe\n"}, {"a.bin": b"\0\1\3", "b.txt": b"text\n"})
    for file in made.files:
        assert file.status == "changed" and file.binary and file.hunks == () and "no text" in file.notes[0]
    (file,) = of({}, {"c.bin": bytes(1000)}).of_status("new")
    assert "1,000 bytes" in file.notes[0] and file.insertions == 0


@pytest.mark.parametrize(
    ("a", "b", "note"),
    [
        (b"x = 1\r\ny = 2\r\n", b"x = 1\ny = 2\n", "CRLF in A alone"),
        (b"x = 1\ny = 2", b"x = 1\ny = 2\n", "no end in A"),
        (b"x = 1\n", b"x = 1\r\n", "CRLF in B alone"),
        (b"x = 1\n", b"x = 1", "no end in B"),
    ],
)
def test_line_ends_are_said_and_count_as_no_line(of, a, b, note):
    (file,) = of({"x.py": a}, {"x.py": b}).files
    assert file.status == "changed" and (file.insertions, file.deletions, file.hunks) == (0, 0, ())
    assert note in "; ".join(file.notes)
    assert not file.imports_only


def test_a_file_that_cannot_be_parsed_is_compared_all_the_same(of):
    (file,) = of({"x.py": "def f():\n    return 1\n"}, {"x.py": "def f(:\n    return 2\n"}).files
    assert (file.insertions, file.deletions, file.functions) == (2, 2, ())
    assert "line 1" in file.notes[0] and "cannot be parsed" in file.notes[0]


def test_empty_and_long_and_foreign(of):
    long = "x = '" + "é漢🎈" * 40_000 + "'\n"
    a = {"empty.py": "", "long.py": long, "feed.py": "a = 1\x0c\nb = '\u2028'\n"}
    b = {"empty.py": "x = 1\n", "long.py": long.replace("x", "y", 1), "feed.py": "a = 1\x0c\nb = '\u2029'\n"}
    made = of(a, b)
    assert [(f.path, f.insertions, f.deletions) for f in made.files] == [
        ("empty.py", 1, 0),
        ("feed.py", 1, 1),
        ("long.py", 1, 1),
    ]
    (empty,) = of({}, {"none.py": ""}).of_status("new")
    assert (empty.insertions, empty.hunks) == (0, ())


def test_imports_alone_are_known(of):
    a = {
        "x.py": "from a import (\n    b,\n)\n\nx = 1\n",
        "s.frag": '#include "a.glsl"\n',
        "y.py": "import a\n",
    }
    b = {
        "x.py": "from a import (\n    b,\n    c,\n)\n\nx = 1\n",
        "s.frag": '#include "b.glsl"\n',
        "y.py": "import b\ny = 1\n",
    }
    made = of(a, b)
    assert [(f.path, f.imports_only) for f in made.files] == [
        ("s.frag", True),
        ("x.py", True),
        ("y.py", False),
    ]


def test_studies_benches_caches_and_hidden_files_are_no_part_of_a_chapter(of):
    made = of(
        {},
        {
            "studies/a.py": "x",
            "benches/a.py": "x",
            "__pycache__/a.pyc": b"x",
            ".hidden": "x",
            "a.py": "x = 1\n",
            "out/p.png": b"x",
        },
    )
    assert [f.path for f in made.files] == ["a.py"]


def test_imports_of_a_new_file_are_a_part_of_their_own(of):
    head, rest = ['"""Head."""', ""], ["", "X = 1", "", "def f():", "    import late", "    return late"]
    imports = ["from __future__ import annotations", "", "import os", "from a import (", "    b,", ")"]
    (file,) = of({}, {"x.py": "\n".join([*head, *imports, *rest]) + "\n"}).files
    assert [[line.text for line in hunk.lines] for hunk in file.hunks] == [head, imports, rest]
    assert [hunk.imports_only for hunk in file.hunks] == [False, True, False] and not file.imports_only
    (gone,) = of({"x.py": "import os\n\nX = 1\n"}, {}).files
    assert [hunk.imports_only for hunk in gone.hunks] == [True, False]
    (none,) = of({}, {"x.py": "X = 1\n"}).files
    assert [hunk.imports_only for hunk in none.hunks] == [False]
    (shader,) = of({}, {"x.frag": '#include "a.glsl"\nvoid main() {}\n'}).files
    assert [hunk.imports_only for hunk in shader.hunks] == [True, False]


def test_a_new_file_comes_in_parts_that_hold_all_of_it(of):
    lines = ['"""Head."""', "", *(f"X{n} = {n}" for n in range(20))]
    for n in range(6):
        lines += [f"def f{n}():", *(f"    a{k} = {k}" for k in range(9)), ""]
    (file,) = of({}, {"x.py": "\n".join(lines) + "\n"}).files
    assert [line.text for hunk in file.hunks for line in hunk.lines] == lines
    assert [hunk.within for hunk in file.hunks] == ["", "f0", "f2", "f4"]
    assert [f.insertions for f in file.functions if f.kind == "function"] == [10] * 6


def test_a_large_file_is_compared_in_a_moment(of):
    lines = [f"row {n % 50}" for n in range(8_000)]
    changed = [*lines[:3000], "new", *lines[3000:]]
    (file,) = of({"x.txt": "\n".join(lines)}, {"x.txt": "\n".join(changed)}).files
    assert rebuilt(file, "new") == changed


def test_the_chapters_can_be_compared():
    one, two = (chapters.FOLDER / chapters.folder_name(n) for n in (1, 2))
    made = difference(one, two, chapters.lesson(2).reading)
    assert {f.path for f in made.files} >= {"renderer.py", "__init__.py"}
    for file in made.of_status("changed"):
        if file.hunks:
            assert rebuilt(file, "new") == file.new.lines, file.path
