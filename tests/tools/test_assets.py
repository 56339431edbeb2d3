"""Models of others: the manifest that pins them, and files that are taken whole or not at all, from a local server."""

from __future__ import annotations

import errno
import hashlib
import io
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path
from types import SimpleNamespace

import pytest

from bootstrap.environment import try_lock
from chapters import scenes
from common.errors import SceneError, UserError
from common.models import store
from common.models.manifest import LICENCES, MANIFEST, SOURCES, is_name, read_manifest
from common.paths import ROOT, asset_dir
from tests.support.file_server import serving
from tests.support.timing import PATIENCE_S
from tools.assets import command
from tools.assets import fetch as asset_fetch
from tools.assets.fetch import fetch

COMMIT = "0123456789abcdef0123456789abcdef01234567"
MAIN = b'{"asset": {"version": "2.0"}}' + b" " * 3000
DATA = bytes(range(256)) * 40
FILES = {"Duo.gltf": MAIN, "deep/data.bin": DATA}
FOLDER = f"they/models/{COMMIT}/Models/Duo"


def entry(**changes: object) -> str:
    """Return the manifest of one model of two files; `changes` replace its entries, None leaves one out."""
    listed = [
        f'{{ name = "{name}", size = {len(data)}, sha256 = "{hashlib.sha256(data).hexdigest()}" }}'
        for name, data in FILES.items()
    ]
    fields = {
        "name": '"Duo"',
        "title": '"Two files"',
        "source": '"local"',
        "repository": '"they/models"',
        "commit": f'"{COMMIT}"',
        "folder": '"Models/Duo"',
        "main": '"Duo.gltf"',
        "author": '"Somebody"',
        "year": "2020",
        "licence": '"CC-BY-4.0"',
        "files": f"[{', '.join(listed)}]",
        **changes,
    }
    return "[[model]]\n" + "".join(f"{name} = {text}\n" for name, text in fields.items() if text is not None)


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """An empty cache, and no proxy between here and the local server."""
    monkeypatch.setenv("STRATA_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("no_proxy", "127.0.0.1")
    return tmp_path / "cache"


@pytest.fixture
def server(cache):
    with serving({f"{FOLDER}/{name}": data for name, data in FILES.items()}) as running:
        yield running


@pytest.fixture
def manifest(tmp_path):
    path = tmp_path / "models.toml"
    path.write_text(entry(), "utf-8")
    return path


@pytest.fixture
def sources(server):
    return {"local": server.address + "/{repository}/{commit}/{path}"}


@pytest.fixture
def model(manifest, sources):
    return read_manifest(manifest, sources)["Duo"]


def lying(model) -> dict[str, bytes]:
    """Return the files of a model that are here, without the lock."""
    folder = store.folder_of(model)
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and path.name != ".lock"
    }


def test_the_manifest_of_the_clone_is_right_and_its_licences_are_known():
    models = read_manifest()
    assert models
    for model in models.values():
        assert model.licence in LICENCES and is_name(model.name)
        for file in model.files:
            url = model.url(file)
            assert url.startswith("https://") and model.commit in url and url.endswith(file.name)


def test_what_the_manifest_pins_are_the_bytes_of_the_models_at_hand():
    """The hashes were computed from these copies; where they lie, they are held to it."""
    folder = asset_dir()
    if folder is None:
        pytest.skip("no folder of assets made elsewhere (STRATA_ASSETS)")
    held = 0
    for model in read_manifest().values():
        for file in model.files:
            path = folder / "models" / model.name / file.name
            if path.is_file():
                assert store.is_whole(path, file), path
                held += 1
    assert held


@pytest.mark.feature("assets/manifest")
def test_a_second_run_downloads_nothing(server, sources, manifest, model, capsys):
    assert command.get(["duo"], True, manifest, sources) == 0
    assert lying(model) | {"NOTICE.txt": b""} == {**FILES, "NOTICE.txt": b""}
    assert len(server.asked) == 2 and server.sent == len(MAIN) + len(DATA)
    first = capsys.readouterr()
    assert Path(first.out.strip()).read_bytes() == MAIN
    assert (
        command.get(["Duo"], False, manifest, sources) == 0
    )  # nobody is asked: there is nothing to agree to
    assert len(server.asked) == 2
    assert capsys.readouterr().out == first.out
    assert fetch(model, sources=sources) == 0


