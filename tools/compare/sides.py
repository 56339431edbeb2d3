"""What `strata compare` compares: the texts of its two sides, read as a chapter, a fork, a study or a picture's file.

1                     a chapter, with the preset of --quality
1@gl                  on a backend
1:msaa=4,anisotropy=1 with settings, 1:low with a preset, 1:without=anisotropy as on a device that lacks it
my-ch01, ../my-ch01   a fork: a folder with a copy of a chapter, with @ and : as a chapter
out/a.png             a picture as it is shown (.png, .jpg); linear light in .exr and .hdr
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

import chapters
from backends.contract import check_without
from common import images
from common.errors import SettingError, UserError
from common.names import suggest
from common.settings import apply_overrides, knobs, preset

Float32 = NDArray[np.float32]

BACKEND_NAMES = {"vulkan": "Vulkan", "gl": "OpenGL"}
LINEAR = (".exr", ".hdr")
"""Suffixes of files that hold light; the others hold what is shown."""

WANTED = ("color", "color_linear")
_DRIVE = re.compile(r"[A-Za-z]:[\\/]")


@dataclass(frozen=True)
class Drawn:
    """A side that a renderer draws; `which` is what `chapters.open` takes."""

    text: str
    which: chapters.Which
    backend: str
    settings: Any
    quality: str
    without: tuple[str, ...]

    @property
    def spoken(self) -> str:
        """What draws, in the middle of a sentence."""
        if isinstance(self.which, int):
            return f"chapter {self.which}"
        return f"the study {self.which}" if isinstance(self.which, str) else f"the fork {self.which.spoken}"

    @property
    def module(self) -> ModuleType:
        """The module with the renderer; raises UnsupportedError where this backend has none."""
        return chapters.renderer_module(self.which, self.backend)

    @property
    def outputs(self) -> tuple[str, ...]:
        """Which of the wanted images it can give."""
        return tuple(name for name in WANTED if name in chapters.outputs_of(self.which))


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
    name, at, backend, colon, tail = _parts(text)
    if "@" in tail:
        raise UserError(f"{text}: the backend stands before the settings, as in 1@gl:msaa=4.")
    which = chapters.parse(name)
    if at and not backend:
        raise UserError(f"{text}: no backend stands after the @; write {name}@gl or {name}@vulkan.")
    if colon and not all(item.strip() for item in tail.split(",")):
        raise UserError(f"{text}: a setting is missing after the colon; write {name}:msaa=4 or {name}:low.")
    try:
        settings, quality, off = _settings(chapters.settings_class(which), tail, quality)
        off = tuple(sorted({*without, *off}))
        check_without(off)
    except UserError as error:
        raise type(error)(f"{text}: {error}") from None
    side = Drawn(text, which, chapters.choose_backend(backend or "auto", which), settings, quality, off)
    side.module  # noqa: B018  # for its errors
    return side


def _parts(text: str) -> tuple[str, str, str, str, str]:
    """Return what stands before, at and behind the "@" of a text such as "1@gl:msaa=4", then the same of the ":".

    A folder may have both in its name, and on Windows its drive: what is there whole is taken whole.
    """
    if Path(text).expanduser().is_dir():
        return text, "", "", "", ""
    drive = _DRIVE.match(text)
    begin = drive[0] if drive else ""
    head, colon, tail = text[len(begin) :].partition(":")
    name, at, backend = head.rpartition("@")
    if not at or "/" in backend or os.sep in backend:
        name, at, backend = head, "", ""  # an "@" of a folder
    return begin + name, at, backend, colon, tail


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
