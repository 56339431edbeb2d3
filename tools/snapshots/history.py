"""What the chapter tools ask git: a file as it was, what changed since, and the commits that changed a folder.

Nothing is written to the repository. Contents are given as a checkout would write them, so that line ends agree with
the files on disk.
"""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from common.errors import UserError

ELSEWHERE = ("GIT_DIR", "GIT_WORK_TREE", "GIT_INDEX_FILE", "GIT_PREFIX")
"""What git tells its hooks, and what would lead away from the folder that is asked about."""

INSTALL = "install git (https://git-scm.com, or the package git of your system)"


def git(*words: str | os.PathLike[str], folder: Path, stdin: bytes | None = None) -> bytes:
    """Run git in `folder` and return what it prints; raise UserError where there is none, GitError if it fails."""
    done = call(*words, folder=folder, stdin=stdin)
    if done.returncode:
        text = done.stderr.decode("utf-8", "replace").strip()
        first = text.splitlines()[0] if text else f"exit code {done.returncode}"
        raise GitError(f"git {words[0]} failed in {folder}: {first.removeprefix('fatal: ')}.")
    return done.stdout


def call(
    *words: str | os.PathLike[str], folder: Path, stdin: bytes | None = None
) -> subprocess.CompletedProcess[bytes]:
    """Run git in `folder` whatever its exit code; raise UserError where there is no git."""
    try:
        return subprocess.run(
            ["git", *words],
            cwd=folder,
            input=b"" if stdin is None else stdin,
            capture_output=True,
            check=False,
            env=_surroundings(),
        )
    except FileNotFoundError:
        raise UserError(f"This needs git, and there is none on the PATH: {INSTALL}.") from None


def _surroundings() -> dict[str, str]:
    kept = {name: value for name, value in os.environ.items() if name not in ELSEWHERE}
    return {**kept, "LC_ALL": "C", "GIT_OPTIONAL_LOCKS": "0"}


class GitError(UserError):
    """Git refused; the text is its own first line."""


@dataclass(frozen=True)
class Commit:
    """One commit: its hash, its subject, and the paths it changed, added or removed, relative to the repository."""

    sha: str
    subject: str
    paths: tuple[str, ...]


class History:
    """The repository around `folder`, read at any revision; paths given and returned are relative to `folder`.

    Raises UserError if there is no git, no repository, or no commit in it.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        try:
            text = git("rev-parse", "--show-prefix", "HEAD^{commit}", folder=folder)
        except GitError as error:
            why = str(error)
            if "not a git repository" not in why and "HEAD^{commit}" not in why:
                raise
            raise UserError(
                f"{folder} is in no git repository with a commit, so nobody knows what changed: "
                "this works in a clone of Strata."
            ) from None
        self.prefix, self.head = text.decode("utf-8", "surrogateescape").splitlines()

    def commit(self, revision: str) -> str:
        """Return the hash of the commit that `revision` names."""
        return (
            git("rev-parse", "--verify", "--end-of-options", f"{revision}^{{commit}}", folder=self.folder)
            .decode()
            .strip()
        )

    @property
    def shallow(self) -> bool:
        """Whether older commits were left out when this was cloned, as by `git clone --depth 1`."""
        return git("rev-parse", "--is-shallow-repository", folder=self.folder).strip() == b"true"

    def read(self, revision: str, path: str) -> bytes | None:
        """Return a file as a checkout of `revision` would write it, or None if it is not there."""
        name = f"{revision}:{self.prefix}{path}"
        done = call("cat-file", "--filters", name, folder=self.folder)
        return None if done.returncode else done.stdout

    @contextmanager
    def reader(self) -> Iterator[Callable[[str, str], bytes | None]]:
        """Give what reads many files at many revisions, by one process; line ends are those of the repository."""
        with subprocess.Popen(
            ["git", "cat-file", "--batch"],
            cwd=self.folder,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=_surroundings(),
        ) as process:
            asked, told = process.stdin, process.stdout
            assert asked is not None and told is not None

            def read(revision: str, path: str) -> bytes | None:
                asked.write(f"{revision}:{self.prefix}{path}\n".encode("utf-8", "surrogateescape"))
                asked.flush()
                said = told.readline().split()
                if said[1] != b"blob":
                    return None
                content = told.read(int(said[2]))
                told.read(1)
                return content

            yield read

    def changed(self, below: str = ".", since: str = "HEAD") -> list[str]:
        """Return the paths of the files on disk that differ from `since`, files that git does not know included."""
        known = git(
            "diff", "--name-only", "--no-renames", "--relative", "-z", since, "--", below, folder=self.folder
        )
        new = git("ls-files", "--others", "--exclude-standard", "-z", "--", below, folder=self.folder)
        names = (known + new).decode("utf-8", "surrogateescape").split("\0")
        return sorted({name for name in names if name})

    def commits(self, below: str = ".") -> Iterator[Commit]:
        """Yield the commits that changed something in `below`, newest first; merges are none of them."""
        words = ("log", "--no-merges", "--no-renames", "--name-only", "-z", "--format=%x01%H %s", "--", below)
        text = git(*words, folder=self.folder).decode("utf-8", "surrogateescape")
        for record in text.split("\x01")[1:]:
            head, _, names = record.partition("\0")
            sha, _, subject = head.partition(" ")
            paths = (name.strip("\n") for name in names.split("\0"))
            kept = tuple(name.removeprefix(self.prefix) for name in paths if name.startswith(self.prefix))
            yield Commit(sha, subject, tuple(name for name in kept if name))
