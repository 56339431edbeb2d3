"""What is printed, and to whom: narrow terminals, closed and full streams, readers that go away, odd file names."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from common.paths import ROOT
from tools.cli.console import shown

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="redirections are those of a POSIX shell")


def shell(line: str, cwd: Path, **variables: str) -> subprocess.CompletedProcess[bytes]:
    """Run a line of bash in which `strata` is the command line; its exit code is that of the last `strata`."""
    script = f'strata() {{ "{sys.executable}" -P -m chapters "$@"; }}; {line}; exit ${{PIPESTATUS[0]}}'
    environment = {**os.environ, "PYTHONPATH": str(ROOT), **variables}
    environment.pop("PYTHONUNBUFFERED", None)  # where it is set, less is left to be flushed at exit
    return subprocess.run(["bash", "-c", script], cwd=cwd, env=environment, capture_output=True, check=False)


@pytest.mark.parametrize("columns", ["0", "1", "9999999"])
@pytest.mark.parametrize("words", ["run --help", "list 1 --settings"], ids=["help", "table"])
def test_whatever_the_width_tables_and_help_can_be_read(tmp_path, columns, words):
    done = shell(f"strata {words}", tmp_path, COLUMNS=columns)
    assert done.returncode == 0 and not done.stderr
    text = done.stdout.decode()
    assert "anisotropy" in text or "--environment" in text  # names are not broken
    assert 50 <= max(len(line) for line in text.splitlines()) <= 400


@pytest.mark.parametrize("words", ["list", "--help", "doctor --json"])
def test_a_closed_stdout_is_one_sentence(tmp_path, words):
    done = shell(f"strata {words} >&-", tmp_path)
    assert done.returncode == 2
    said = done.stderr.splitlines()
    assert said[-1] == b"strata: The result cannot be printed: stdout is closed."
    assert all(
        line.startswith(b"strata: still busy") for line in said[:-1]
    )  # on a machine that takes long to answer


def test_who_prints_nothing_needs_no_stdout(tmp_path, vulkan_instance):
    done = shell("strata run 1 --scene cornell --size 16x16 --headless --out a.png >&-", tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "a.png").is_file()


def test_a_closed_stderr_is_no_error(tmp_path):
    assert shell("strata list 2>&-", tmp_path).returncode == 0
    assert shell("strata lst 2>&-", tmp_path).returncode == 2


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
@pytest.mark.parametrize("words", ["list", "--version"])
def test_a_full_disk_is_one_sentence(tmp_path, words):
    done = shell(f"strata {words} >/dev/full", tmp_path)
    assert done.returncode == 2
    assert done.stderr == b"strata: No space left on device.\n"


@pytest.mark.parametrize("words", ["list", "--help"])
def test_a_reader_that_goes_away_ends_it_as_it_ends_other_programs(tmp_path, words):
    done = shell(f"strata {words} | true", tmp_path)
    assert done.returncode == 141
    assert not done.stderr


def test_a_file_name_that_is_no_utf8_is_printed(tmp_path):
    name = os.fsdecode(b"b\xff")
    done = shell(f"strata run 1 --scene {name}.gltf", tmp_path)
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1] == b"strata: There is no file b\\xff.gltf."
    assert shown(f"{name} é") == "b\\xff é"


def test_a_folder_that_is_no_utf8_is_printed_to_a_strict_stdout(tmp_path):
    variables = {"STRATA_CACHE": os.fsdecode(os.fsencode(tmp_path) + b"/c\xff")}
    done = shell("strata doctor", tmp_path, **variables, PYTHONIOENCODING="utf-8:strict", COLUMNS="300")
    assert b"Traceback" not in done.stderr and b"Error" not in done.stderr
    assert b"c\\udcff" in done.stdout or b"c\\xff" in done.stdout


def test_help_shows_no_value_for_a_flag_and_every_kind_of_scene(strata, monkeypatch):
    monkeypatch.setenv("COLUMNS", "120")
    for words in ("--help", "run --help"):
        text = strata(*words.split())[1]
        assert "--help" in text and "bool" not in text.lower()
        if words == "run --help":
            assert ".obj" in text
    assert ".obj" in strata("list", "--scenes")[1]


def test_a_record_can_be_printed_and_all_else_goes_to_stderr(strata, tmp_path):
    words = "run 1 --scene cornell --size 16x16 --headless --out a.png -v"
    done = shell(f"strata {words} --json -", tmp_path)  # in a child: what libraries print is seen, too
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["size"] == [16, 16]
    assert b"Milliseconds" in done.stderr and b"a.png" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["a.png"]
    code, out, _ = strata(*words.split(), "--json", "/dev/null")
    assert code == 0 and "Milliseconds" in out


def test_a_cache_that_cannot_be_written_is_said(strata, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("a file where the folder should be")
    monkeypatch.setenv("STRATA_CACHE", str(tmp_path / "file"))
    words = ["run", "1", "--scene", "cornell", "--size", "16x16", "--out", str(tmp_path / "a.png")]
    for verbose, said in (([], 0), (["-v"], 1)):
        code, _, err = strata(*words, "--headless", *verbose)
        assert code == 0 and err.count("file cannot be written (File exists)") == said
    # In a child: a name is taken from the folder in which the process began.
    found = json.loads(shell("strata doctor --json", tmp_path, STRATA_CACHE="file/x").stdout)["strata"]
    assert found["cache"] == str(tmp_path / "file" / "x")
    assert "cannot be written (Not a directory)" in found["cache_problem"]
