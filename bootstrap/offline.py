"""Set Strata up from a bundle: its clone into a folder, its packages into `.venv`, its site and models beside them.

`python3 FILE FOLDER` does the first, where there is no clone yet, and `./strata --from FILE COMMAND` in it the rest.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from bootstrap.bundle import (
    CLONE,
    HISTORY,
    MODELS,
    SITE,
    WHEELS,
    Bundle,
    Target,
    need_room,
    open_bundle,
    this_system,
    umask,
)
from bootstrap.environment import Environment, SetupError, Supply, version_of
from bootstrap.packages import LOCK, locked, names_in

BRANCH = "main"
SYSTEM_PACKAGES = (
    "A bundle brings Python packages alone: drivers and programs of the system, as the commands above install them, "
    "come from the system's own package manager, its medium or its mirror."
)


# --- ./strata --from FILE ---


@contextmanager
def opened(source: str, environment: Environment, everything: bool) -> Iterator[Offline]:
    """Give a bundle that this clone can be set up from; raise SetupError where it cannot."""
    with open_bundle(Path(source)) as bundle:
        yield Offline(bundle, environment, everything)


class Offline:
    """A bundle from which a clone is set up."""

    def __init__(self, bundle: Bundle, environment: Environment, everything: bool) -> None:
        self.bundle = bundle
        self.root = environment.root
        lock = CLONE + LOCK
        own = (self.root / LOCK).read_bytes() if (self.root / LOCK).is_file() else b""
        if lock not in bundle.manifest.files or bundle.read(lock) != own:
            raise SetupError(
                f"{bundle.path} has the packages for commit {bundle.manifest.commit[:10]}, and this clone's {LOCK} is "
                f'another: take the clone that is in it (python3 "{bundle.path.name}" FOLDER), or make the bundle anew.'
            )
        self.target = target_of(bundle, version_of(environment))
        if everything and self.target.packages != "all":
            raise SetupError(
                f"{bundle.path} has the core of the packages alone, and all extras are asked for (--extras, CI=true or "
                "what was installed before): make it by `strata bundle FILE --extras`."
            )
        missing = set(names_in(locked(own.decode(), everything=False))) & set(self.target.lacks)
        if missing:
            raise SetupError(
                f"Strata cannot be set up from {bundle.path} alone: for {self.target} there are no wheels of "
                f"{', '.join(sorted(missing))}."
            )

    @contextmanager
    def packages(self, say: Callable[[str], None]) -> Iterator[Supply]:
        """Give the folder in which pip finds all that it may install, for as long as it needs that."""
        if self.target.lacks:
            say(f"Left out, since there are no wheels for {self.target}: {', '.join(self.target.lacks)}.")
        with tempfile.TemporaryDirectory(prefix="strata-") as folder:
            names = [WHEELS + wheel for wheel in self.target.wheels]
            need_room(Path(folder), sum(self.bundle.manifest.files[name].size for name in names))
            for name in names:
                self.bundle.unpack_one(name, Path(folder, name.removeprefix(WHEELS)))
            yield Supply(Path(folder), self.target.lacks)

    def place_the_rest(self, say: Callable[[str], None]) -> None:
        """Put site and models into the clone's folder `out`; what is there already stays."""
        models = sorted({name.split("/")[1] for name in self.bundle.names(MODELS)})
        wanted = [(f"{MODELS}{name}/", self.root / "out" / "models" / name) for name in models]
        if self.bundle.names(SITE):
            wanted.append((SITE, self.root / "out" / "site"))
        for prefix, folder in wanted:
            if not folder.exists():
                place(self.bundle, prefix, folder)
                begin = [
                    n
                    for n in self.bundle.names(prefix)
                    if n.endswith((".gltf", ".glb", ".obj", "site/index.html"))
                ]
                say(f"From the bundle: {', '.join(f'out/{name}' for name in begin) or folder}.")


def target_of(bundle: Bundle, python: str) -> Target:
    """Return the packages of a bundle for this system and that Python; raise SetupError where it has none."""
    system, targets = this_system(), bundle.manifest.targets
    for target in targets:
        if (target.system, target.python) == (system, python):
            return target
    there = ", ".join(map(str, targets)) or "no system"
    raise SetupError(
        f"{bundle.path} has packages for {there}, and this is {system} with Python {python}: "
        f"make one by `strata bundle FILE --for {system} --python {python}`, or start with a Python that it has."
    )


