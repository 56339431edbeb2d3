"""The rules of the house that a program can check: who imports whom, what every file says, what no file contains."""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
import sys
from collections.abc import Collection, Mapping, Sequence
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

import chapters
from common.paths import ROOT
from common.settings import knobs
from tests.support import contents
from tools.exercises import of_chapter
from tools.lessons import sections
from tools.snapshots.new_chapter import HEADINGS

FOLDERS = ("common", "backends", "chapters", "tools", "assets", "bootstrap", "shaders", "tests")
LONGEST = 450
"""Lines of a module; the aim is 400. Tests may have more: they are lists of cases."""
FORBIDDEN = {
    "common": {"backends", "chapters", "tools", "vulkan", "moderngl", "glfw"},
    "backends": {"chapters", "tools"},
    "assets": {"backends", "chapters", "tools"},
    "bootstrap": {"common", "backends", "chapters", "tools", "assets"},
}


def files(*suffixes: str) -> list[Path]:
    found = [path for folder in FOLDERS for path in (ROOT / folder).rglob("*") if path.suffix in suffixes]
    return sorted(path for path in found if "__pycache__" not in path.parts)


def shown(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


@pytest.mark.feature("core/layer-rule")
@pytest.mark.needs("importlinter")
def test_imports_go_one_way():
    """common <- backends <- chapters; no shared module imports a chapter, and no chapter another."""
    code = "from importlinter.cli import lint_imports_command as lint; lint(['--no-cache'])"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.feature("core/layer-rule")
def test_imports_go_one_way_in_the_text_too():
    """The same by the syntax trees, so that it holds where import-linter is not installed."""
    wrong = [
        f"{shown(path)} imports {name}"
        for path in files(".py")
        if (home := path.relative_to(ROOT).parts[0]) in FORBIDDEN
        for name in against_the_layers(home, path)
    ]
    assert not wrong


def against_the_layers(home: str, path: Path) -> list[str]:
    return [name for name in imported(path) if name.split(".")[0] in FORBIDDEN.get(home, ())]


@pytest.mark.feature("core/layer-rule")
def test_an_import_against_the_layers_is_named(tmp_path):
    path = tmp_path / "module.py"
    path.write_text(
        "import math\nfrom chapters import views\n\ndef late():\n    import backends.gl\n", "utf-8"
    )
    found = {home: against_the_layers(home, path) for home in ("common", "backends", "chapters")}
    assert found == {"common": ["chapters", "backends.gl"], "backends": ["chapters"], "chapters": []}
    assert against_the_layers("bootstrap", path) != []


BY_NAME = {"import_module", "__import__"}
BY_OTHER_MEANS = {"spec_from_file_location", "spec_from_loader", "SourceFileLoader", "run_module", "run_path"}
BUILTIN = {"exec", "eval"}
"""What imports, or runs text, without an import statement; `packages.load` of common does it, too."""

WORDS = re.compile("|".join((*BY_NAME, *BY_OTHER_MEANS, *BUILTIN, "packages")))

UNKNOWN_TARGETS = {
    "assets/scenes.py": "the generator of a scene, which its entry in the list of scenes names",
    "backends/selftest/run.py": "the self-test of a use, whose module `module_of` names in backends.*.selftests",
    "chapters/ch04/frames/backend/backend.py": "the module of an API, beside it or in a subject's folder",
    "chapters/ch05/frames/backend/backend.py": "the module of an API, beside it or in a subject's folder",
    "chapters/ch06/frames/backend/backend.py": "the module of an API, beside it or in a subject's folder",
    "chapters/ch07/frames/backend/backend.py": "the module of an API, beside it or in a subject's folder",
    "chapters/ch08/frames/backend/backend.py": "the module of an API, beside it or in a subject's folder",
    "chapters/ch09/frames/backend/backend.py": "the module of an API, beside it or in a subject's folder",
    "chapters/ch10/frames/backend/backend.py": "the module of an API, beside it or in a subject's folder",
    "chapters/ch11/frames/backend/backend.py": "the module of an API, beside it or in a subject's folder",
    "chapters/ch12/frames/backend/backend.py": "the module of an API, beside it or in a subject's folder",
    "backends/vulkan/api.py": "one file of the package vulkan, without the package",
    "common/packages.py": "a package that may be missing; what calls `load` is looked at instead",
}
"""The places below the tools in which an import may have a target that its text does not show, and what it is."""


def layered() -> list[Path]:
    """The files that may not import everything: all but the tools around the chapters, and tests."""
    chapter = re.compile(r"chapters/ch\d\d/")
    return [
        path
        for path in files(".py")
        if path.relative_to(ROOT).parts[0] in FORBIDDEN or chapter.match(shown(path))
    ]


@pytest.mark.feature("core/layer-rule")
def test_no_import_by_name_goes_round_the_layers():
    """import-linter sees statements alone: what `importlib` and the like import is held here."""
    uses = {shown(path): dynamic_imports(path.read_text("utf-8")) for path in layered()}
    wrong = [f"{name}: {target}" for name, targets in uses.items() for target in refused(name, targets)]
    assert not wrong
    assert {name for name, targets in uses.items() if None in targets} == {*UNKNOWN_TARGETS}


@pytest.mark.feature("core/layer-rule")
def test_an_import_by_name_against_the_layers_is_found():
    text = """
import builtins, importlib, importlib.util
from importlib import import_module as fetch
from common import packages
importlib.import_module("chapters.ch02.renderer")
fetch(f"backends.{backend}.resources")
packages.load("moderngl")
__import__("json")
other = builtins.__import__
importlib.util.spec_from_file_location("json", "chapters/ch02/renderer.py")
fetch(name)
fetch(f"chap{rest}")
exec("import chapters")
"""
    targets = dynamic_imports(text)
    assert targets.count(None) == 5
    assert refused("common/packages.py", targets) == ["chapters.ch02.renderer", "backends", "moderngl"]
    assert refused("backends/selftest/run.py", targets) == ["chapters.ch02.renderer"]
    assert refused("common/images/images.py", targets)[3:] == ["not known from the text"] * 5
    assert refused("chapters/ch02/renderer.py", targets[:4]) == []
    assert refused("chapters/ch01/renderer.py", targets[:4]) == ["chapters.ch02.renderer"]
    assert refused("chapters/ch02/frames/frame.py", targets[:4]) == ["backends", "moderngl"]
    assert refused("chapters/ch02/renderer.py", ["chapters"]) == ["chapters"], "of any number"


def dynamic_imports(text: str) -> list[str | None]:
    """Return the target of each import by name in the order of the text, as far as that shows it; else None."""
    if not WORDS.search(text):
        return []
    tree = ast.parse(text)
    names = {name: name for name in BY_NAME | BY_OTHER_MEANS | BUILTIN}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            names |= {one.asname or one.name: one.name for one in node.names if one.name in names}
            if node.module == "common.packages":
                names |= {one.asname or one.name: "import_module" for one in node.names if one.name == "load"}
    found: list[tuple[int, str | None]] = []
    arguments = {id(node.func): node.args for node in ast.walk(tree) if isinstance(node, ast.Call)}
    for node in ast.walk(tree):
        means = ""
        if isinstance(node, ast.Name):
            means = names.get(node.id, "")
        elif isinstance(node, ast.Attribute) and node.attr in BY_NAME | BY_OTHER_MEANS:
            means = node.attr
        elif isinstance(node, ast.Attribute) and ast.unparse(node).endswith("packages.load"):
            means = "import_module"
        if means:
            given = arguments.get(id(node), ()) if means in BY_NAME else ()
            found.append((node.lineno, known_part(given[0]) if given else None))
    return [target for _, target in sorted(found, key=lambda one: one[0])]


def known_part(argument: ast.expr) -> str | None:
    """Return the packages that a name begins with: "a.b.c" of a text, "a.b" of f"a.b.{c}"; None where that is none."""
    if isinstance(argument, ast.JoinedStr):
        first = argument.values[0]
        head = first.value if isinstance(first, ast.Constant) and isinstance(first.value, str) else ""
        return head.rpartition(".")[0] or None
    if isinstance(argument, ast.Constant) and isinstance(argument.value, str):
        return None if argument.value.startswith(".") else argument.value
    return None


def refused(name: str, targets: list[str | None]) -> list[str]:
    """Return the targets that the file `name` may not import."""
    parts = name.split("/")
    forbidden = FORBIDDEN.get(parts[0], set())
    if chapter_file(name) and not api_of(name):
        forbidden = forbidden | {"backends", *GRAPHICS}
    wrong = []
    for target in targets:
        if target is None:
            wrong += ["not known from the text"] if name not in UNKNOWN_TARGETS else []
            continue
        first, *rest = target.split(".")
        another = first == parts[0] == "chapters" and rest[:1] != parts[1:2]
        wrong += [target] if another or first in forbidden else []
    return wrong


# --- inside a chapter: what a file may import follows from its name ---

GRAPHICS = {"vulkan", "moderngl", "glcontext", "glfw", "cffi"}
"""Packages that talk to a driver or a window."""
APIS = {"vulkan": re.compile(r"(vulkan(_\w+)?|renderer)\.py"), "gl": re.compile(r"gl(_\w+)?\.py")}


def chapter_file(name: str) -> bool:
    """Whether a file belongs to what chapters hand on: not to a study."""
    return bool(re.match(r"chapters/ch\d\d/(?!studies/|benches/)", name))


def api_of(name: str) -> str:
    """Return the backend that a file of a chapter may use by its name: "vulkan", "gl", or "" for none."""
    file = name.rpartition("/")[2]
    if file == "renderer.py" and not re.match(r"chapters/ch0[123]/", name):
        return ""  # from chapter 4 on one renderer serves both
    return next((api for api, pattern in APIS.items() if pattern.fullmatch(file)), "")


def against_its_name(name: str, text: str, known: Collection[str]) -> list[str]:
    """Return what a file of a chapter imports against its name; `known` are all files of the chapters."""
    api, folder, wrong = api_of(name), name.split("/")[:-1], []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            wrong += [one.name for one in node.names if one.name.split(".")[0] in GRAPHICS - {api}]
        elif isinstance(node, ast.ImportFrom) and node.level:
            parts = [*folder[: len(folder) - node.level + 1], *(node.module or "").split(".")]
            module = "/".join(part for part in parts if part)
            for one in node.names:
                target = f"{module}/{one.name}.py" if f"{module}/{one.name}.py" in known else f"{module}.py"
                wrong += [target] if api_of(target) not in ("", api) else []
        elif isinstance(node, ast.ImportFrom):
            first, *rest = (node.module or "").split(".")
            shared = first == "backends" and rest[:1] not in (["vulkan"], ["gl"])
            free = first not in {"backends", *GRAPHICS} or rest[:1] == ["contract"]
            wrong += [] if free or (api and (shared or rest[:1] == [api])) else [str(node.module)]
    return wrong


@pytest.mark.feature("core/layer-rule")
def test_files_of_a_chapter_import_what_their_names_allow():
    """`vulkan*.py` and `gl*.py` import their own backend; every other file of a subject needs no graphics API."""
    known = {shown(path) for path in files(".py") if chapter_file(shown(path))}
    wrong = {name: against_its_name(name, (ROOT / name).read_text("utf-8"), known) for name in sorted(known)}
    assert {name: found for name, found in wrong.items() if found} == {}


@pytest.mark.feature("core/layer-rule")
@pytest.mark.parametrize(
    ("name", "allowed"),
    [
        ("model.py", {"contract", "own"}),
        ("vulkan.py", {"contract", "own", "vulkan", "vulkan_b", "shared"}),
        ("gl_parts.py", {"contract", "own", "gl", "gl_b", "shared"}),
        ("glow.py", {"contract", "own"}),
    ],
)
def test_an_import_against_a_file_s_name_is_found(name, allowed):
    lines = {
        "contract": "from backends.contract import Pass",
        "shared": "from backends.shader_text import build",
        "vulkan": "from backends.vulkan.device import Device",
        "gl": "from backends.gl.context import Context",
        "own": "from ..scene.records import Records",
        "vulkan_b": "from ..scene import vulkan_data",
        "gl_b": "from ..scene.gl_data import Data",
        "binding": "import moderngl",
    }
    known = {f"chapters/ch02/scene/{file}.py" for file in ("records", "vulkan_data", "gl_data")}
    found = {
        key for key, line in lines.items() if not against_its_name(f"chapters/ch02/fog/{name}", line, known)
    }
    assert found == allowed


EQUAL_RUN = 8
"""So many equal lines in a row, imports and blank ones aside, belong into a file that both can use."""


def lines_of(path: Path) -> list[str]:
    """Return the lines of a file without imports and blank ones, each without what it is indented by."""
    text = path.read_text("utf-8")
    left_out: set[int] = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import | ast.ImportFrom):
            left_out |= {*range(node.lineno, (node.end_lineno or node.lineno) + 1)}
    lines = enumerate(text.splitlines(), start=1)
    return [line.strip() for number, line in lines if line.strip() and number not in left_out]


