"""How `strata reference` ends where it cannot go on: pictures that are too large, places that take no file, signals."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

import chapters
from backends.vulkan import api as vk
from backends.vulkan.device import Device
from chapters import scenes
from common.errors import UserError
from common.paths import ROOT
from tools.reference import tracing

pytestmark = pytest.mark.feature("path-tracer/accumulation")

SMALL = ("--scene", "cornell", "--size", "16x12")


@pytest.fixture
def kept(tmp_path_factory, monkeypatch):
    """Keep sums in a folder of the test: return it."""
    folder = tmp_path_factory.mktemp("references")
    monkeypatch.setattr(tracing, "cache_dir", lambda name: folder)
    return folder


# --- too large ---


def test_a_picture_whose_sums_do_not_fit_is_refused_before_anything_is_opened(strata, tmp_path, monkeypatch):
    """16384x16384 pixels: twice 6 sums of 64 bits, and 6 of 32 bits, are 30 GiB."""

    def opened(*words, **options):
        raise AssertionError("a renderer is opened")

    monkeypatch.setattr(chapters, "open", opened)
    monkeypatch.setattr(tracing, "free_memory", lambda: (30 << 30) - 1)
    code, out, err = strata("reference", 12, "--scene", "cornell", "--size", "16384x16384", "--out", "a.png")
    assert (code, out) == (2, "")
    assert err == (
        "strata: A reference of 16384x16384 pixels is too large: its sums take 30.0 GiB of memory, and 30.0 GiB are "
        "free. A smaller --size needs less.\n"
    )
    (tmp_path / "s.toml").write_text('chapter = 12\nscene = "cornell"\nsize = "16384x16384"\n')
    code, out, err = strata("reference", "--sweep", "s.toml", "--workers", 0)
    assert (code, out) == (2, "") and "too large" in err and err.count("\n") == 1
    with pytest.raises(UserError, match="too large"):
        tracing.reference(12, scenes.load("cornell"), size=(16384, 16384))
    for free in (30 << 30, None):  # None: the system does not say
        monkeypatch.setattr(tracing, "free_memory", lambda free=free: free)
        tracing.check_room((16384, 16384))


@pytest.mark.parametrize("command", ["reference", "run"])
def test_memory_that_the_device_refuses_is_one_sentence_and_nothing_is_left(
    strata, kept, tmp_path, monkeypatch, command
):
    """The image is made, and has no memory: so software drivers refuse more than 2 GiB."""
    refuse(monkeypatch, width=16)
    code, out, err = strata(command, 12, *SMALL, "--backend", "vulkan", "--out", "a.png")
    assert (code, out) == (2, "")
    last = err.splitlines()[-1]
    assert last.startswith("strata: There is no memory on the device for '") and "of 16x12 pixels" in last
    assert "a smaller --size or scene needs less" in last and "File" not in err and "outlived" not in err
    assert not [*tmp_path.iterdir()] and not [*kept.iterdir()]


def test_a_reference_without_memory_costs_a_sweep_nothing_else(strata, kept, tmp_path, monkeypatch):
    """The device is closed with what the lack of memory left, and the next reference has another one.

    Of the second reference the last of the copies for the CPU finds none, when all others are there.
    """
    create, check, made, opened = Device.create, vk.check, [""], []

    def created(device, call, info, *rest):
        made[0] = str(rest[-1]) if call == "vkCreateBuffer" else ""
        return create(device, call, info, *rest)

    def checked(code, call, *arguments):
        if call == "vkBindBufferMemory" and made[0] == "path_squares, slot 1":
            opened.append(made[0])
            code = vk.VK_ERROR_OUT_OF_DEVICE_MEMORY if len(opened) == 2 else code
        return check(code, call, *arguments)

    monkeypatch.setattr(Device, "create", created)
    monkeypatch.setattr(vk, "check", checked)
    (tmp_path / "s.toml").write_text(
        'chapter = 12\nscene = "cornell"\nsize = ["24x12", "16x12", "8x12"]\npaths = 1\nformat = "npy"\n'
    )
    words = ("--backend", "vulkan", "--workers", 0, "--out", "a")
    code, _, err = strata("reference", "--sweep", "s.toml", *words)
    assert len(opened) == 3 and code == 2, err
    assert "There is no memory on the device for '" in err and "outlived" not in err, err
    assert {path.stem.rpartition("-")[2] for path in (tmp_path / "a").glob("*.npy")} == {"24x12", "8x12"}


def refuse(monkeypatch, width):
    """Have no device memory for images that are so wide."""
    create, check, widths = Device.create, vk.check, []

    def created(device, call, info, *rest):
        if call == "vkCreateImage":
            widths.append(info.extent.width)
        return create(device, call, info, *rest)

    def checked(code, call, *arguments):
        is_refused = call == "vkBindImageMemory" and widths[-1] == width
        return check(vk.VK_ERROR_OUT_OF_DEVICE_MEMORY if is_refused else code, call, *arguments)

    monkeypatch.setattr(Device, "create", created)
    monkeypatch.setattr(vk, "check", checked)


# --- places that take no file ---

PIPE, LOOP, PROC = "pipe.png", "loop.png", "/proc/x.png"


@pytest.fixture
def places(tmp_path, monkeypatch):
    """Make a pipe, links that lead to each other and to /dev/null, and a sweep; fail where a renderer is opened."""
    for suffix in ("png", "npz", "webp"):
        os.mkfifo(tmp_path / f"pipe.{suffix}")
        (tmp_path / f"loop.{suffix}").symlink_to(f"loop.{suffix}")
    (tmp_path / "null.png").symlink_to(os.devnull)
    (tmp_path / "null.npz").symlink_to(os.devnull)
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "folder" / "sweep.csv")
    (tmp_path / "s.toml").write_text('chapter = 12\nscene = "cornell"\nsize = "16x12"\nformat = "npy"\n')

    def opened(*words, **options):
        raise AssertionError("a renderer is opened")

    with monkeypatch.context() as patched:
        patched.setattr(chapters, "open", opened)
        yield tmp_path


@pytest.mark.skipif(
    sys.platform != "linux", reason="pipes with names, and a folder in which no file can be made"
)
@pytest.mark.parametrize(
    ("words", "says"),
    [
        *(
            ((*command, "--out", out), f"{out} cannot be written: {why}")
            for command in (("reference", 12), ("run", 12))
            for out, why in (
                (PIPE, "it is a pipe"),
                (LOOP, "Too many levels of symbolic links"),
                (PROC, "no file can be made in /proc"),
            )
        ),
        (("run", 12, "--path", "orbit", "--out", "pipe.webp"), "pipe.webp cannot be written: it is a pipe"),
        (("run", 12, "--path", "orbit", "--out", "/proc"), "no file can be made in /proc"),
        (("reference", 12, "--sums", "pipe.npz"), "--sums pipe.npz cannot be written: it is a pipe"),
        (("reference", 12, "--sums", "loop.npz"), "--sums loop.npz cannot be written: Too many levels"),
        (
            ("reference", 12, "--sums", "/proc/x.npz"),
            "--sums /proc/x.npz cannot be written: no file can be made",
        ),
        (("reference", 12, "--sums", "null.npz"), "--sums null.npz is a device, and keeps nothing"),
        (
            ("reference", "--sweep", "s.toml", "--out", "/proc"),
            "--out /proc cannot be written: no file can be made",
        ),
        (
            ("reference", "--sweep", "s.toml", "--out", "/proc/x"),
            "--out /proc/x cannot be written: no file can",
        ),
        (("reference", "--sweep", "s.toml", "--out", "loop.png"), "--out loop.png is no folder"),
        (
            ("reference", "--sweep", "s.toml", "--out", "folder"),
            "folder/sweep.csv cannot be written: it is a pipe",
        ),
    ],
)
def test_a_place_that_takes_no_file_is_refused_before_anything_is_traced(strata, kept, places, words, says):
    before = sorted(os.walk(places))
    words = words if "--sweep" in words else (*words, *SMALL)
    code, out, err = strata(*words, *(() if "--out" in words else ("--out", "a.png")))
    assert (code, out) == (2, "") and says in err and err.count("\n") == 1
    assert sorted(os.walk(places)) == before and (places / "loop.npz").is_symlink()


@pytest.mark.parametrize("command", ["reference", "run"])
@pytest.mark.usefixtures("kept")
def test_without_out_a_file_in_the_place_of_the_folder_is_seen_at_once(strata, tmp_path, command):
    (tmp_path / "out").write_text("mine")
    code, out, err = strata(command, 12, *SMALL)
    assert (code, out) == (2, "") and err.count("\n") == 1
    assert "Nothing can be written to" in err and "out is no folder; say --out FILE.png" in err
    assert (tmp_path / "out").read_text() == "mine"


@pytest.mark.skipif(sys.platform == "win32", reason="there is no /dev/null")
def test_a_picture_may_go_to_dev_null(strata, kept, tmp_path):
    (tmp_path / "null.png").symlink_to(os.devnull)
    code, _, err = strata("reference", 12, *SMALL, "--paths", 1, "--out", "null.png")
    assert code == 0 and "wrote null.png" in err
    assert (tmp_path / "null.png").is_symlink() and os.path.exists(os.devnull)


# --- signals ---

ENDED = """
import os, signal, sys
from chapters.__main__ import run
from tools.reference import tracing
told, left = tracing._Speed.told, [20]
def after(*words):
    left[0] -= 1
    if left[0] == 0:
        os.kill(os.getpid(), signal.SIGTERM)
    return told(*words)
