"""What `strata compare` compares: the texts of its two sides, read as a chapter, a fork, a study or a picture's file.

1                     a chapter, with the preset of --quality
1@gl                  on a backend
1:msaa=4,anisotropy=1 with settings, 1:low with a preset, 1:without=anisotropy as on a device that lacks it
1-bindless            a fork: the folder chapters/ch01-bindless (or ch01_bindless), made as a copy of chapter 1
out/a.png             a picture as it is shown (.png, .jpg); linear light in .exr and .hdr
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

import chapters
from backends.contract import check_without
from common import images
from common.errors import SettingError, UnsupportedError, UserError
from common.names import suggest
from common.settings import apply_overrides, knobs, preset

Float32 = NDArray[np.float32]

BACKEND_NAMES = {"vulkan": "Vulkan", "gl": "OpenGL"}
LINEAR = (".exr", ".hdr")
"""Suffixes of files that hold light; the others hold what is shown."""

WANTED = ("color", "color_linear")
_FORK = re.compile(r"(?:ch)?0*(\d+)[-_]([\w-]+)", re.ASCII | re.IGNORECASE)


@dataclass(frozen=True)
class Drawn:
    """A side that a renderer draws. `which` is what `chapters.open` takes; of a fork, the name of its folder."""

    text: str
    which: int | str
    fork: bool
    backend: str
    settings: Any
    quality: str
    without: tuple[str, ...]

    @property
    def spoken(self) -> str:
        """What draws, in the middle of a sentence."""
        if self.fork:
            return f"the fork {_short(str(self.which))}"
        return f"chapter {self.which}" if isinstance(self.which, int) else f"the study {self.which}"

    @property
    def module(self) -> ModuleType:
        """The module with the renderer; raises UnsupportedError where this backend has none."""
        if not self.fork:
            return chapters.renderer_module(self.which, self.backend)  # type: ignore[arg-type,unused-ignore]
        package = f"chapters.{self.which}.gl" if self.backend == "gl" else f"chapters.{self.which}"
        if find_spec(package) is None or find_spec(f"{package}.renderer") is None:
            raise UnsupportedError(f"{self.text}: this fork has no OpenGL version; compare it on Vulkan.")
        return import_module(f"{package}.renderer")

    @property
    def outputs(self) -> tuple[str, ...]:
        """Which of the wanted images it can give."""
        if self.fork:
            known: tuple[str, ...] = import_module(f"chapters.{self.which}.renderer").OUTPUTS
        else:
            known = chapters.outputs_of(self.which)  # type: ignore[arg-type,unused-ignore]
        return tuple(name for name in WANTED if name in known)


@dataclass(frozen=True, eq=False)
class Picture:
    """A side that is a file: linear light or what is shown, (H, W, 3) float32; the other one is None."""

    text: str
    path: Path
    linear: Float32 | None
    shown: Float32 | None
    note: str = ""
    """What of the file was left out, as a sentence."""

    @property
    def spoken(self) -> str:
        """What it is, in the middle of a sentence."""
        return f"the picture {self.path.name}"

    @property
    def size(self) -> tuple[int, int]:
        """Width and height."""
        pixels = self.shown if self.linear is None else self.linear
        assert pixels is not None
        return pixels.shape[1], pixels.shape[0]


Side = Drawn | Picture


def comparable(a: Side, b: Side) -> None:
    """Raise UserError where one side has only light and the other only what is shown."""
    for one, other in ((a, b), (b, a)):
        if "color" not in _images(one) and "color_linear" not in _images(other):
            raise UserError(
                f"{one.text} is linear light and {other.text} is what is shown: "
                "compare .exr or .hdr with each other, or .png with .png."
            )


def _images(side: Side) -> tuple[str, ...]:
    if isinstance(side, Drawn):
        return side.outputs
    return ("color",) if side.linear is None else ("color_linear",)


def read_side(text: str, quality: str, without: tuple[str, ...] = ()) -> Side:
    """Return what `text` means, files read and settings checked; no device is opened.

    Raises UserError: there is no such chapter, fork, backend, setting, preset or file, or it is no picture.
    """
    path = Path(text).expanduser()
    if path.suffix.lower() in images.READABLE or (path.suffix and path.is_file()):
        return _read_picture(text, path)
    head, colon, tail = text.partition(":")
    name, at, backend = head.partition("@")
    if "@" in tail:
        raise UserError(f"{text}: the backend stands before the settings, as in 1@gl:msaa=4.")
    which, fork = _parse(name)
    if at and not backend:
        raise UserError(f"{text}: no backend stands after the @; write {name}@gl or {name}@vulkan.")
    if colon and not all(item.strip() for item in tail.split(",")):
        raise UserError(f"{text}: a setting is missing after the colon; write {head}:msaa=4 or {head}:low.")
    try:
        settings, quality, off = _settings(_settings_class(which, fork), tail, quality)
        off = tuple(sorted({*without, *off}))
        check_without(off)
    except UserError as error:
        raise type(error)(f"{text}: {error}") from None
    side = Drawn(text, which, fork, chapters.choose_backend(backend or "auto"), settings, quality, off)
    side.module  # noqa: B018  # for its errors
    return side


def forks() -> dict[str, str]:
    """Return the folders of all forks by the name that the command line takes: {"1-bindless": "ch01_bindless"}."""
    places = [Path(place) for place in chapters.__path__]
    found = [path.parent.name for place in places for path in place.glob("ch[0-9][0-9][-_]*/renderer.py")]
    return {_short(folder): folder for folder in sorted(found)}


def _short(folder: str) -> str:
    """Return "1-bindless" for "ch01_bindless"."""
    return f"{int(folder[2:4])}-{folder[5:].replace('_', '-')}"


def _parse(name: str) -> tuple[int | str, bool]:
    """Return the chapter, study or folder of a fork that is meant, and whether it is a fork."""
    match = _FORK.fullmatch(name)
    if match is None:
        return chapters.parse(name), False
    wanted, known = f"{int(match[1])}-{match[2].lower().replace('_', '-')}", forks()
    by_lower = {short.lower(): folder for short, folder in known.items()}
    if wanted not in by_lower:
        folder = f"{chapters.folder_name(int(match[1]))}_{match[2].replace('-', '_')}"
        near = suggest(wanted, known)
        why = near if near.endswith("?") else f": no chapter was copied to chapters/{folder}{near}."
        raise UserError(f"There is no fork {name!r}{why}")
    return by_lower[wanted], True


def _settings_class(which: int | str, fork: bool) -> Any:
    if fork:
        return import_module(f"chapters.{which}.settings").Settings
    return chapters.settings_class(which)  # type: ignore[arg-type,unused-ignore]


def _settings(kind: Any, text: str, quality: str) -> tuple[Any, str, tuple[str, ...]]:
    """Return settings, preset and features to do without, of a text such as "low,msaa=4,without=anisotropy"."""
    presets = getattr(kind, "PRESETS", {})
    overrides, named, off = [], [], []
    for item in (part.strip() for part in text.split(",") if part.strip()):
        key, equals, value = (part.strip() for part in item.partition("="))
        if key == "without" and equals:
            off.append(value)
        elif equals or key.replace("-", "_") in knobs(kind):
            overrides.append(item)  # a knob without a value is refused with its name
        elif key in presets:
            named.append(key)
        else:
            near = suggest(key, [*presets, *knobs(kind), "without"])
            near = near if near.endswith("?") else suggest(key, presets)
            raise SettingError(
                f"there is no preset or setting {key!r}{near}{'' if near.endswith('?') else '.'}"
            )
    if len(named) > 1:
        raise SettingError(f"{named[0]} and {named[1]} are two presets, and one is possible.")
    if presets:
        quality = named[0] if named else quality
        settings = preset(kind, quality)
    else:
        settings = kind()  # a study has one set of settings
    return apply_overrides(settings, overrides), quality, tuple(off)


def _read_picture(text: str, path: Path) -> Picture:
    if not path.exists():
        siblings = path.parent.glob("*") if path.parent.is_dir() else ()
        near = suggest(path.name, [p.name for p in siblings if p.suffix.lower() in images.READABLE])
        raise UserError(f"There is no file {text}{near}{'' if near.endswith('?') else '.'}")
    try:
        pixels = images.read_image(path)
    except UserError as error:
        raise UserError(f"{str(error).rstrip('.')}.") from None
    channels, note = pixels.shape[2], ""
    if channels in (2, 4) and (channels == 4 or path.suffix.lower() != ".exr"):
        if (pixels[..., -1] != (1 if pixels.dtype.kind == "f" else np.iinfo(pixels.dtype).max)).any():
            note = f"The alpha of {path.name} is left out."
        pixels = pixels[..., :-1]
    if pixels.shape[2] not in (1, 3):
        raise UserError(
            f"{text} has {channels} channels: a picture to compare has grey, or red, green and blue."
        )
    pixels = np.broadcast_to(pixels, (*pixels.shape[:2], 3))
    if path.suffix.lower() in LINEAR:
        return Picture(text, path, pixels.astype(np.float32), None, note)
    return Picture(text, path, None, shown_values(pixels), note)


def shown_values(pixels: NDArray[Any]) -> Float32:
    """Return integers of 8 or 16 bits as float32 of 0 to 1, the first three channels."""
    return pixels[..., :3].astype(np.float32) / np.float32(np.iinfo(pixels.dtype).max)
