"""Bundles: packed from a small clone, changed in every way, and used on a machine whose network is off."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from bootstrap import bundle as reading
from bootstrap import offline
from bootstrap.bundle import CLONE, HISTORY, MANIFEST, Entry, open_bundle
from bootstrap.environment import Environment, SetupError, Supply
from common.errors import UserError
from tests.launcher.clone import Clone, make_clone, make_environment
from tools.bundle import bundle
from tools.bundle.wheels import Fetched

PYTHON = "{}.{}".format(*sys.version_info[:2])
NOWHERE = "http://127.0.0.1:9"
"""The port "discard", at which nobody listens."""


def git(root: Path, *words: str) -> str:
    variables = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}
    named = ("-c", "user.name=A", "-c", "user.email=a@example.org", "-c", "core.autocrlf=false")
    done = subprocess.run(
        ["git", *named, *words], cwd=root, env=variables, capture_output=True, text=True, check=True
    )
    return done.stdout


@dataclass(frozen=True)
class Packed:
    """A clone with two commits, and the bundle that was made of it."""

    clone: Clone
    file: Path


@pytest.fixture(scope="module")
def wheels_only() -> Iterator[Callable[[Path], None]]:
    """Let pip find what is in a folder, and nothing else, for the module."""
    with pytest.MonkeyPatch.context() as patch:

        def use(folder: Path) -> None:
            patch.setenv("PIP_CONFIG_FILE", os.devnull)
            patch.setenv("PIP_NO_INDEX", "1")
            patch.setenv("PIP_FIND_LINKS", folder.as_uri())

        yield use


@pytest.fixture(scope="module")
def packed(tmp_path_factory: pytest.TempPathFactory, wheels_only: Callable[[Path], None]) -> Packed:
    """A bundle; tests leave it as it is."""
    folder = tmp_path_factory.mktemp("packed")
    clone = make_clone(folder)
    (clone.root / ".gitignore").write_text("out/\n")
    git(clone.root, "init", "--quiet")
    (clone.root / "old.txt").write_text("once\n")
    for message in ("first", "second"):
        git(clone.root, "add", "--all")
        git(clone.root, "commit", "--quiet", "-m", message)
        (clone.root / "old.txt").unlink(missing_ok=True)
    (clone.root / "new.txt").write_text("now\n")
    model = folder / "duck" / "duck.gltf"
    model.parent.mkdir()
    model.write_text(json.dumps({"buffers": [{"uri": "duck%201.bin"}], "images": [{"uri": "data:,x"}]}))
    (model.parent / "duck 1.bin").write_bytes(bytes(100))
    (model.parent / "LICENSE.md").write_text("CC0")
    (model.parent / "thesis.txt").write_text("somebody's own")
    site = clone.root / "out" / "site"
    site.mkdir(parents=True)
    (site / bundle.site.MARK).touch()
    (site / "index.html").write_text("<title>Strata</title>")
    wheels_only(clone.wheels)
    file = folder / "a bundle.zip"
    assert bundle.run(file, models=[str(model)], root=clone.root) == 0
    return Packed(clone, file)


def rewritten(packed: Packed, path: Path, change: Callable[[dict[str, bytes]], None]) -> Path:
    """Write a bundle whose files were changed, by their names; the archive itself is whole."""
    with zipfile.ZipFile(packed.file) as old:
        files = {name: old.read(name) for name in old.namelist()}
    change(files)
    with zipfile.ZipFile(path, "w") as new:
        for name, data in files.items():
            new.writestr(zipfile.ZipInfo(name), data)
    return path


def retold(packed: Packed, path: Path, change: Callable[[dict], None]) -> Path:
    """Write a bundle whose manifest was changed, and fits."""

    def edit(files: dict[str, bytes]) -> None:
        manifest = json.loads(files[MANIFEST])
        change(manifest)
        files[MANIFEST] = json.dumps(manifest).encode()

    return rewritten(packed, path, edit)


def refusal(path: Path) -> str:
    """Return the sentence with which a bundle is refused."""
    with pytest.raises(SetupError) as caught, open_bundle(path):
        pass
    text = str(caught.value)
    assert str(path) in text and text.endswith(".") and "\n" not in text
    return text


# --- The network is off ---


def cut_off() -> list[str]:
    """Return what starts a program without any network, [] where the system does not allow that."""
    for command in (["unshare", "--net"], ["unshare", "--map-root-user", "--net"]):
        try:
            if subprocess.run([*command, "true"], capture_output=True, check=False).returncode == 0:
                return command
        except OSError:
            break
    return []


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has strata.cmd, which needs cmd.exe")
def test_from_a_bundle_alone_to_a_command_with_the_network_off(packed: Packed, tmp_path: Path) -> None:
    folder = tmp_path / "other machine"
    other = Clone(folder, tmp_path)
    # Besides, pip is told of an index and a proxy where nobody answers; it must ask neither.
    dead = {"PIP_NO_INDEX": "", "PIP_INDEX_URL": NOWHERE, "PIP_FIND_LINKS": "", "https_proxy": NOWHERE}
    variables = other.environment(**dead, http_proxy=NOWHERE, PIP_RETRIES="0")

    def run(*command: str | Path) -> subprocess.CompletedProcess[str]:
        words = [*cut_off(), *command]
        return subprocess.run(
            words,
            cwd=tmp_path,
            env=variables,
            capture_output=True,
            text=True,
            stdin=subprocess.DEVNULL,
            check=False,
        )

    unpacked = run(sys.executable, packed.file, "other machine")
    assert unpacked.returncode == 0, unpacked.stderr
    assert f'./strata --from "{packed.file}" run 1' in unpacked.stdout
    make_environment(other)
    first = run(folder / "strata", "--no-install", "--from", packed.file, "list")
    assert first.returncode == 0, first.stderr
    told = json.loads(first.stdout)
    assert (told["arguments"], told["tiny"], told["python"]) == (["list"], 1, str(other.python))
    assert (folder / "out" / "models" / "duck" / "duck 1.bin").read_bytes() == bytes(100)
    assert (folder / "out" / "site" / "index.html").read_text() == "<title>Strata</title>"
    assert "strata: From the bundle: out/models/duck/duck.gltf.\n" in first.stderr
    again = run(folder / "strata", "list")
    assert (again.returncode, again.stderr) == (0, "")


# --- What is packed ---


def test_the_clone_is_that_of_the_last_commit_with_its_history(packed: Packed, tmp_path: Path) -> None:
    offline.unpack_clone(packed.file, tmp_path / "clone")
    clone, original = tmp_path / "clone", packed.clone.root
    names = git(original, "ls-files").splitlines()
    assert git(clone, "ls-files").splitlines() == names
    for name in names:
        assert (clone / name).read_bytes() == (original / name).read_bytes()
    assert git(clone, "log", "--format=%H") == git(original, "log", "--format=%H")
    assert git(clone, "show", "HEAD~:old.txt") == "once\n"
    assert git(clone, "status", "--short") == ""
    assert os.access(clone / "strata", os.X_OK)
    assert not os.access(clone / "pyproject.toml", os.X_OK)
    assert not (clone / "new.txt").exists()  # it was never committed


def test_what_is_not_committed_is_said(
    packed: Packed, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    second = tmp_path / "again.zip"
    model = packed.file.parent / "duck" / "duck.gltf"
    bundle.run(second, models=[str(model)], root=packed.clone.root)
    printed = capsys.readouterr()
    assert "Not committed and so not packed as it is: new.txt." in printed.err
    assert "Wrote" in printed.out and "with its history" in printed.out and "Models: duck." in printed.out
    # And what was packed twice is the same twice, to the bit.
    assert second.read_bytes() == packed.file.read_bytes()


def test_a_site_that_is_markdown_alone_is_not_packed_and_a_built_one_is_whole(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without mkdocs-material there are pages as Markdown, which no browser shows."""
    assert bundle.site_parts(tmp_path) == []
    assert "since it was not built: --site builds it first." in capsys.readouterr().err
    folder = tmp_path / "out" / "site"
    (folder / "chapters").mkdir(parents=True)
    for name in (bundle.site.MARK, "index.md", "chapters/ch01.md"):
        (folder / name).touch()
    assert bundle.site_parts(tmp_path) == []
    assert "since it is Markdown alone: ./strata --extras docs builds it." in capsys.readouterr().err
    (folder / "index.html").touch()
    assert {part.name.removeprefix(bundle.SITE) for part in bundle.site_parts(tmp_path)} == {
        bundle.site.MARK,
        "index.md",
        "index.html",
        "chapters/ch01.md",
    }
    assert capsys.readouterr().err == ""