def equal_runs(texts: Mapping[str, Sequence[str]], length: int = EQUAL_RUN) -> set[tuple[str, ...]]:
    """Return the files that share a run of so many lines, each group of files once."""
    found: dict[tuple[str, ...], set[str]] = {}
    for name, lines in texts.items():
        for first in range(len(lines) - length + 1):
            found.setdefault(tuple(lines[first : first + length]), set()).add(name)
    return {tuple(sorted(names)) for names in found.values() if len(names) > 1}


@pytest.mark.parametrize("number", chapters.available())
def test_no_two_files_of_a_chapter_share_a_run_of_lines(number):
    """What both APIs do in the same words is written once, in a file without an API in its name."""
    folder = ROOT / "chapters" / chapters.folder_name(number)
    own = [path for path in folder.rglob("*.py") if chapter_file(shown(path))]
    assert equal_runs({shown(path): lines_of(path) for path in own}) == set()


SHORT_RUN, MOST_COVERED = 4, 0.1
"""Runs of so many equal lines may cover so much of a file."""


def covered(texts: Mapping[str, Sequence[str]], length: int = SHORT_RUN) -> dict[str, float]:
    """Return, by file, the share of its lines that lie in a run which is also elsewhere among these files."""
    places: dict[tuple[str, ...], list[tuple[str, int]]] = {}
    for name, lines in texts.items():
        for first in range(len(lines) - length + 1):
            places.setdefault(tuple(lines[first : first + length]), []).append((name, first))
    shared: dict[str, set[int]] = {name: set() for name in texts}
    for found in places.values():
        for name, first in found if len(found) > 1 else []:
            shared[name] |= {*range(first, first + length)}
    return {name: len(shared[name]) / len(lines) for name, lines in texts.items() if lines}


