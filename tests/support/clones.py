"""Small clones for the tests of the chapter tools: chapters of a few short files, in a git repository of their own."""

from __future__ import annotations

import shutil
from pathlib import Path

from tools.snapshots.history import git

PASS = "".join(f"line {number}\n" for number in range(1, 21))


class Clone:
    """A repository in `folder` whose `chapters/` hold `count` chapters, each a copy of the one before."""

    def __init__(self, folder: Path, count: int = 15, git: bool = True) -> None:
        self.folder = folder
        self.root = folder / "chapters"
        for number in range(1, count + 1):
            self.write(f"ch{number:02d}/__init__.py", f"NUMBER = {number}\n")
            self.write(f"ch{number:02d}/passes/forward.py", PASS)
            self.write(f"ch{number:02d}/passes/sky.py", PASS.replace("line", "sky"))
        if git:
            self.begin()

    def copy(self, folder: Path) -> Clone:
        """Return the same in another folder: quicker than to make it once more."""
        made = Clone(folder, count=0, git=False)
        shutil.copytree(self.folder, folder, dirs_exist_ok=True)
        return made

    def begin(self) -> None:
        """Make the repository, with all there is as its first commit."""
        self.git("init", "-q", "--template=")
        self.commit("begin")

    def git(self, *words: str) -> str:
        """Run git, as somebody."""
        who = ["-c", "user.name=A", "-c", "user.email=a@b", "-c", "commit.gpgsign=false", "-c", "gc.auto=0"]
        return git(*who, *words, folder=self.folder).decode()

    def commit(self, subject: str) -> str:
        """Commit everything; return the hash."""
        self.git("add", "-A")
        self.git("commit", "-q", "--allow-empty", "-m", subject)
        return self.git("rev-parse", "HEAD").strip()

    def write(self, name: str, content: str | bytes) -> None:
        """Write a file below chapters/."""
        path = self.root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())

    def read(self, name: str) -> bytes:
        """Return a file below chapters/."""
        return (self.root / name).read_bytes()

    def edit(self, name: str, old: str, new: str) -> None:
        """Replace a text in a file below chapters/, which must be there."""
        content = self.read(name).decode()
        assert old in content
        self.write(name, content.replace(old, new))

    def files(self) -> dict[str, bytes]:
        """Return all files of the clone but git's own."""
        found = (path for path in self.folder.rglob("*") if path.is_file())
        names = {path.relative_to(self.folder).as_posix(): path for path in found}
        return {name: path.read_bytes() for name, path in names.items() if not name.startswith(".git/")}