def test_a_model_is_packed_with_its_files_and_its_licence_and_nothing_else(packed: Packed) -> None:
    with open_bundle(packed.file) as opened:
        names = opened.names("models/")
    assert names == ["models/duck/LICENSE.md", "models/duck/duck 1.bin", "models/duck/duck.gltf"]


def test_a_model_of_the_clone_is_none_and_a_missing_file_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert bundle.model_parts(["atrium"], bundle.ROOT) == []
    assert "part of the clone" in capsys.readouterr().err
    model = tmp_path / "a b.obj"
    model.write_text("mtllib red.mtl\nv 0 0 0\nmtllib blue.mtl\n")
    (tmp_path / "red.mtl").write_text("newmtl red\n")
    parts = bundle.model_parts([str(model)], bundle.ROOT)
    assert [part.name for part in parts] == ["models/a_b/a b.obj", "models/a_b/red.mtl"]
    assert "blue.mtl, which is missing" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"buffers": [{"uri": "../secret.bin"}]}', "outside the model's folder"),
        ("{", "no glTF that can be read"),
        ('{"buffers": 3}', "no glTF that can be read"),
        ("", "the file is empty"),
    ],
)
def test_a_model_that_cannot_be_packed_is_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "secret.bin").write_bytes(b"1")
    model = tmp_path / "folder" / "a.gltf"
    model.parent.mkdir()
    model.write_text(text)
    with pytest.raises(UserError, match=message) as caught:
        bundle.model_parts([str(model)], bundle.ROOT)
    assert str(model) in str(caught.value)