@pytest.mark.feature("assets/manifest")
@pytest.mark.parametrize("where", ["first", "last"])
def test_a_wrong_hash_is_rejected(server, sources, model, where):
    """One byte is another, the size is right: nothing of it stays, under whatever name."""
    path = f"{FOLDER}/deep/data.bin"
    wrong = bytearray(DATA)
    wrong[0 if where == "first" else -1] ^= 1
    server.files[path] = bytes(wrong)
    with pytest.raises(UserError, match=r"data\.bin from 127\.0\.0\.1 is not the file of the manifest"):
        fetch(model, sources=sources)
    assert lying(model) == {"Duo.gltf": MAIN}
    assert not store.is_here(model)
    server.files[path] = DATA
    assert fetch(model, sources=sources) == len(DATA)
    assert lying(model) == FILES


@pytest.mark.feature("assets/manifest")
def test_an_unknown_source_type_is_rejected(tmp_path):
    path = tmp_path / "models.toml"
    path.write_text(entry(source='"gitbuh"'), "utf-8")
    with pytest.raises(
        UserError, match=r"model 1 \(Duo\): there is no type of source 'gitbuh'; did you mean 'github'"
    ):
        read_manifest(path)
    path.write_text(entry(source='"ftp"'), "utf-8")
    with pytest.raises(UserError, match="no type of source 'ftp'; known are 'github'"):
        command.get(["Duo"], True, path)


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"commit": '"main"'}, "commit = 'main' is none"),
        ({"commit": None}, "commit is missing"),
        ({"colour": '"red"'}, "colour is no entry of a model"),
        ({"licence": '"MINE"'}, "the licence 'MINE' is not known"),
        ({"year": '"2020"'}, "year = '2020' is none"),
        ({"name": '"a/b"'}, "name = 'a/b' is none"),
        ({"folder": '"Models/../.."'}, "leads out of the repository"),
        ({"main": '"Other.gltf"'}, "is not among the files"),
        ({"main": '"deep/data.bin"'}, "is no .gltf or .glb file"),
        ({"files": "[]"}, "files is not a list of files"),
        ({"files": '[{ name = "Duo.gltf", size = 1 }]'}, "a file has name, size and sha256"),
        ({"files": '[{ name = "Duo.gltf", size = 0, sha256 = "" }]'}, "is no number of bytes"),
        ({"files": '[{ name = "Duo.gltf", size = 1, sha256 = "0" }]'}, "sha256 = '0' of Duo.gltf is none"),
        *(
            ({"files": f'[{{ name = {name}, size = 1, sha256 = "" }}]'}, "outside of the model's folder")
            for name in ("'../a'", "'/a'", "'C:a'", "'a\\b'", "'a//b'", "''", "'./a'", "'..'")
        ),
    ],
)
def test_a_manifest_that_is_wrong_is_refused(tmp_path, changes, fault):
    path = tmp_path / "models.toml"
    path.write_text(entry(**changes), "utf-8")
    with pytest.raises(UserError) as raised:
        read_manifest(path, {"local": ""})
    assert fault in str(raised.value)


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("[[model]", "cannot be read"),
        ("model = 1", "something else than"),
        (entry() * 2, "two models called Duo"),
    ],
)
def test_a_manifest_of_another_form_is_refused(tmp_path, text, fault):
    path = tmp_path / "models.toml"
    path.write_text(text, "utf-8")
    with pytest.raises(UserError, match=fault):
        read_manifest(path, {"local": ""})


def test_a_file_that_was_cut_short_is_resumed(server, sources, model):
    """Only what is missing is asked for, and each part of an answer is kept."""
    server.cuts = [len(MAIN), 1000, 50]
    assert fetch(model, sources=sources, pause_s=0) == len(MAIN) + len(DATA)
    assert [wanted for _, wanted in server.asked] == [None, None, "bytes=1000-", "bytes=1050-"]
    assert server.sent == len(MAIN) + len(DATA)
    assert lying(model) == FILES