@pytest.mark.parametrize("number", chapters.available())
def test_short_equal_runs_cover_little_of_any_file_of_a_chapter(number):
    folder = ROOT / "chapters" / chapters.folder_name(number)
    own = {shown(path): lines_of(path) for path in folder.rglob("*.py") if chapter_file(shown(path))}
    assert {name: part for name, part in covered(own).items() if part > MOST_COVERED} == {}


def test_what_short_runs_cover_is_measured():
    run = ["a", "b", "c", "d"]
    own = {"one": [*run, *"0123456"], "other": ["x", *run, "y"], "short": run[:3]}
    assert covered(own) == {"one": 4 / 11, "other": 4 / 6, "short": 0}
    assert covered({"twice": [*run, "x", *run, "y"]}) == {"twice": 8 / 10}


def test_a_shared_run_is_found(tmp_path):
    one, other = tmp_path / "one.py", tmp_path / "other.py"
    body = "".join(f"    x{number} = {number}\n\n" for number in range(EQUAL_RUN))
    one.write_text("import os\n\ndef first():\n" + body)
    other.write_text("import sys\n\nif True:\n    def second():\n" + body.replace("    ", "        "))
    assert equal_runs({path.name: lines_of(path) for path in (one, other)}) == {("one.py", "other.py")}
    other.write_text(other.read_text().replace("x3", "y3"))
    assert equal_runs({path.name: lines_of(path) for path in (one, other)}) == set()