def test_two_models_of_one_name_are_refused(tmp_path: Path) -> None:
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "scene.obj").write_text(f"# {folder}\nv 0 0 0\n")
    with pytest.raises(UserError, match="two models are called scene"):
        bundle.model_parts([str(tmp_path / f / "scene.obj") for f in "ab"], bundle.ROOT)


def test_where_there_is_no_site_or_history_that_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert bundle.site_parts(tmp_path) == []
    assert "--site builds it first" in capsys.readouterr().err
    for name in "ab":
        (tmp_path / name).mkdir()
    (tmp_path / "a" / "file").touch()
    git(tmp_path / "a", "init", "--quiet")
    for number in range(2):
        (tmp_path / "a" / "file").write_text(str(number))
        git(tmp_path / "a", "add", "--all")
        git(tmp_path / "a", "commit", "--quiet", "-m", "one")
    git(tmp_path, "clone", "--quiet", "--depth=1", (tmp_path / "a").as_uri(), "b")
    parts = bundle.clone_parts(tmp_path / "b", bundle.History(tmp_path / "b"), tmp_path)
    assert [(part.name, part.source) for part in parts] == [(CLONE + "file", b"1")]
    assert "not packed, since this clone is shallow" in capsys.readouterr().err


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no symbolic links for everybody")
def test_a_tracked_link_is_refused(tmp_path: Path) -> None:
    git(tmp_path, "init", "--quiet")
    (tmp_path / "link").symlink_to("/etc/passwd")
    git(tmp_path, "add", "--all")
    git(tmp_path, "commit", "--quiet", "-m", "one")
    with pytest.raises(UserError, match="link is a link, which a bundle cannot hold"):
        bundle.clone_parts(tmp_path, bundle.History(tmp_path), tmp_path)


# --- A bundle cannot be made ---


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"systems": ["linus"]}, "no system 'linus'; did you mean 'linux'"),
        ({"pythons": ["2.7"]}, r"--python 2\.7"),
        ({"pythons": ["3.10"]}, r"3\.11 and newer"),
        ({"pythons": ["3.011"]}, r"--python 3\.011"),
        ({"pythons": ["3.x"]}, r"--python 3\.x"),
        ({"models": ["atrum"]}, "no scene"),
    ],
)
def test_what_is_asked_wrongly_is_a_sentence(
    packed: Packed, tmp_path: Path, words: dict, message: str
) -> None:
    with pytest.raises(UserError, match=message):
        bundle.run(tmp_path / "b.zip", root=packed.clone.root, **words)
    assert list(tmp_path.iterdir()) == []


def test_nothing_is_replaced_and_no_folder_made(packed: Packed, tmp_path: Path) -> None:
    before = packed.file.read_bytes()
    with pytest.raises(UserError, match="exists: name another file"):
        bundle.run(packed.file, root=packed.clone.root)
    assert packed.file.read_bytes() == before
    with pytest.raises(UserError, match="there is no folder"):
        bundle.run(tmp_path / "no" / "b.zip", root=packed.clone.root)