def test_what_never_goes_on_is_given_up_and_kept(server, sources, model):
    server.cuts = [100, *[0] * 20]
    with pytest.raises(
        UserError, match=r"Duo\.gltf was cut short at 100 bytes of 3\.03 kB .*goes on from there"
    ):
        fetch(model, sources=sources, pause_s=0)
    assert lying(model) == {"Duo.gltf.part": MAIN[:100]}
    assert asset_fetch.unfinished(model) == 100 and not store.is_here(model)
    server.cuts = []
    fetch(model, sources=sources)
    assert lying(model) == FILES
    assert server.asked[2][1] == "bytes=100-"


def test_a_server_without_ranges_gives_the_whole_again(server, sources, model):
    server.ranges, server.cuts = False, [len(MAIN), 1000]
    fetch(model, sources=sources, pause_s=0)
    assert server.asked[-1][1] == "bytes=1000-"
    assert server.sent == len(MAIN) + 1000 + len(DATA)
    assert lying(model) == FILES


def test_an_answer_that_begins_elsewhere_is_not_appended(server, sources, model):
    server.shift, server.cuts = -3, [len(MAIN), 1000]
    fetch(model, sources=sources, pause_s=0)
    assert [wanted for _, wanted in server.asked] == [None, None, "bytes=1000-", None]
    assert lying(model) == FILES


@pytest.mark.parametrize("length", [0, 700, 5000])
def test_a_part_of_something_else_never_becomes_a_file(server, sources, model, length):
    """Junk under the name of a part: longer than the file it is dropped, else found out by the hash."""
    folder = store.folder_of(model)
    folder.mkdir(parents=True)
    (folder / "Duo.gltf.part").write_bytes(b"x" * length)
    if length == 700:
        with pytest.raises(UserError, match="is not the file of the manifest"):
            fetch(model, sources=sources)
        assert lying(model) == {}
    fetch(model, sources=sources)
    assert lying(model) == FILES


def test_a_part_that_is_whole_is_taken_without_asking(server, sources, model):
    folder = store.folder_of(model)
    folder.mkdir(parents=True)
    (folder / "Duo.gltf.part").write_bytes(MAIN)
    assert fetch(model, sources=sources) == len(DATA)
    assert [path for path, _ in server.asked] == [f"{FOLDER}/deep/data.bin"]


def test_a_file_that_was_damaged_here_is_fetched_anew(server, sources, model):
    fetch(model, sources=sources)
    (store.folder_of(model) / "Duo.gltf").write_bytes(MAIN[:-1] + b"!")
    assert fetch(model, sources=sources) == len(MAIN)
    assert lying(model) == FILES


def test_a_shorter_or_longer_file_is_not_taken(server, sources, model):
    path = f"{FOLDER}/Duo.gltf"
    server.files[path] = MAIN[:-1]
    with pytest.raises(UserError, match="shorter than the manifest says"):
        fetch(model, sources=sources, pause_s=0)
    assert lying(model) == {}
    server.files[path] = b"{" + MAIN
    with pytest.raises(UserError, match="is not the file of the manifest"):
        fetch(model, sources=sources)
    assert lying(model) == {}


@pytest.mark.parametrize(("status", "says"), [(404, "404 Not Found"), (403, "403 Forbidden"), (503, "503")])
def test_a_server_that_refuses_is_a_sentence(server, sources, model, status, says):
    server.status = status
    with pytest.raises(UserError, match=rf"127\.0\.0\.1 answers {says}.*Duo\.gltf: try later\."):
        fetch(model, sources=sources)
    assert lying(model) == {}


def test_no_network_is_a_sentence(cache, manifest):
    with serving({}) as gone:
        address = gone.address
    sources = {"local": address + "/{repository}/{commit}/{path}"}
    with pytest.raises(UserError, match=r"127\.0\.0\.1 cannot be reached \(.*nothing else needs it"):
        fetch(read_manifest(manifest, sources)["Duo"], sources=sources)


def test_a_silent_server_is_given_up(server, sources, model, monkeypatch):
    monkeypatch.setattr(asset_fetch, "TIMEOUT_S", 0.1)
    monkeypatch.setattr(asset_fetch, "TRIES", 1)
    server.gate = threading.Event()
    with pytest.raises(UserError, match=r"cut short at 1\.51 kB of 3\.03 kB \(silent for 0\.1 s\)"):
        fetch(model, sources=sources)