def other_python(source: str | None, environment: Environment) -> list[str] | None:
    """Return the command of an installed Python that a bundle has packages for, None where this one will do.

    It is looked for only where there is no `.venv` yet, whose Python would be this one.
    """
    if source is None or environment.python.exists():
        return None
    with open_bundle(Path(source)) as bundle:
        mine = [target.python for target in bundle.manifest.targets if target.system == this_system()]
    if version_of(environment) in mine:
        return None
    for version in mine:
        named = shutil.which(f"python{version}")
        command = ["py", f"-{version}"] if sys.platform == "win32" else [named or ""]
        # A name on the PATH may be that of a version manager, which has not got this version.
        with suppress(OSError):
            if subprocess.run([*command, "-I", "-c", ""], capture_output=True, check=False).returncode == 0:
                return command
    return None


def place(bundle: Bundle, prefix: str, folder: Path) -> None:
    """Unpack a folder of a bundle, whole or not at all: it is written beside its place and renamed."""
    need_room(folder, sum(bundle.manifest.files[name].size for name in bundle.names(prefix)))
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        beside = Path(tempfile.mkdtemp(dir=folder.parent, prefix=f".{folder.name}."))
    except OSError as error:
        raise SetupError(
            f"{folder} cannot be written: {error.strerror or error}; choose another place."
        ) from None
    try:
        bundle.unpack(prefix, beside)
        beside.chmod(0o777 & ~umask())
        if folder.is_dir():
            folder.rmdir()  # it is empty, and Windows renames onto nothing
        beside.rename(folder)
    except OSError as error:
        raise SetupError(
            f"{folder} cannot be written: {error.strerror or error}; choose another place."
        ) from None
    finally:
        shutil.rmtree(beside, ignore_errors=True)


# --- python3 FILE FOLDER ---


def main(file: Path, words: list[str]) -> int:
    """Unpack the clone that is in a bundle; return an exit code, 2 when the user has to do something first."""
    try:
        if len(words) != 1 or words[0].startswith("-"):
            raise SetupError(
                f'This is a bundle of Strata: `python3 "{file.name}" FOLDER` unpacks its clone into a folder.'
            )
        unpack_clone(file, Path(words[0]).absolute())
    except SetupError as error:
        print(f"strata: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("strata: stopped.", file=sys.stderr)
        return 130
    launcher = r".\strata.cmd" if sys.platform == "win32" else "./strata"
    print(f'Now:  cd "{words[0]}"\n      {launcher} --from "{file}" run 1')
    return 0


def unpack_clone(file: Path, folder: Path) -> None:
    """Write the clone of a bundle into a new folder, with its history where git is installed."""
    if folder.exists() and not (folder.is_dir() and not any(folder.iterdir())):
        raise SetupError(f"{folder} exists and is no empty folder: name another one for the clone.")
    with open_bundle(file) as bundle:
        place(bundle, CLONE, folder)
        if HISTORY not in bundle.manifest.files:
            return
        with tempfile.TemporaryDirectory(prefix="strata-") as scratch:
            history = Path(scratch, HISTORY)
            bundle.unpack_one(HISTORY, history)
            why = take_history(folder, history)
        if why:
            shutil.rmtree(folder / ".git", ignore_errors=True)
            print(
                f"strata: The clone has no history ({why}); all but `strata carry` and `new` works.",
                file=sys.stderr,
            )


def take_history(folder: Path, history: Path) -> str:
    """Make a repository of a folder that has the files of its last commit; return why that failed, or ""."""
    variables = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}
    for words in (
        ("init", "--quiet"),
        ("symbolic-ref", "HEAD", f"refs/heads/{BRANCH}"),
        ("fetch", "--quiet", "--update-head-ok", str(history), f"HEAD:refs/heads/{BRANCH}"),
        ("reset", "--quiet"),
    ):
        try:
            done = subprocess.run(
                ["git", *words], cwd=folder, env=variables, capture_output=True, text=True, check=False
            )
        except OSError:
            return "git is not installed"
        if done.returncode:
            return (done.stderr.strip().splitlines() or ["git failed"])[0]
    return ""