def test_without_git_or_a_repository_it_is_said(
    packed: Packed, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(UserError, match="is in no git repository"):
        bundle.run(tmp_path / "b.zip", root=tmp_path)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(UserError, match="needs git, and there is none"):
        bundle.run(tmp_path / "b.zip", root=packed.clone.root)


def test_a_full_disk_leaves_no_half_bundle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(archive: zipfile.ZipFile, part: bundle.Part) -> Entry:
        archive.writestr(part.name, b"some")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(bundle, "add", full)
    with pytest.raises(UserError, match=r"b\.zip cannot be written: No space left on device\."):
        bundle.write(tmp_path / "b.zip", "0" * 40, [], [])
    assert list(tmp_path.iterdir()) == []


def test_names_that_another_system_cannot_have_are_not_packed(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="not every system can have a file of that name"):
        bundle.write(tmp_path / "b.zip", "0" * 40, [], [bundle.Part("models/a/b:c", b"")])


@pytest.mark.parametrize(
    ("name", "packed_already"),
    [
        *((f"photo.{ending}", True) for ending in ("png", "jpg", "jpeg")),
        *((f"archive.{ending}", True) for ending in ("whl", "bundle", "glb", "gz")),
        *((f"text.{ending}", False) for ending in ("py", "gltf", "bin")),
    ],
)
def test_what_is_compressed_already_is_stored_as_it_is(
    tmp_path: Path, name: str, packed_already: bool
) -> None:
    """To compress it once more takes time and wins nothing."""
    bundle.write(tmp_path / "b.zip", "0" * 40, [], [bundle.Part(f"{CLONE}{name}", bytes(1000))])
    with zipfile.ZipFile(tmp_path / "b.zip") as archive:
        assert (archive.getinfo(CLONE + name).compress_size == 1000) == packed_already


# --- A bundle that was changed ---


def contents(path: Path) -> dict[str, bytes]:
    with open_bundle(path) as opened:
        return {name: opened.read(name) for name in opened.manifest.files}


def test_a_changed_byte_is_found_or_changes_nothing(packed: Packed, tmp_path: Path) -> None:
    """A byte of the archive's own tables may be of no account, as the time of a file: then all is read as it was."""
    data, whole = packed.file.read_bytes(), contents(packed.file)
    changed, found = tmp_path / "changed.zip", 0
    step = len(data) // 97
    for place in range(step // 2, len(data), step):
        changed.write_bytes(data[:place] + bytes([data[place] ^ 0x55]) + data[place + 1 :])
        try:
            read = contents(changed)
        except SetupError:
            found += 1
        else:
            assert read == whole
    assert found > 60


def test_a_truncated_file_is_refused_and_nothing_written(packed: Packed, tmp_path: Path) -> None:
    data = packed.file.read_bytes()
    cut = tmp_path / "cut.zip"
    for length in (0, 1, 100, len(data) // 2, len(data) - 300, len(data) - 1):
        cut.write_bytes(data[:length])
        assert "no whole bundle" in refusal(cut)
    assert offline.main(cut, [str(tmp_path / "clone")]) == 2
    assert os.listdir(tmp_path) == ["cut.zip"]


@pytest.mark.parametrize(
    "name",
    [
        "../evil",
        "clone/../../evil",
        "/tmp/evil",
        "C:/evil",
        "clone\\..\\evil",
        "a//b",
        "./a",
        "models/x/CON:",
    ],
)
def test_a_path_that_leads_elsewhere_is_refused(packed: Packed, tmp_path: Path, name: str) -> None:
    def add(files: dict[str, bytes]) -> None:
        files[name] = b"evil"
        manifest = json.loads(files[MANIFEST])
        manifest["files"][name] = {"size": 4, "sha256": "0" * 64}
        files[MANIFEST] = json.dumps(manifest).encode()

    evil = rewritten(packed, tmp_path / "evil.zip", add)
    assert "would not lie in the folder" in refusal(evil)
    assert offline.main(evil, [str(tmp_path / "clone")]) == 2
    assert os.listdir(tmp_path) == ["evil.zip"]


def test_files_that_the_manifest_lacks_or_has_too_many_of_are_refused(packed: Packed, tmp_path: Path) -> None:
    more = rewritten(packed, tmp_path / "more.zip", lambda files: files.update({"clone/more": b""}))
    assert "not those of manifest.json" in refusal(more)
    less = rewritten(packed, tmp_path / "less.zip", lambda files: files.pop("clone/strata"))
    assert "not those of manifest.json" in refusal(less)
    none = rewritten(packed, tmp_path / "none.zip", lambda files: files.pop(MANIFEST))
    assert "has no manifest.json" in refusal(none)
    other = rewritten(
        packed, tmp_path / "other.zip", lambda files: files.update({"clone/strata": b"rm -rf /"})
    )
    assert "clone/strata was changed" in refusal(other)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda m: m.update(format=2), "of format 2, and this Strata reads format 1"),
        (lambda m: m.pop("format"), "not in its format"),
        (lambda m: m.update(files=3), "not in its format"),
        (lambda m: m["files"].update(strata=None), "not in its format"),
        (lambda m: m["targets"][0].update(wheels=["../x"]), "not in its format"),
        (lambda m: m["targets"][0].update(python="3"), "not in its format"),
        (lambda m: m["targets"].append(7), "not in its format"),
    ],
)
def test_another_manifest_is_refused(
    packed: Packed, tmp_path: Path, change: Callable[[dict], None], message: str
) -> None:
    assert message in refusal(retold(packed, tmp_path / "b.zip", change))