MOST_MODULES = 14
"""Modules of one folder, `__init__.py` aside, that a reader still takes in at a glance."""

STARS = {"studies", "benches", "selftests"}
"""Folders of independent programs, one a module: what one of them is called says what it does."""


def test_no_folder_has_more_modules_than_a_reader_takes_in():
    counts: dict[str, int] = {}
    for top in ("chapters", "common", "backends", "tools"):
        for path in (ROOT / top).rglob("*.py"):
            if path.name != "__init__.py" and not STARS & {*path.parts}:
                counts[shown(path.parent)] = counts.get(shown(path.parent), 0) + 1
    assert len(counts) > 50
    assert {folder: count for folder, count in counts.items() if count > MOST_MODULES} == {}


def test_nothing_runs_the_python_layer_of_the_vulkan_package():
    """The binding takes its header alone; see backends/vulkan/api.py for what is wrong with the rest."""
    named = [
        p for p in files(".py") if "vulkan" in p.read_text("utf-8") and not shown(p).startswith("tests/")
    ]
    assert [shown(p) for p in named if any(n.split(".")[0] == "vulkan" for n in imported(p))] == []


@cache
def imported(path: Path) -> list[str]:
    names = []
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            names.append(node.module)
    return names


def test_every_module_begins_with_what_it_is():
    begins = re.compile(r'(#.*\n|\s)*r?"""\s*[^\s"]')
    assert not [shown(p) for p in files(".py") if not begins.match(p.read_text("utf-8"))]