def test_a_full_disk_is_a_sentence(server, sources, model, monkeypatch):
    monkeypatch.setattr(asset_fetch.shutil, "disk_usage", lambda _folder: SimpleNamespace(free=99))
    with pytest.raises(UserError, match=r"full: 13\.3 kB are needed; free some"):
        fetch(model, sources=sources)
    assert server.asked == []


def test_room_for_exactly_what_is_missing_is_enough(server, sources, model, monkeypatch):
    """Bytes of a part are here already and need no room."""
    part = store.folder_of(model) / "Duo.gltf.part"
    part.parent.mkdir(parents=True)
    part.write_bytes(MAIN[:1000])
    missing = len(MAIN) - 1000 + len(DATA)
    room = SimpleNamespace(free=missing - 1)
    monkeypatch.setattr(asset_fetch.shutil, "disk_usage", lambda _folder: room)
    with pytest.raises(UserError, match="full"):
        fetch(model, sources=sources)
    assert server.asked == []
    room.free = missing
    assert fetch(model, sources=sources) == missing and lying(model) == FILES


def test_a_disk_that_fills_up_meanwhile_is_a_sentence(server, sources, model, monkeypatch):
    class Full(io.FileIO):
        def write(self, data) -> int:
            raise OSError(errno.ENOSPC, "No space left on device")

    whole = Path.open
    monkeypatch.setattr(
        Path,
        "open",
        lambda self, mode="r", *a, **k: Full(self, "ab") if mode == "wb" else whole(self, mode, *a, **k),
    )
    with pytest.raises(UserError, match=r"The disk of .* is full"):
        fetch(model, sources=sources)
    assert not store.is_here(model)


def test_a_cache_that_cannot_be_written_is_a_sentence(tmp_path, monkeypatch, server, sources, model):
    (tmp_path / "file").write_bytes(b"")
    monkeypatch.setenv("STRATA_CACHE", str(tmp_path / "file" / "cache"))
    with pytest.raises(UserError, match=r"cannot be written .*STRATA_CACHE names another folder"):
        fetch(model, sources=sources)


def test_two_at_once_are_one(server, sources, model):
    folder = store.folder_of(model)
    folder.mkdir(parents=True)
    with open(folder / ".lock", "ab") as other:
        assert try_lock(other.fileno())
        with pytest.raises(UserError, match="Duo is being fetched by another strata"):
            fetch(model, sources=sources)
    assert server.asked == []
    fetch(model, sources=sources)


