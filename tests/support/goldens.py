"""Golden pictures: alarms for change, kept with the driver that made them, compared on that driver alone.

    def test_the_atrium(vulkan_device, golden):
        golden("atrium", picture, vulkan_device.capabilities, coverage=0.96)

tests/goldens/<area>/<name>.png    the picture, 8 bits, as a display shows it
tests/goldens/<area>/<name>.json   who made it (device, driver, LLVM, features of the CPU), and facts that hold anywhere

A later chapter shows the picture of the nearest chapter before it that has a golden of this name, until it gets one of
its own.

On the driver that made a golden no channel of a pixel may differ by more than one step of 255. On another one only the
facts are compared, loosely, and a warning says so. `--bless` makes goldens anew: it writes the old picture, the new one
and the map of their difference to out/bless/, names them, and asks for each; `--yes` answers.
"""

from __future__ import annotations

import json
import platform
import re
import sys
import warnings
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from backends.contract import Capabilities
from chapters import folder_name
from common.errors import UserError
from common.images import read_image, write_image
from common.paths import ROOT, write_whole
from common.reports import metrics
from tests.support.snapshots import first_chapter, tested

GOLDENS = ROOT / "tests" / "goldens"
LOOK = ROOT / "out" / "bless"
STEP = 1
"""How far a channel may be off on the driver that made the golden, in steps of 255."""
FACTS_WITHIN = 0.05
"""How far a fact may be off on any driver, as a part of its value."""

_CPU_FEATURES = ("sse4_1", "avx", "avx2", "avx512f", "f16c", "fma", "asimd", "sve")
"""What changes the code that a driver on the CPU makes of a shader, and with it the last bit of its results."""


class GoldenNotCompared(UserWarning):
    """A golden was made by another driver, so that its pixels say nothing here."""


@dataclass(frozen=True)
class Maker:
    """What the pixels of a picture depend on besides our code."""

    backend: str
    device: str
    driver: str
    llvm: str | None
    machine: str
    cpu: tuple[str, ...]

    @classmethod
    def of(cls, capabilities: Capabilities, cpuinfo: str | None = None) -> Maker:
        """Return the maker of pictures of a device; `cpuinfo` is the text of /proc/cpuinfo, read if None."""
        if cpuinfo is None:
            path = Path("/proc/cpuinfo")
            cpuinfo = path.read_text("utf-8", "replace") if path.is_file() else ""
        found = re.search(r"^(?:flags|Features)\s*:(.*)$", cpuinfo, re.MULTILINE)
        flags = set(found[1].split()) if found else set()
        version = re.search(r"LLVM (\d+(?:\.\d+)*)", capabilities.device + " " + capabilities.driver)
        return cls(
            backend=capabilities.backend,
            device=capabilities.device,
            driver=capabilities.driver,
            llvm=version[1] if version else None,
            machine=platform.machine(),
            # A GPU does not care which CPU feeds it.
            cpu=tuple(name for name in _CPU_FEATURES if name in flags) if capabilities.is_software else (),
        )

    def differences(self, other: Maker) -> list[str]:
        """Return "what: mine, not theirs" of all that differs."""
        mine, theirs = asdict(self), asdict(other)
        return [f"{name}: {mine[name]}, not {theirs[name]}" for name in mine if mine[name] != theirs[name]]


@dataclass
class Proposal:
    """A picture that may become a golden."""

    path: Path  # of the .png
    picture: np.ndarray
    maker: Maker
    facts: dict[str, float]