def test_modules_are_short():
    counts = {
        shown(p): len(p.read_text("utf-8").splitlines()) for p in files(".py") if p.parts[-3:-1] != ("tests",)
    }
    long = {name: n for name, n in counts.items() if n > LONGEST and not name.startswith("tests/")}
    assert not long


def test_no_file_names_a_machine_or_is_left_undone():
    """Paths of one machine, marks of unfinished work, and carriage returns belong into no file."""
    unwanted = {
        "a home folder": re.compile(r"/(home|Users)/[a-z]"),
        "a folder of one machine": re.compile(r"/work/|/check/"),
        "work left undone": re.compile(r"\b(TODO|FIXME|XXX)\b"),
    }
    wrong = []
    for path in files(".py", ".glsl", ".vert", ".task", ".mesh", ".frag", ".comp", ".md", ".toml"):
        if path == Path(__file__):
            continue
        text = path.read_bytes().decode("utf-8")
        wrong += [f"{shown(path)}: {what}" for what, pattern in unwanted.items() if pattern.search(text)]
        if "\r" in text:
            wrong.append(f"{shown(path)}: a carriage return")
    assert not wrong


@pytest.mark.parametrize("number", chapters.available())
def test_a_lesson_is_complete(number):
    """Its README is there, and what it tells to read exists and says in its first sentence what it is."""
    from tools.diff.sentences import first_sentence

    folder = ROOT / "chapters" / chapters.folder_name(number)
    lesson = chapters.lesson(number)
    assert lesson.number == number
    assert (folder / "README.md").is_file()
    assert lesson.reading
    for name in lesson.reading:
        assert first_sentence(folder / name), name


