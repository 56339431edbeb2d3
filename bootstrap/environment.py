"""Make and keep `.venv`, the folder with the packages that Strata runs on.

The launchers start `.venv`'s Python by themselves when three things hold, and these are written here: the stamp names
the clone's folder and the installed set of packages, and the copy of the lock beside it equals the clone's.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from bootstrap import packages
from bootstrap.packages import LOCK

STAMP = "strata.stamp"
FOUND, COMPLETE, NOTHING = "found", "complete", "nothing"
"""What the stamp says of graphics: something draws; all that CI asks for was looked for too, and Vulkan draws; nothing
draws, so that the next command that draws looks again. Empty: the set-up has not looked yet."""

UNFINISHED = "strata.unfinished"
COMPILED = ("meshoptimizer",)
"""Extras without wheels: they need a C++ compiler and the headers of Python."""

# The launcher of Windows compares in cmd, which reads text in the console's own encoding.
ENCODING = "oem" if sys.platform == "win32" else "utf-8"


class SetupError(Exception):
    """Strata cannot be set up; the text is one sentence for the user, and more lines where a program said more."""


@dataclass(frozen=True)
class Environment:
    """The `.venv` of one clone."""

    root: Path

    @property
    def folder(self) -> Path:
        return self.root / ".venv"

    @property
    def python(self) -> Path:
        return self.folder / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")

    @property
    def scripts(self) -> Path:
        return self.python.parent

    def stamp(self) -> tuple[str, str, str]:
        """Return (clone's folder, installed set: "core" or "all", graphics: FOUND, COMPLETE or NOTHING).

        As the last set-up wrote them; what it did not write is empty.
        """
        try:
            lines = (self.folder / STAMP).read_text(ENCODING, "replace").splitlines()
        except OSError:
            return "", "", ""
        home, extent, graphics = (*lines, "", "", "")[:3]
        return (home, extent, graphics) if extent else ("", "", "")

    def has_packages(self, everything: bool) -> bool:
        """Return whether all packages of the lock are installed."""
        home, extent, _ = self.stamp()
        return (
            home == str(self.root)
            and (extent == "all" or not everything)
            and self.python.exists()
            and _read(self.folder / LOCK) == _read(self.root / LOCK)
        )

    def ready(self, everything: bool, ci: bool) -> bool:
        """Return whether nothing has to be done; the launchers decide the same in their own words."""
        return self.has_packages(everything) and self.stamp()[2] in ((COMPLETE,) if ci else (FOUND, COMPLETE))

    def note_graphics(self, word: str) -> None:
        """Write into the stamp what the set-up found; where that cannot be written, the next start looks again."""
        home, extent, _ = self.stamp()
        with suppress(OSError):
            _write_stamp(self.folder / f"{STAMP}.new", home, extent, word)

    def check_readable(self) -> None:
        """Raise SetupError where this user may not reach the environment's Python."""
        try:
            self.python.stat()
        except PermissionError:
            target = f" -> {os.readlink(self.python)}" if _is_link(self.python) else ""
            raise SetupError(
                f"This user may not read the Python of this clone's environment ({self.python}{target}): start as the "
                f"user who set it up, or delete {self.folder} and start again."
            ) from None
        except OSError:
            pass  # it is not there, or leads nowhere: then it is made


@dataclass(frozen=True)
class Supply:
    """A folder of wheels that pip takes in place of what a network has, and the packages of the lock not in it."""

    folder: Path
    left_out: tuple[str, ...] = ()


def make(
    environment: Environment,
    everything: bool,
    latest: bool,
    say: Callable[[str], None],
    supply: Supply | None = None,
) -> None:
    """Bring `.venv` to what is asked, by the least that will do; raise SetupError where that fails.

    A `.venv` that was made by hand is added to. One that an interrupted set-up left is made anew.
    """
    home, _, graphics = environment.stamp()
    with _unfinished(environment) as interrupted_before:
        if interrupted_before or not works(environment.python):
            if any(path.name != UNFINISHED for path in environment.folder.iterdir()):
                say("The environment in .venv is not whole and is made anew.")
            _create(environment)
        elif home not in ("", str(environment.root)):
            say(f"The clone was moved from {home}: its environment is put right.")
            _rehome(environment)
        install(environment, everything, latest, say, supply)
        site = _site_packages(environment)
        # A line in a .pth file is all that an editable install comes to. Written like this it needs no build tool and
        # no network, and being relative it survives a move of the clone.
        (site / "strata.pth").write_text(os.path.relpath(environment.root, site) + "\n", "utf-8")
        shutil.copyfile(environment.root / LOCK, environment.folder / LOCK)
        extent = "all" if everything else "core"
        # The mark of unfinished work itself becomes the stamp, so there is never both or neither.
        _write_stamp(environment.folder / UNFINISHED, str(environment.root), extent, graphics)


def _write_stamp(beside: Path, home: str, extent: str, graphics: str) -> None:
    """Write the stamp whole or not at all: into a file beside it, which is renamed."""
    beside.write_text(f"{home}\n{extent}\n{graphics}\n", ENCODING, "replace")
    beside.replace(beside.with_name(STAMP))


@contextmanager
def _unfinished(environment: Environment) -> Iterator[bool]:
    """Mark `.venv` as not whole until the work in it ends; yield whether an earlier work was cut off.

    A failure that was noticed leaves whole packages behind and is no cut: then the old stamp is put back.
    """
    stamp, mark = environment.folder / STAMP, environment.folder / UNFINISHED
    try:
        environment.folder.mkdir(exist_ok=True)
        interrupted_before = mark.exists()
        old = _read(stamp)
        mark.touch()
        stamp.unlink(missing_ok=True)
    except OSError as error:
        raise SetupError(
            f"Strata cannot be set up in {environment.root}: its folder .venv cannot be written ({error.strerror}); "
            "put the clone where you may write, or have somebody who may run ./strata there once."
        ) from None
    try:
        yield interrupted_before
    except SetupError:
        if old:
            stamp.write_bytes(old)
        mark.unlink(missing_ok=True)
        raise


def install(
    environment: Environment,
    everything: bool,
    latest: bool,
    say: Callable[[str], None],
    supply: Supply | None = None,
) -> None:
    """Let pip install what is missing; with the lock every file must have one of the hashes written there."""
    root = environment.root
    if latest:
        text, options = packages.newest(root / "pyproject.toml", everything), ["--upgrade"]
    else:
        # The lock is complete, so pip has nothing to resolve.
        text, options = (
            packages.locked(_read(root / LOCK).decode(), everything),
            ["--require-hashes", "--no-deps"],
        )
    if everything and sys.platform == "linux" and not can_compile():  # elsewhere the lock leaves them out
        text = packages.without(text, COMPILED)
        say(f"Left out, since it takes a C++ compiler and Python's headers: {', '.join(COMPILED)}.")
    count = len(packages.names_in(text))
    say(f"Installing up to {count} Python packages into {environment.folder}.")
    descriptor, name = tempfile.mkstemp(suffix=".txt")
    with os.fdopen(descriptor, "w", encoding="utf-8") as stream:
        stream.write(text)
    command = [
        str(environment.python),
        "-I",
        "-m",
        "pip",
        "--disable-pip-version-check",
        "--no-input",
        "install",
    ]
    # A user's pip configuration keeps its word about where packages come from, but not about where they go to.
    variables = {
        **os.environ,
        "PIP_USER": "0",
        "PIP_TARGET": "",
        "PIP_PREFIX": "",
        "PIP_REQUIRE_VIRTUALENV": "0",
    }
    if supply is not None:  # then it keeps its word about nothing: all that is needed is there
        text = packages.without(text, supply.left_out)
        options += ["--no-index", "--find-links", str(supply.folder)]
        variables = {name: value for name, value in os.environ.items() if not name.startswith("PIP_")}
        variables["PIP_CONFIG_FILE"] = os.devnull
    try:
        lines = _run_pip([*command, *options, "--progress-bar", "off", "-r", name], variables, count)
    finally:
        os.unlink(name)
    if lines:
        advice = "if the network is down, start ./strata again when it is back, or with --from and a bundle"
        if supply is not None:
            advice = "the bundle has not what this system needs"
        raise SetupError(
            f"The Python packages could not be installed; {advice}. The last lines of pip:\n  "
            + "\n  ".join(lines[-12:])
        )


def can_compile() -> bool:
    """Return whether pip can build a package that is written in C++."""
    headers = Path(sysconfig.get_path("include"), "Python.h")
    return all(shutil.which(name) for name in ("cc", "c++")) and headers.is_file()


@contextmanager
def only_one(say: Callable[[str], None]) -> Iterator[None]:
    """Hold the right to set this clone up; a second start waits here until the first is done or dead.

    The lock is on a file that is there anyway, is kept by the system, and so ends with its holder, however that ends.
    """
    with open(__file__, "rb") as stream:
        if not try_lock(stream.fileno()):
            say("Another start of Strata is setting it up; waiting for that.")
            while not try_lock(stream.fileno()):
                time.sleep(0.1)
        yield


if sys.platform == "win32":

    def try_lock(descriptor: int) -> bool:
        import msvcrt

        os.lseek(descriptor, 1 << 30, os.SEEK_SET)  # past the end: a locked byte cannot be read by others
        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        return True

else:

    def try_lock(descriptor: int) -> bool:
        import fcntl

        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        except OSError:
            return True  # a file system without locks: better unguarded than not at all
        return True


def _create(environment: Environment) -> None:
    """Make an empty environment in the folder, which stays: it may be a link to another disk."""
    for path in environment.folder.iterdir():
        if path.name == UNFINISHED:
            continue
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink()
    command = [sys.executable, "-I", "-m", "venv", str(environment.folder)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise SetupError(
            f"{sys.executable} could not make the environment {environment.folder}: "
            + ((done.stderr or done.stdout).strip() or "it gave no reason")
        )


def _rehome(environment: Environment) -> None:
    """Put an environment right whose clone was moved: its scripts name their Python by its whole path."""
    if sys.platform == "win32":  # there the scripts are programs
        _create(environment)
        return
    subprocess.run(
        [environment.python, "-I", "-m", "venv", "--without-pip", environment.folder],
        capture_output=True,
        check=True,
    )  # writes the activate scripts anew and leaves the packages alone
    # "#!" takes neither spaces nor long paths; this form, which pip uses then, is a shell script and a docstring.
    header = f"#!/bin/sh\n'''exec' \"{environment.python}\" \"$0\" \"$@\"\n' '''\n".encode()
    for path in environment.scripts.iterdir():
        if path.is_symlink() or not path.is_file():
            continue
        first, _, rest = path.read_bytes().partition(b"\n")
        if first == b"#!/bin/sh" and rest.startswith(b"'''exec'"):
            rest = rest.split(b"\n", 2)[2]
        elif not (first.startswith(b"#!") and b"python" in first):
            continue
        path.write_bytes(header + rest)


def works(python: Path) -> bool:
    """Return whether a Python starts, is new enough and has pip."""
    check = "import sys, pip; sys.exit(sys.version_info < (3, 11))"
    try:
        return subprocess.run([python, "-I", "-c", check], capture_output=True, check=False).returncode == 0
    except OSError:
        return False


def version_of(environment: Environment) -> str:
    """Return the version of the Python that packages are installed for, as "3.12": that of `.venv` if it stays."""
    code = "import sys; print('%d.%d' % sys.version_info[:2])"
    if works(environment.python) and not (environment.folder / UNFINISHED).exists():
        done = subprocess.run(
            [environment.python, "-I", "-c", code], capture_output=True, text=True, check=True
        )
        return done.stdout.strip()
    return "{}.{}".format(*sys.version_info[:2])


def _site_packages(environment: Environment) -> Path:
    """Return the folder of packages as its own Python names it; its version may differ from ours."""
    code = "import sysconfig; print(sysconfig.get_path('purelib'))"
    done = subprocess.run([environment.python, "-I", "-c", code], capture_output=True, text=True, check=True)
    return Path(done.stdout.strip())


def _run_pip(command: list[str], variables: dict[str, str], count: int) -> list[str]:
    """Run pip and return [] when it succeeded, else what it said; at a terminal a line counts the packages."""
    shows = sys.stderr.isatty()
    lines, begun = [], 0
    with subprocess.Popen(
        command,
        env=variables,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as process:
        assert process.stdout is not None
        for line in process.stdout:
            lines.append(line.rstrip())
            if (
                line.startswith(("Collecting ", "Requirement already satisfied", "Ignoring "))
                and begun < count
            ):
                begun += 1
                if shows:
                    done = "#" * (30 * begun // count)
                    sys.stderr.write(f"\r  [{done:<30}] {begun}/{count} {line.split()[1][:40]:<40}")
            elif shows and line.startswith("Installing collected"):
                sys.stderr.write(f"\r  {'unpacking':<80}")
            sys.stderr.flush()
    if shows:
        sys.stderr.write("\r" + " " * 84 + "\r")
    return lines if process.returncode else []


def _is_link(path: Path) -> bool:
    try:
        return path.is_symlink()
    except OSError:
        return False


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError:
        return b""
