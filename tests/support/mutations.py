"""Files that are damaged by lot: the same case gives the same bytes on every machine.

A case is called "source:seed", as in "cornell:1234". It can be looked at:

    python -m tests.support.mutations cornell:1234 FOLDER
"""

from __future__ import annotations

import os
import random
import re
import struct
import sys
from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path

from common.gltf.refusal import Refusal
from common.gltf.schema import check_document
from tests.support import mutation_sources as sources
from tests.support.mutate_bytes import PICTURES, damage, damage_container, damage_picture, damage_words
from tests.support.mutate_json import change, nasty_text, written


@dataclass(frozen=True)
class Case:
    """One mutation: the name of a source, and what the lot starts from."""

    source: str
    seed: int

    @classmethod
    def named(cls, text: str) -> Case:
        """Return the case that is called `text`."""
        source, _, seed = text.rpartition(":")
        return cls(source, int(seed))

    def __str__(self) -> str:
        return f"{self.source}:{self.seed}"


@dataclass
class Mutant:
    """The files of a case, what else lies beside them, and in words what was changed."""

    case: Case
    main: str
    files: dict[str, bytes]
    changes: list[str] = field(default_factory=list)
    outside: bytes = b"\x89PNG\r\n\x1a\nsecret"
    """What the file holds that lies outside of the scene's folder, beside it."""


def cases(count: int, first: int = 0, without: Collection[str] = ()) -> list[Case]:
    """Return cases `first`, `first` + 1, ...: sources by their weights, of those that are here, some left out."""
    weights = {name: weight for name, weight in sources.names().items() if name not in without}
    return [
        Case(random.Random(f"source {seed}").choices([*weights], [*weights.values()])[0], seed)
        for seed in range(first, first + count)
    ]


def mutate(case: Case) -> Mutant:
    """Return the files of a case."""
    rng = random.Random(str(case))
    source = sources.load(case.source)
    mutant = Mutant(case, source.main, dict(source.files))
    if not sources.is_gltf(case.source):
        name = rng.choice(sorted(mutant.files))
        change_text = name.endswith((".obj", ".mtl")) and rng.random() < 0.7
        mutant.files[name] = (_statements if change_text else damage)(mutant.files[name], rng, mutant.changes)
        return mutant
    for _ in range(rng.choice((1, 1, 1, 2))):
        rng.choices((_document, _buffer, _picture, _container, _bytes), (76, 9, 7, 4, 4))[0](mutant, rng)
    return mutant


def follows_schema(document: object) -> bool:
    """Whether the loader takes the shape of a document."""
    try:
        check_document(document)
    except Refusal:
        return False
    return True


def _document(mutant: Mutant, rng: random.Random) -> None:
    """Change the JSON; the container fits around it."""
    data = mutant.files[mutant.main]
    try:
        document, chunk = sources.split(data)
    except (ValueError, IndexError, struct.error):  # an earlier change has broken it
        return
    for _ in range(rng.choice((1, 1, 1, 3))):
        if not follows_schema(document):  # it is refused whatever else is wrong
            break
        change(document, rng, mutant.changes)
    mutant.files[mutant.main] = sources.join(written(document), chunk, data[:4] == b"glTF")


def _buffer(mutant: Mutant, rng: random.Random) -> None:
    """Change numbers in the binary chunk or in a .bin file."""
    names = [name for name in sorted(mutant.files) if name.endswith(".bin")]
    if names:
        name = rng.choice(names)
        mutant.files[name] = damage_words(mutant.files[name], 0, rng, mutant.changes)
    elif mutant.files[mutant.main][:4] == b"glTF":
        data = mutant.files[mutant.main]
        begin = 28 + int.from_bytes(data[12:16], "little")
        mutant.files[mutant.main] = damage_words(data, begin, rng, mutant.changes)


def _picture(mutant: Mutant, rng: random.Random) -> None:
    """Damage or replace a picture, beside the document or in its chunk."""
    names = [name for name in sorted(mutant.files) if name.endswith(PICTURES)]
    name = rng.choice(names) if names else mutant.main
    mutant.files[name] = damage_picture(mutant.files[name], bool(names), rng, mutant.changes)


def _container(mutant: Mutant, rng: random.Random) -> None:
    """Damage headers and chunks of a .glb; of other files the bytes of the document."""
    data = mutant.files[mutant.main]
    kind = damage_container if data[:4] == b"glTF" else damage
    mutant.files[mutant.main] = kind(data, rng, mutant.changes)


def _bytes(mutant: Mutant, rng: random.Random) -> None:
    """Damage any file anywhere, or leave it out."""
    name = rng.choice(sorted(mutant.files))
    if name != mutant.main and rng.random() < 0.2:
        del mutant.files[name]
        mutant.changes.append(f"{name} is missing")
        return
    mutant.files[name] = damage(mutant.files[name], rng, mutant.changes)


_WORDS = (
    *("1e39", "-1e30", "nan", "inf", "0", "-0", "-1", "99999999999999999999", "1e-320", "1_0", "٣", "0x10"),
    *("1/2/3/4", "//", "1//-9", "/dev/zero", "../secret.png", "\x1b[31m", "\\", "#"),
)
_STATEMENTS = (
    "f 1 2",
    "f",
    "v 1",
    "mtllib room.mtl",
    "mtllib ../secret.png",
    "mtllib pipe",
    "usemtl",
    "d 1e40",
    "o " + "x" * 9999,
)


def _statements(data: bytes, rng: random.Random, changes: list[str]) -> bytes:
    """Change words and lines of an .obj or .mtl file."""
    lines = data.decode().split("\n")
    for _ in range(rng.choice((1, 2, 4))):
        at = rng.randrange(len(lines))
        words = lines[at].split(" ")
        match rng.randrange(6):
            case 0 | 1:
                words[rng.randrange(len(words))] = rng.choice(_WORDS)
                lines[at] = " ".join(words)
            case 2:
                words[-1] = nasty_text(rng)
                lines[at] = " ".join(words)
            case 3:
                lines.insert(at, rng.choice(_STATEMENTS))
            case 4:
                lines[at : at + 1] = [lines[at]] * rng.choice((0, 2, 1000))
            case _:
                rng.shuffle(lines)
        changes.append(f"line {at + 1}")
        if not lines:
            lines = [""]
    return "\n".join(lines).encode("utf-8", "surrogatepass")


def write(mutant: Mutant, folder: Path) -> Path:
    """Write a case's files into the new folder `folder`, and beside it what is not to be opened; return the main file.

    In the scene's folder there are also a pipe ("pipe", where the system has such), a folder ("folder.png") and a link
    that leads outside ("link.png"): URIs name them.
    """
    folder.mkdir(parents=True)
    for name, data in mutant.files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    (folder / "folder.png").mkdir()
    (folder.parent / "secret.png").write_bytes(mutant.outside)
    if os.name == "posix":
        os.mkfifo(folder / "pipe")
        (folder / "link.png").symlink_to("../secret.png")
        (folder / "zero").symlink_to("/dev/zero")
    return folder / mutant.main


def main(words: list[str]) -> int:
    """Write the case called `words[0]` into the folder `words[1]`, and say what is changed."""
    mutant = mutate(Case.named(words[0]))
    print(write(mutant, Path(words[1]) / re.sub(r"[^\w.-]", "-", words[0])))
    print("\n".join(ascii(change) for change in mutant.changes))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