@pytest.mark.feature("tools/exercises")
@pytest.mark.parametrize("number", chapters.available())
def test_a_readme_has_the_headings_of_every_chapter(number):
    """In their order, with something below each; what to read is LESSON.reading, with a sentence for each file."""
    text = readme_of(number)
    sections = re.split(r"^## (.*)\n", without_code(text), flags=re.M)
    assert sections[1::2] == list(HEADINGS)
    assert re.match(rf"# Chapter {number}: \S", text)
    found = dict(zip(sections[1::2], sections[2::2], strict=True))
    assert not [heading for heading, body in found.items() if len(body.split()) < 10]
    listed = re.findall(r"^\d+\. \[`([^`]+)`\]\(([^)]+)\): (\S.*\.)$", found["Reading order"], re.M)
    lesson = chapters.lesson(number)
    names = [name for name, _, _ in listed]
    assert names == [*lesson.core, *(name for name in lesson.reading if name not in lesson.core)]
    assert all(name == link for name, link, _ in listed)


@pytest.mark.parametrize("number", chapters.available())
def test_a_chapter_has_sections_of_a_picture_a_command_files_and_an_exercise(number):
    """Eight to ten files in all; each section is a part of "The idea" with its line under the heading."""
    lesson, every = chapters.lesson(number), sections.parts(number)
    assert 3 <= len(every) <= 6 and 8 <= len(lesson.core) <= 10
    assert {*lesson.core} <= {*lesson.reading}
    exercises = [part.section.exercise for part in every]
    assert {*exercises} <= {exercise.name for exercise in of_chapter(number)} and len({*exercises}) == len(
        every
    )
    found = sections.cut(readme_of(number), [part.section.title for part in every])
    assert [*found] == [part.section.title for part in every]
    for part in every:
        lines = found[part.section.title]
        assert lines[2] == sections.summary(part)
        assert any(line.startswith("![") for line in lines), f"{part.key} has no picture"


@pytest.mark.parametrize("number", chapters.available()[1:])
def test_a_knob_keeps_the_choices_of_the_chapter_before(number):
    """Features are monotone: settings in a record or a script work in later chapters."""
    before, after = (knobs(chapters.settings_class(one)) for one in (number - 1, number))
    assert {*before} <= {*after}
    lost = {name: {*knob.choices} - {*after[name].choices} for name, knob in before.items() if knob.choices}
    assert not {name: choices for name, choices in lost.items() if choices}


@pytest.mark.parametrize("number", chapters.available())
def test_links_of_a_readme_lead_somewhere(number):
    """To a file, or to a heading of the page itself."""
    text, folder = readme_of(number), ROOT / "chapters" / chapters.folder_name(number)
    headings = {anchor(line) for line in re.findall(r"^#+ (.*)$", without_code(text), re.M)}
    lost = []
    for link in re.findall(r"\]\(([^)\s]+)\)", without_code(text)):
        path, _, heading = link.partition("#")
        if not path:
            lost += [link] if heading not in headings else []
        elif "://" not in path and not (folder / path).exists():
            lost.append(link)
    assert not lost


def readme_of(number: int) -> str:
    """Return a chapter's README; a chapter whose lesson adds nothing yet may be without one."""
    path = ROOT / "chapters" / chapters.folder_name(number) / "README.md"
    if not path.is_file() and not chapters.lesson(number).adds:
        pytest.skip(f"chapter {number} adds nothing yet, and has no README")
    return path.read_text("utf-8")


def without_code(text: str) -> str:
    """Return a page without its blocks of code, in which a "#" is no heading."""
    return re.sub(r"^```.*?^```$", "", text, flags=re.M | re.S)