@dataclass
class Goldens:
    """The goldens below a folder; what `--bless` finds is kept until the end of the run."""

    folder: Path = GOLDENS
    look: Path = LOOK
    bless: bool = False
    proposals: dict[str, Proposal] = field(default_factory=dict)

    def check(self, name: str, picture: np.ndarray, maker: Maker, facts: dict[str, float]) -> str:
        """Compare (H, W, 3) uint8 with golden `name` ("ch01/atrium"); return "" or why its pixels were not compared.

        Raises AssertionError for a picture or a fact that differs, and for a golden that is not there. When goldens
        are made anew nothing is compared but what several tests show under one name.
        """
        path = self.folder / f"{name}.png"
        if self.bless:
            before = self.proposals.setdefault(name, Proposal(path, picture, maker, facts))
            if metrics.max_abs(picture, before.picture) > STEP:
                raise AssertionError(f"Two tests show different pictures for the golden '{name}'.")
            return "goldens are being made anew"
        if not path.is_file():
            raise AssertionError(f"There is no golden '{name}': ./strata test --bless makes it.")
        record = json.loads(path.with_suffix(".json").read_text("utf-8"))
        kept = record["maker"]
        made_by = Maker(**{**kept, "cpu": tuple(kept["cpu"])})
        for fact, value in facts.items():
            expected = record["facts"][fact]
            if not abs(value - expected) <= FACTS_WITHIN * abs(expected):
                raise AssertionError(
                    f"The golden '{name}' has {fact} {expected:.4g}, this picture {value:.4g}."
                )
        others = maker.differences(made_by)
        if others:
            return f"the golden was made elsewhere ({'; '.join(others)})"
        old = read_image(path)[..., :3]
        if old.shape != picture.shape:
            raise AssertionError(f"The golden '{name}' is {old.shape}, this picture {picture.shape}.")
        worst = metrics.max_abs(picture, old)
        if worst > STEP:
            files = self.show(name, old, picture)
            raise AssertionError(
                f"The picture differs from the golden '{name}': {figures(old, picture)}. Look at {', '.join(files)}; "
                "if it is meant, ./strata test --bless makes the golden anew."
            )
        return ""

    def nearest(self, areas: Sequence[str], name: str) -> str:
        """Return the golden `name` of the last of `areas` that has one ("ch01/atrium"), the first area's if none has.

        `areas` are the chapter for which the test was written and those after it, up to the one that is tested.
        """
        found = [area for area in areas if (self.folder / area / f"{name}.png").is_file()]
        return f"{(found or areas)[-1 if found else 0]}/{name}"

    def place(self, areas: Sequence[str], name: str, picture: np.ndarray) -> str:
        """Return the golden that a picture is compared with, or that it becomes where goldens are made anew: the
        nearest, unless it differs from that; then the last area gets one of its own."""
        nearest = self.nearest(areas, name)
        if not self.bless or nearest.startswith(f"{areas[-1]}/"):
            return nearest
        proposal, path = self.proposals.get(nearest), self.folder / f"{nearest}.png"
        if proposal is None and not path.is_file():
            return nearest
        before = proposal.picture if proposal is not None else read_image(path)[..., :3]
        same = before.shape == picture.shape and metrics.max_abs(picture, before) <= STEP
        return nearest if same else f"{areas[-1]}/{name}"

    def show(self, name: str, old: np.ndarray | None, new: np.ndarray) -> list[str]:
        """Write old, new and the map of their difference, and return their paths."""
        pictures = {"old": old, "new": new}
        if old is not None and old.shape == new.shape:
            pictures["error"] = metrics.error_map(new, old)
        files = []
        for kind, picture in pictures.items():
            file = self.look / f"{name.replace('/', '-')}-{kind}.png"
            file.unlink(missing_ok=True)  # of a run before
            if picture is not None:
                self.look.mkdir(parents=True, exist_ok=True)
                write_image(file, picture)
                files.append(str(file))
        return files

    def finish(self, say: Callable[[str], None], ask: Callable[[str], bool]) -> int:
        """Show what changed, ask for each golden, write those that are wanted; return how many were written."""
        written = 0
        for name, proposal in self.proposals.items():
            old = read_image(proposal.path)[..., :3] if proposal.path.is_file() else None
            record = record_of(proposal)
            meta = proposal.path.with_suffix(".json")
            same = old is not None and np.array_equal(old, proposal.picture)
            if same and meta.is_file() and meta.read_text("utf-8") == record:
                say(f"{name}: unchanged")
                continue
            if old is None:
                change = "new"
            elif same:
                change = "the same pixels, other facts or another maker"
            else:
                change = figures(old, proposal.picture)
            say(f"{name}: {change}")
            for file in self.show(name, old, proposal.picture):
                say(f"    {file}")
            if ask(f"Take the new picture of '{name}' as golden?"):
                proposal.path.parent.mkdir(parents=True, exist_ok=True)
                write_image(proposal.path, proposal.picture)
                write_whole(meta, record.encode())
                written += 1
        return written


