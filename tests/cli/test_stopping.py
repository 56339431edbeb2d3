"""Ctrl-C and SIGTERM: one line, exit code 130 or 143, soon, and no half-written file, whatever the program is doing."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest

from chapters.__main__ import run
from common.paths import ROOT
from tools.cli import stopping
from tools.cli.stopping import prompt_stop
from tools.run import run as running

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals are sent as on POSIX")

BUSY = """
import hashlib, os
from pathlib import Path
from tools.cli.stopping import prompt_stop
from common.paths import temporary_folder, write_whole

def kept():
    begun = any(path.name.startswith(".a.png") for path in Path().iterdir())  # what is begun may still be finished
    Path("kept").write_text(f"{begun}")
    return "what came is kept."

with prompt_stop(kept), temporary_folder() as folder:
    (folder / "part").write_bytes(b"half")
    print(folder, flush=True)
    real = os.replace
    def slow(*paths):
        print("ready", flush=True)
        hashlib.pbkdf2_hmac("sha256", b"a", b"b", 40_000_000)  # one call of C, which takes 10 s
        real(*paths)
    os.replace = slow
    write_whole(Path("a.png"), b"whole")
"""


@pytest.mark.parametrize(("sent", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_long_call_of_c_is_not_waited_for_and_no_half_written_file_is_left(tmp_path, sent, code):
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    process = subprocess.Popen(
        [sys.executable, "-P", "-c", BUSY],
        cwd=tmp_path,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    folder = process.stdout.readline().strip()
    assert process.stdout.readline() == "ready\n"
    time.sleep(0.3)  # until the call has begun, on a busy machine, too
    began = time.perf_counter()
    process.send_signal(sent)
    _, err = process.communicate(timeout=60)
    assert time.perf_counter() - began < 2.5
    assert process.returncode == code
    assert err == "what came is kept.\nstrata: stopped.\n"
    assert [path.name for path in tmp_path.iterdir()] == ["kept"] and not os.path.exists(folder)
    assert (tmp_path / "kept").read_text() == "True"


def test_ctrl_c_is_one_line(monkeypatch, capsys, tmp_path):
    def stopped(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(running, "draw", stopped)
    assert run(["run", "1", "--headless", "--out", str(tmp_path / "a.png")]) == 130
    lines = capsys.readouterr().err.splitlines()
    assert lines[-1] == "strata: stopped."
    assert all(
        line.startswith("strata: drawing with OpenGL") for line in lines[:-1]
    )  # where Vulkan is missing


def test_sigterm_raises_what_ctrl_c_raises_and_only_inside():
    def ended():
        with prompt_stop():
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(10.0)

    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    with pytest.raises(KeyboardInterrupt):
        ended()
    assert stopping.stop_code() == 143
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    with prompt_stop():
        pass
    assert stopping.stop_code() == 130


def test_sigterm_is_left_to_a_handler_that_is_there(monkeypatch):
    came = []
    before = signal.signal(signal.SIGTERM, lambda number, frame: came.append(number))
    ends = []
    monkeypatch.setattr(stopping, "GRACE_S", 0.02)
    monkeypatch.setattr(stopping, "_end", lambda *words: ends.append(words))
    try:
        with prompt_stop():
            mine = signal.getsignal(signal.SIGTERM)
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(0.3)
        assert came == [signal.SIGTERM] and signal.getsignal(signal.SIGTERM) is mine and not ends
    finally:
        signal.signal(signal.SIGTERM, before)