def anchor(heading: str) -> str:
    """Return the name under which GitHub links to a heading."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


@pytest.mark.parametrize("number", chapters.available())
def test_presets_are_those_of_the_command_line(number):
    from common.settings import preset
    from tools.run.run import QUALITIES

    kind = chapters.settings_class(number)
    assert tuple(kind.PRESETS)[:4] == QUALITIES[1:], "a chapter's own presets come behind those of all"
    for name in kind.PRESETS:
        preset(kind, name)


@pytest.mark.parametrize("number", chapters.available())
def test_tables_of_settings_name_knobs_and_values_in_their_range(number):
    from common.settings import apply_overrides

    kind = chapters.settings_class(number)
    tables = [*kind.PRESETS.values(), *(swept.truth for swept in kind.PREPARED)]
    pairs = [pair for table in tables for pair in table.items()]
    for turned in (kind.SWEEP, *(swept.knobs for swept in kind.PREPARED)):
        pairs += [(name, value) for name, values in turned.items() for value in values]
    apply_overrides(kind(), [f"{name}={value}" for name, value in pairs])
    assert all(swept.truth.keys() == swept.knobs.keys() for swept in kind.PREPARED)


@pytest.mark.parametrize("number", chapters.available())
def test_knobs_are_grouped_by_subject_and_have_plain_flat_names(number):
    """`settings.cloth.substeps` is in cloth/settings.py; from outside, it is `cloth_substeps`."""
    import dataclasses

    from common.settings import knobs

    kind: Any = chapters.settings_class(number)
    known = knobs(kind)
    assert len(set(kind.ORDER.split())) == len(kind.ORDER.split()) and set(kind.ORDER.split()) <= set(known)
    for field in dataclasses.fields(kind):
        home = (
            field.metadata["group"]
            .__module__.removeprefix(kind.__module__.removesuffix("settings"))
            .split(".")
        )
        assert home[-1] == "settings" and home[-2] == field.name
    for name, record in known.items():
        group, own = record.path.split(".")
        assert name in (own, f"{group}_{own}") or (name == group and own in ("enabled", "name", "mode"))
        assert own != "enabled" or name == group


def test_knobs_keep_their_order_from_chapter_to_chapter():
    """A lesson adds knobs to tables and records; those that were there stay in their order."""
    from common.settings import knobs

    names = [list(knobs(chapters.settings_class(number))) for number in chapters.available()]
    for before, after in pairwise(names):
        assert [name for name in after if name in before] == before


@pytest.mark.parametrize("number", chapters.available())
def test_settings_import_neither_the_graph_compiler_nor_twins(number):
    code = f"import sys, chapters.ch{number:02}.settings; print(*sys.modules)"
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    parts = [name.removeprefix(f"chapters.ch{number:02}.") for name in loaded]
    assert "graph.settings" in parts or number < 4
    graph = {name for name in parts if name.startswith("graph.")} - {"graph.settings"}
    assert not graph and not [name for name in parts if name.startswith(("common.twins", "backends"))]


@pytest.mark.parametrize("number", [number for number in chapters.available() if number >= 3])
def test_tests_of_loading_depend_on_no_knobs_but_its_own(number, tmp_path):
    """So they run once for all chapters in which loading is the same, whatever other knobs there are."""
    digests = []
    for changed in ("README.md", "settings.py", "shading/settings.py", "loading/settings.py"):
        copy = tmp_path / changed.replace("/", " ")
        shutil.copytree(
            chapters.FOLDER / f"ch{number:02}", copy, ignore=shutil.ignore_patterns("__pycache__")
        )
        with (copy / changed).open("a", encoding="utf-8") as file:
            file.write("# other")
        digests.append(contents.digest(ROOT / "tests/ch03/test_loading.py", "chapters.ch03", copy))
    assert digests[0] == digests[1] == digests[2] != digests[3]