def record_of(proposal: Proposal) -> str:
    """Return the text of a golden's .json."""
    facts = {name: float(f"{value:.5g}") for name, value in proposal.facts.items()}
    return json.dumps({"maker": asdict(proposal.maker), "facts": facts}, indent=1) + "\n"


def figures(old: np.ndarray, new: np.ndarray) -> str:
    """Return in words how far two pictures are apart."""
    if old.shape != new.shape:
        return f"{new.shape[1]}x{new.shape[0]} in place of {old.shape[1]}x{old.shape[0]}"
    difference = np.abs(new.astype(int) - old).max(axis=-1)
    text = f"{(difference > STEP).mean():.2%} of the pixels differ, by up to {difference.max()}/255"
    try:
        return f"{text}, FLIP {metrics.flip_mean(new, old):.4f}"
    except UserError:  # the package is an extra
        return text


# --- pytest ---


def add_options(parser: pytest.Parser) -> None:
    """Add `--bless` and `--yes`."""
    parser.addoption("--bless", action="store_true", help="make golden pictures anew, after showing them")
    parser.addoption("--yes", action="store_true", help="with --bless: take every new picture without asking")


_KEPT = pytest.StashKey[Goldens]()


def pytest_configure(config: pytest.Config) -> None:
    """Keep one set of goldens for the run."""
    config.stash[_KEPT] = Goldens(bless=config.getoption("--bless"))


@pytest.fixture
def golden(
    request: pytest.FixtureRequest, record_property: Callable[[str, object], None]
) -> Callable[..., None]:
    """Return `check(name, picture, capabilities, **facts)`; see `Goldens.check`."""
    area = request.path.relative_to(ROOT / "tests").parts[0]
    first = first_chapter(request.path)
    areas = [area]
    if first is not None:
        areas = [folder_name(n) for n in range(first, tested(request.node).number + 1)]

    def check(name: str, picture: np.ndarray, capabilities: Capabilities, **facts: float) -> None:
        kept = request.config.stash[_KEPT]
        why = kept.check(kept.place(areas, name, picture), picture, Maker.of(capabilities), facts)
        record_property(f"golden {name}", why or "compared")
        if why and not kept.bless:
            warnings.warn(GoldenNotCompared(f"{name}: pixels were not compared, {why}"), stacklevel=2)

    return check


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    """With `--bless`: show, ask, write."""
    goldens = config.stash[_KEPT]
    if not goldens.proposals:
        return
    terminalreporter.section("goldens", sep="=")
    capture = config.pluginmanager.getplugin("capturemanager")
    if capture is not None:
        capture.suspend_global_capture(in_=True)
    terminal = sys.stdin is not None and sys.stdin.isatty()

    def ask(question: str) -> bool:
        if config.getoption("--yes"):
            return True
        return terminal and input(f"{question} [y/N] ").strip().lower() in ("y", "yes")

    try:
        written = goldens.finish(terminalreporter.line, ask)
    finally:
        if capture is not None:
            capture.resume_global_capture()
    if not terminal and not config.getoption("--yes"):
        terminalreporter.line("Nothing was changed: without a terminal to ask at, add --yes.")
    else:
        terminalreporter.line(f"{written} goldens were written.")
