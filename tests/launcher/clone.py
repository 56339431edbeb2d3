"""A small clone to start: the real launcher and bootstrap, and a command line that tells how it was called."""

from __future__ import annotations

import base64
import hashlib
import json
import os
import shutil
import subprocess
import sys
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pip

from common.paths import ROOT

COMMAND_LINE = """\
import json, os, sys, tiny
told = {"arguments": sys.argv[1:], "folder": os.getcwd(), "python": sys.executable, "process": os.getpid()}
print(json.dumps(told | {"tiny": tiny.VERSION}))
sys.exit(7 if sys.argv[1:] == ["fail"] else 0)
"""

ANSWER = """\
import pathlib, sys
folder = pathlib.Path(__file__).parent
(folder / "asked").open("a").write("asked\\n")
print((folder / "answer.json").read_text())
"""

DRAWS = {
    "vulkan": {"kind": "software", "name": "a processor"},
    "gl": {"kind": "software", "name": "a processor"},
    "auto": {"backend": "vulkan"},
    "layers": ["VK_LAYER_KHRONOS_validation"],
}
DRAWS_NOTHING = {
    "vulkan": {"problem": "No Vulkan loader was found.", "libraries": ["libvulkan.so.1"]},
    "gl": {"problem": "No OpenGL 4.5 was found.", "libraries": ["libGL.so.1"]},
    "auto": {"problem": "Nothing draws."},
    "layers": [],
}


@dataclass(frozen=True)
class Clone:
    """A clone of Strata that needs one package, `tiny`, and one more, `small`, for its extra `dev`.

    pip finds both in a folder beside the clone, and is told that there is nothing else: no test uses the network.
    """

    root: Path
    wheels: Path

    @property
    def python(self) -> Path:
        return self.root / ".venv" / "bin" / "python"

    @property
    def stamp(self) -> Path:
        return self.root / ".venv" / "strata.stamp"

    def answers(self, answer: dict[str, Any]) -> None:
        """Let the clone's program give this answer when it is asked what it draws with."""
        (self.root / "backends" / "answer.json").write_text(json.dumps(answer), "utf-8")

    def times_asked(self) -> int:
        """Return how often the clone's program was asked what it draws with."""
        asked = self.root / "backends" / "asked"
        return len(asked.read_text("utf-8").splitlines()) if asked.exists() else 0

    def write_lock(self, version: int) -> None:
        """Write the lock as a later commit may bring it: with another version of `tiny`."""
        pins = {"core": f"tiny-{version}", "dev": "small-1"}
        lock = ""
        for section, pin in pins.items():
            wheel = self.wheels / f"{pin}-py3-none-any.whl"
            digest = hashlib.sha256(wheel.read_bytes()).hexdigest()
            lock += f"# [{section}]\n{pin.replace('-', '==')} \\\n    --hash=sha256:{digest}\n"
        (self.root / "requirements.lock").write_text(lock, "utf-8")

    def environment(self, **more: str) -> dict[str, str]:
        """Return variables in which pip reaches no network, and which say nothing of CI."""
        dropped = ("PIP_", "PYTHON", "CI", "VIRTUAL_ENV")
        kept = {name: value for name, value in os.environ.items() if not name.startswith(dropped)}
        path = os.pathsep.join([os.path.dirname(sys.executable), os.environ["PATH"]])
        pip = {"PIP_CONFIG_FILE": os.devnull, "PIP_NO_INDEX": "1", "PIP_FIND_LINKS": self.wheels.as_uri()}
        return {**kept, "PATH": path, **pip, **more}

    def start(
        self,
        *arguments: str,
        launcher: str | Path = "",
        folder: Path | None = None,
        **variables: str,
    ) -> subprocess.CompletedProcess[str]:
        """Start Strata and wait for its end.

        Where the clone is not set up yet, pass "--no-install" first: as root it would change the system otherwise.
        """
        return subprocess.run(
            [launcher or self.root / "strata", *arguments],
            cwd=folder or self.root,
            env=self.environment(**variables),
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )


def make_clone(folder: Path) -> Clone:
    """Make a clone in a folder with a space in its name."""
    wheels, root = folder / "wheels", folder / "a clone"
    wheels.mkdir()
    for name, version in (("tiny", 1), ("tiny", 2), ("small", 1)):
        make_wheel(wheels, name, version)
    (root / "chapters").mkdir(parents=True)
    for file in ("strata", "strata.cmd", "pyproject.toml"):
        shutil.copy2(ROOT / file, root / file)
    shutil.copytree(ROOT / "bootstrap", root / "bootstrap", ignore=shutil.ignore_patterns("__pycache__"))
    (root / "chapters" / "__main__.py").write_text(COMMAND_LINE, "utf-8")
    (root / "backends").mkdir()
    (root / "backends" / "answer.py").write_text(ANSWER, "utf-8")
    clone = Clone(root.resolve(), wheels.resolve())
    clone.answers(DRAWS)
    clone.write_lock(1)
    return clone


def make_environment(clone: Clone) -> None:
    """Make `.venv` as somebody may by hand, which the set-up adds to; takes a twentieth of the time of one with pip."""
    subprocess.run([sys.executable, "-I", "-m", "venv", "--without-pip", clone.python.parents[1]], check=True)
    # pip comes from the Python that runs the tests, and nothing else does.
    borrowed = clone.wheels / "borrowed"
    if not borrowed.exists():
        borrowed.mkdir()
        (borrowed / "pip").symlink_to(Path(pip.__file__).parent)
    code = "import sysconfig; print(sysconfig.get_path('purelib'))"
    done = subprocess.run([clone.python, "-I", "-c", code], capture_output=True, text=True, check=True)
    Path(done.stdout.strip(), "borrowed.pth").write_text(f"{borrowed}\n", "utf-8")


def make_wheel(folder: Path, name: str, version: int) -> None:
    """Write a wheel with one module that knows its version, and one command."""
    files = {
        f"{name}.py": f"VERSION = {version}\n",
        f"{name}-{version}.dist-info/METADATA": f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n",
        f"{name}-{version}.dist-info/WHEEL": "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        f"{name}-{version}.dist-info/entry_points.txt": f"[console_scripts]\n{name}-tool = site:getsitepackages\n",
    }
    record = f"{name}-{version}.dist-info/RECORD"
    lines = ""
    for path, text in files.items():
        digest = base64.urlsafe_b64encode(hashlib.sha256(text.encode()).digest()).rstrip(b"=").decode()
        lines += f"{path},sha256={digest},{len(text)}\n"
    with zipfile.ZipFile(folder / f"{name}-{version}-py3-none-any.whl", "w") as wheel:
        for path, text in files.items():
            wheel.writestr(path, text)
        wheel.writestr(record, f"{lines}{record},,\n")
