"""`python -m assets` lists the scenes; `write NAME FOLDER` makes one; `remake` makes the files of the clone anew."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from assets import blue_noise
from assets.scenes import SCENES, find, write
from common.errors import UserError


def show() -> None:
    """Print every scene with its sizes, in triangles drawn, and what it is for."""
    for info in SCENES.values():
        sizes = ", ".join(f"{size} {triangles:,}" for size, triangles in info.sizes.items())
        print(f"{info.name:10} {sizes}\n{'':10} {info.exercises}")


def write_one(name: str, folder: Path, binary: bool) -> None:
    """Make the scene `name` ("atrium", "atrium:large") and write it into `folder`."""
    info, size = find(name)
    start = time.perf_counter()
    try:
        path = write(info.name, folder, size, binary)
    except OSError as error:
        raise UserError(f"Cannot write into {folder}: {error.strerror}; choose another folder.") from None
    print(f"{path}  {time.perf_counter() - start:.2f} s")


def remake() -> None:
    """Write every scene of the clone at its default size and the table of blue noise, and say how large they are."""
    total = 0
    for info in filter(lambda info: info.in_clone, SCENES.values()):
        start = time.perf_counter()
        folder = info.committed().parent
        for old in folder.iterdir() if folder.is_dir() else ():
            old.unlink()  # a texture that a generator no longer makes must not stay behind
        write(info.name, folder, binary=info.binary)
        size = sum(path.stat().st_size for path in folder.iterdir())
        total += size
        print(f"{info.name:10} {size / 1e6:6.2f} MB  {time.perf_counter() - start:5.2f} s")
    print(f"{'together':10} {total / 1e6:6.2f} MB")
    start = time.perf_counter()
    size = blue_noise.write()
    print(f"{'blue noise':10} {size / 1e6:6.2f} MB  {time.perf_counter() - start:5.2f} s")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return the exit code: 2 for a mistake of the user's, told in one sentence."""
    parser = argparse.ArgumentParser(prog="python -m assets", description=__doc__)
    commands = parser.add_subparsers(dest="command")
    commands.add_parser("list", help="show the scenes (the default)")
    writing = commands.add_parser("write", help="make one scene: .gltf with .bin and PNG files")
    writing.add_argument("name", metavar="NAME", help="such as atrium or atrium:large")
    writing.add_argument("folder", metavar="FOLDER", type=Path)
    writing.add_argument("--glb", action="store_true", help="one .glb file instead")
    commands.add_parser(
        "remake", help="make the files in assets/models and assets/tables anew, after a change of a generator"
    )
    chosen = parser.parse_args(arguments)
    try:
        if chosen.command == "write":
            write_one(chosen.name, chosen.folder, chosen.glb)
        elif chosen.command == "remake":
            remake()
        else:
            show()
    except UserError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
