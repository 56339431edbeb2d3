"""A work that misbehaves: what the runner of mutated files must notice, each by a function of that name."""

from __future__ import annotations

import os
import subprocess
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from common.errors import SceneError
from tests.support.mutations import Case


def loads(path: Path) -> None:
    path.read_bytes()
    sorted(path.parent.iterdir())


def refuses(path: Path) -> None:
    raise SceneError(f"{path}: nodes[0] is no node; export it again.")


def raises(path: Path) -> None:
    raise KeyError("bufferView")


def overflows_a_stack(path: Path) -> None:
    overflows_a_stack(path)


def warns(path: Path) -> None:
    warnings.warn("overflow encountered in multiply", RuntimeWarning, stacklevel=1)


def speaks_in_two_lines(path: Path) -> None:
    raise SceneError(f"{path}: a name\nstrata: forged")


def moves_the_terminal(path: Path) -> None:
    raise SceneError(f"{path}: \x1b[31mred")


def opens_outside(path: Path) -> None:
    (path.parent.parent / "secret.png").read_bytes()


def opens_a_device(path: Path) -> None:
    with open("/dev/zero", "rb") as file:
        file.read(1)


def opens_through_a_link(path: Path) -> None:
    os.close(os.open(path.parent / "link.png", os.O_RDONLY))


def opens_a_pipe(path: Path) -> None:
    os.close(os.open(path.parent / "pipe", os.O_RDONLY | os.O_NONBLOCK))


def lists_outside(path: Path) -> None:
    os.listdir("/")


def starts_a_program(path: Path) -> None:
    subprocess.run(["true"], check=False)


def eats_memory(path: Path) -> None:
    held = []
    for _ in range(64):
        held.append(np.ones(2**24, np.uint8))
        time.sleep(0.01)


def takes_memory_for_a_moment(path: Path) -> None:
    np.ones(2**28, np.uint8)


def hangs(path: Path) -> None:
    with open("/dev/zero", "rb") as file:
        file.read(1)
        time.sleep(60)


def ends_the_process(path: Path) -> None:
    os.abort()


DOINGS: tuple[tuple[Callable[[Path], None], str], ...] = (
    (loads, "loaded"),
    (refuses, "refused"),
    (raises, "fault"),
    (overflows_a_stack, "fault"),
    (warns, "fault"),
    (speaks_in_two_lines, "fault"),
    (moves_the_terminal, "fault"),
    (opens_outside, "opened"),
    (opens_a_device, "opened"),
    (opens_through_a_link, "opened"),
    (opens_a_pipe, "opened"),
    (lists_outside, "opened"),
    (starts_a_program, "opened"),
    (eats_memory, "memory"),
    (takes_memory_for_a_moment, "memory"),
    (hangs, "hang"),
    (ends_the_process, "crash"),
    (loads, "loaded"),
)
"""What is done by the cases 0, 1, ..., and what becomes of each."""


class Faulty:
    """Does what `DOINGS` has for the seed of a case."""

    device = ""

    def __init__(self, options: Any, folder: Path) -> None:
        pass

    def __call__(self, path: Path, case: Case) -> None:
        """Do it."""
        DOINGS[case.seed][0](path)

    def tidy(self) -> None:
        """Nothing is left."""