@pytest.mark.skipif(os.name == "nt", reason="a console's Ctrl-C cannot be sent to one process alone")
def test_ctrl_c_keeps_what_came(server, sources, model, manifest, cache):
    server.gate = threading.Event()
    code = (
        "import sys; from pathlib import Path; from tools.assets import command;"
        "command.get(['Duo'], True, Path(sys.argv[1]), {'local': sys.argv[2]})"
    )
    begun = subprocess.Popen(
        [sys.executable, "-c", code, str(manifest), sources["local"]],
        cwd=ROOT,
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert server.halfway.wait(PATIENCE_S)
    part = store.folder_of(model) / "Duo.gltf.part"
    while not part.is_file() or part.stat().st_size < len(MAIN) // 2:
        assert begun.poll() is None
    begun.send_signal(signal.SIGINT)
    _, said = begun.communicate(timeout=60)
    assert "1.51 kB are kept, and the same command goes on" in said
    assert (
        "KeyboardInterrupt" in said or "strata: stopped." in said
    )  # the second if the read had not begun to wait
    assert lying(model) == {"Duo.gltf.part": MAIN[: len(MAIN) // 2]}
    server.gate.set()
    server.gate = None
    assert fetch(model, sources=sources) == len(MAIN) - len(MAIN) // 2 + len(DATA)
    assert lying(model) == FILES


def test_the_licence_is_shown_before_anything_is_asked_of_the_server(
    server, sources, manifest, capsys, monkeypatch
):
    """Without a terminal nobody can agree: one sentence, which names what would."""
    monkeypatch.setattr(sys, "stdin", io.StringIO("y\n"))
    with pytest.raises(
        UserError, match=r"no terminal to ask at: \./strata assets get Duo --yes agrees to CC-BY-4\.0"
    ):
        command.get(["Duo"], False, manifest, sources)
    shown = capsys.readouterr().err
    assert "Somebody, 2020" in shown and "CC-BY-4.0: name the author" in shown
    assert LICENCES["CC-BY-4.0"][0] in shown and COMMIT[:12] in shown
    assert server.asked == []


@pytest.mark.parametrize(("answer", "code"), [("y\n", 0), ("Yes\n", 0), ("n\n", 1), ("\n", 1), ("", 1)])
def test_at_a_terminal_the_reader_is_asked(
    server, sources, manifest, model, capsys, monkeypatch, answer, code
):
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    monkeypatch.setattr(sys, "stdin", Terminal(answer))
    monkeypatch.setattr(command.err, "_force_terminal", True)
    assert command.get(["Duo"], False, manifest, sources) == code
    assert store.is_here(model) == (code == 0)
    assert ("Nothing was fetched." in capsys.readouterr().err) == (code == 1)


def test_a_notice_lies_beside_the_model(server, sources, manifest, model):
    command.get(["Duo"], True, manifest, sources)
    notice = lying(model)["NOTICE.txt"].decode()
    assert "By Somebody, 2020. CC-BY-4.0" in notice and COMMIT in notice
    (store.folder_of(model) / store.NOTICE).unlink()
    command.get(["Duo"], False, manifest, sources)
    assert lying(model)["NOTICE.txt"].decode() == notice, "it belongs to the files, and comes back to them"


def test_an_unknown_name_is_a_sentence(server, sources, manifest):
    with pytest.raises(UserError, match="There is no model 'Doe' to fetch; did you mean 'Duo'"):
        command.get(["Duo", "Doe"], True, manifest, sources)
    assert server.asked == []


def test_a_fetched_model_is_found_by_its_name(cache, monkeypatch):
    """In the manifest of the clone, with bytes of ours in the place of the model's."""
    model = read_manifest()["Box"]
    with pytest.raises(
        SceneError, match=r"Box is a model of others that is not here yet: \./strata assets get Box"
    ):
        scenes.find("box")
    folder = store.folder_of(model)
    folder.mkdir(parents=True)
    (folder / "Box.glb.part").write_bytes(bytes(model.size))
    with pytest.raises(SceneError, match="not here yet"):
        scenes.find("Box")
    (folder / "Box.glb").write_bytes(bytes(model.size - 1))
    with pytest.raises(SceneError, match="not here yet"):
        scenes.find("Box")
    (folder / "Box.glb").write_bytes(bytes(model.size))
    assert scenes.find("bOX") == folder / "Box.glb"
    assert store.remove("box") == "The files of Box were removed."
    assert not folder.exists()


def test_other_bytes_have_another_folder(tmp_path):
    """Who pins a model anew never meets the files of before."""
    path = tmp_path / "models.toml"
    path.write_text(entry(), "utf-8")
    first = read_manifest(path, {"local": ""})["Duo"]
    path.write_text(entry(commit=f'"{"f" * 40}"'), "utf-8")
    assert store.folder_of(read_manifest(path, {"local": ""})["Duo"]) == store.folder_of(first)
    path.write_text(entry(files=f'[{{ name = "Duo.gltf", size = 5, sha256 = "{"0" * 64}" }}]'), "utf-8")
    assert store.folder_of(read_manifest(path, {"local": ""})["Duo"]) != store.folder_of(first)


def test_the_address_of_a_file_is_that_of_its_commit():
    model = read_manifest(MANIFEST)["TextureTransformTest"]
    file = next(file for file in model.files if file.name == "UV.png")
    assert model.url(file) == SOURCES["github"].format(
        repository="KhronosGroup/glTF-Sample-Assets",
        commit=model.commit,
        path="Models/TextureTransformTest/glTF/UV.png",
    )


@pytest.mark.parametrize(
    ("count", "words"),
    [
        (0, "0 bytes"),
        (999, "999 bytes"),
        (1664, "1.66 kB"),
        (223376, "223 kB"),
        (999_951, "1.00 MB"),
        (3e9, "3.00 GB"),
    ],
)
def test_bytes_in_words(count, words):
    assert store.in_bytes(int(count)) == words
