"""`python -m assets` makes the committed scenes anew and says how large they are."""

from __future__ import annotations

import time

from assets.scenes import SCENES, write


def main() -> None:
    """Write every scene at its default size into the clone, in place of what is there."""
    total = 0
    for info in SCENES.values():
        start = time.perf_counter()
        folder = info.committed().parent
        if folder.is_dir():
            for old in folder.iterdir():
                old.unlink()
        write(info.name, folder, binary=info.binary)
        size = sum(path.stat().st_size for path in folder.iterdir())
        total += size
        print(f"{info.name:10} {size / 1e6:6.2f} MB  {time.perf_counter() - start:5.2f} s")
    print(f"{'together':10} {total / 1e6:6.2f} MB")


if __name__ == "__main__":
    main()