tracing._Speed.told = after
sys.exit(run(sys.argv[1:]))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="there no signal asks a program to end")
def test_sigterm_keeps_the_sums_as_ctrl_c_does(strata, tmp_path):
    """Clusters and CI end programs by it."""
    words = ("reference", "1", *SMALL, "--error", "0", "--paths", "24", "--out", "a.npy", "--sums", "s.npz")
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-P", "-c", ENDED, *words],
        capture_output=True,
        text=True,
        env=environment,
        timeout=120,
        check=False,
    )
    assert done.returncode == 143 and done.stdout == ""
    assert done.stderr.splitlines()[-2:] == [
        "strata: 20 paths a pixel traced and kept in s.npz.",
        "strata: stopped.",
    ]
    assert [path.name for path in tmp_path.iterdir()] == ["s.npz"]
    code, _, err = strata(*words)
    assert code == 0 and "24 paths a pixel, 20 of them traced before" in err


# --- fewer paths than there are ---


def test_fewer_paths_than_there_are_is_said_in_a_plain_sentence(strata, kept):
    words = ("reference", 1, *SMALL, "--out", "a.npy", "--error")
    code, _, err = strata(*words, 0, "--paths", 24)
    assert code == 0 and "24 paths a pixel, estimated" in err and "--paths 24 allows no more" in err
    code, _, err = strata(*words, 0.01, "--paths", 1)
    assert code == 0 and "24 paths a pixel, all traced before" in err and "allows no more" not in err
    assert (
        "strata: the estimated error is not yet 0.01, and 24 paths a pixel are there already, more than --paths 1 asks "
        "for: with a number above 24 the same command goes on.\n"
    ) in err
    code, _, err = strata(*words, 1, "--paths", 1)  # an error that is reached
    assert code == 0 and "not yet" not in err
    code, _, err = strata(*words, 0.01, "--paths", 25)
    assert (
        code == 0
        and "25 paths a pixel, 24 of them traced before" in err
        and "--paths 25 allows no more" in err
    )