def test_what_is_no_bundle_is_said(tmp_path: Path) -> None:
    assert "There is no file" in refusal(tmp_path / "missing.zip")
    assert "cannot be read as a bundle" in refusal(tmp_path)
    text = tmp_path / "thesis.txt"
    text.write_text("Chapter 1")
    assert "no whole bundle" in refusal(text)
    with zipfile.ZipFile(tmp_path / "other.zip", "w") as archive:
        archive.writestr("a", "b")
    assert "has no manifest.json" in refusal(tmp_path / "other.zip")


# --- The clone out of it ---


def test_a_folder_that_holds_something_is_left_alone(
    packed: Packed, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.txt").touch()
    assert offline.main(packed.file, [str(tmp_path / "full")]) == 2
    assert "is no empty folder" in capsys.readouterr().err
    (tmp_path / "empty").mkdir()
    assert offline.main(packed.file, [str(tmp_path / "empty")]) == 0
    assert (tmp_path / "empty" / "strata").is_file()
    assert sorted(os.listdir(tmp_path)) == ["empty", "full"]
    for words in ([], ["--help"], ["a", "b"]):
        assert offline.main(packed.file, words) == 2
        assert "FOLDER` unpacks" in capsys.readouterr().err


def test_without_git_the_files_come_without_their_history(
    packed: Packed, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    assert offline.main(packed.file, [str(tmp_path / "clone")]) == 0
    assert "no history (git is not installed)" in capsys.readouterr().err
    assert (tmp_path / "clone" / "strata").is_file()
    assert not (tmp_path / "clone" / ".git").exists()


def test_a_disk_without_room_is_said_before_anything_is_written(
    packed: Packed, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reading, "free_bytes", lambda folder: 1000)
    with pytest.raises(SetupError, match="has 0 MB of room and"):
        offline.unpack_clone(packed.file, tmp_path / "a" / "clone")
    assert list(tmp_path.iterdir()) == []


def test_a_disk_that_gets_full_leaves_nothing_half(
    packed: Packed, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = Path.open

    def full(path: Path, mode: str = "r", *more: object) -> object:
        if path.name == "requirements.lock" and mode == "wb":
            raise OSError(28, "No space left on device")
        return real(path, mode, *more)

    monkeypatch.setattr(Path, "open", full)
    with pytest.raises(SetupError, match="No space left on device; make room"):
        offline.unpack_clone(packed.file, tmp_path / "clone")
    assert list(tmp_path.iterdir()) == []


# --- The packages out of it ---


def test_no_bundle_is_written_that_could_not_be_set_up_from(
    packed: Packed, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bundle.wheels, "fetch", lambda *_: Fetched((), ("Tiny",)))
    with pytest.raises(UserError, match=r"Python 3\.99 there are no wheels of Tiny, without which Strata"):
        bundle.run(tmp_path / "b.zip", pythons=["3.99"], root=packed.clone.root)
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def supplied(packed: Packed, tmp_path: Path) -> Callable[..., Supply]:
    """Return which packages `--from` would give pip in the clone, with a bundle or with a changed one."""

    def ask(change: Callable[[dict], None] | None = None, everything: bool = False) -> Supply:
        file = retold(packed, tmp_path / "b.zip", change) if change else packed.file
        clone = Environment(packed.clone.root)
        with offline.opened(str(file), clone, everything) as found, found.packages(lambda _: None) as supply:
            names = sorted(path.name for path in supply.folder.iterdir())
            return Supply(Path(*names), supply.left_out)

    return ask


def test_only_the_wheels_for_this_system_are_given(supplied: Callable[..., Supply]) -> None:
    assert supplied() == Supply(Path("tiny-1-py3-none-any.whl"))
    lacks = lambda m: m["targets"][0].update(packages="all", lacks=["small"])  # noqa: E731
    assert supplied(lacks, everything=True).left_out == ("small",)


@pytest.mark.parametrize(
    ("target", "message"),
    [
        (
            {"system": "beos"},
            f"has packages for beos with Python {PYTHON}, and this is .* with Python {PYTHON}: make",
        ),
        ({"python": "3.99"}, r"with Python 3\.99, and this is"),
        ({"lacks": ["tiny"]}, "there are no wheels of tiny"),
    ],
)
def test_a_bundle_for_another_system_or_python_is_refused(
    supplied: Callable[..., Supply], target: dict, message: str
) -> None:
    with pytest.raises(SetupError, match=message):
        supplied(lambda m: m["targets"][0].update(target))


def test_all_extras_do_not_come_from_a_bundle_of_the_core(supplied: Callable[..., Supply]) -> None:
    with pytest.raises(SetupError, match="make it by `strata bundle FILE --extras`"):
        supplied(everything=True)


def test_a_clone_with_another_lock_is_refused(packed: Packed, tmp_path: Path) -> None:
    shutil.copytree(packed.clone.root, tmp_path / "a clone")
    clone = Clone(tmp_path / "a clone", packed.clone.wheels)
    clone.write_lock(2)
    opened = offline.opened(str(packed.file), Environment(clone.root), False)
    with (
        pytest.raises(SetupError, match=r"requirements\.lock is another: take the clone that is in it"),
        opened,
    ):
        pass


def test_what_lies_in_the_place_of_a_model_stays(packed: Packed, tmp_path: Path) -> None:
    shutil.copytree(packed.clone.root, tmp_path / "clone", ignore=shutil.ignore_patterns("out", ".git"))
    mine = tmp_path / "clone" / "out" / "models" / "duck"
    mine.mkdir(parents=True)
    said: list[str] = []
    with offline.opened(str(packed.file), Environment(tmp_path / "clone"), False) as found:
        found.place_the_rest(said.append)
    assert list(mine.iterdir()) == []
    assert said == ["From the bundle: out/site/index.html."]


@pytest.mark.skipif(sys.platform == "win32", reason="programs of a shell stand in for Python")
def test_a_python_that_the_bundle_has_packages_for_is_found(
    packed: Packed, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = str(retold(packed, tmp_path / "b.zip", lambda m: m["targets"][0].update(python="3.77")))
    clone = Environment(tmp_path / "clone")
    monkeypatch.setenv("PATH", str(tmp_path))
    assert offline.other_python(file, clone) is None
    python = tmp_path / "python3.77"
    python.write_text("#!/bin/sh\nexit 127\n")  # as that of a version manager which has not got it
    python.chmod(0o755)
    assert offline.other_python(file, clone) is None
    python.write_text("#!/bin/sh\n")
    assert offline.other_python(file, clone) == [str(python)]
    assert offline.other_python(str(packed.file), clone) is None
    assert offline.other_python(None, clone) is None
    clone.python.parent.mkdir(parents=True)
    clone.python.touch()  # what packages go to is decided
    assert offline.other_python(file, clone) is None


def test_history_that_git_refuses_leaves_the_files(packed: Packed, tmp_path: Path) -> None:
    def spoil(files: dict[str, bytes]) -> None:
        files[HISTORY] = b"# v2 git bundle\nno\n"
        manifest = json.loads(files[MANIFEST])
        digest = reading.hashlib.sha256(files[HISTORY]).hexdigest()
        manifest["files"][HISTORY].update(size=len(files[HISTORY]), sha256=digest)
        files[MANIFEST] = json.dumps(manifest).encode()

    offline.unpack_clone(rewritten(packed, tmp_path / "b.zip", spoil), tmp_path / "clone")
    assert (tmp_path / "clone" / "strata").is_file()
    assert not (tmp_path / "clone" / ".git").exists()
