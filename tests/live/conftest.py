"""What the tests of live shaders share: a copy of the shaders that may be edited, and a renderer that uses it."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from backends import shader_text
from chapters.ch01.pipelines import gl as on_gl
from chapters.ch01.pipelines import vulkan as on_vulkan
from tests.support.chapter import Chapter
from tests.support.gl_functions import assert_silent

PLAIN = "out_color = vec4(srgb_from_linear(clamp(color, 0.0, 1.0)), 1.0);"
"""What tonemap.frag writes."""


class Shaders:
    """A copy of a chapter's shaders and of the common ones, edited as editors do."""

    def __init__(self, folder: Path) -> None:
        self.chapter, self.common = folder / "chapter", folder / "common"
        shutil.copytree(
            on_vulkan.CHAPTER,
            self.chapter,
            ignore=shutil.ignore_patterns("*.py", "*.md", "studies", "__pycache__"),
        )
        shutil.copytree(shader_text.SHADERS, self.common)

    def edit(self, name: str, old: str, new: str) -> Path:
        """Replace a piece of a file that is there once."""
        path = self.chapter / name
        text = path.read_text("utf-8")
        assert text.count(old) == 1, (name, old)
        return self.save(name, text.replace(old, new))

    def save(self, name: str, text: str) -> Path:
        """Write a file in place."""
        path = self.chapter / name
        path.write_text(text, "utf-8")
        return path

    def replace(self, name: str, text: str) -> Path:
        """Write a new file and rename it over the old one; it looks as old as a file from an archive."""
        path = self.chapter / name
        new = path.with_suffix(".new")
        new.write_text(text, "utf-8")
        os.utime(new, (1e9, 1e9))
        os.replace(new, path)
        return path

    def paint(self, red: float, green: float, blue: float) -> Path:
        """Have tonemap.frag write one colour, whatever is there."""
        path = self.chapter / "post/tonemap.frag"
        text = path.read_text("utf-8")
        line = next(line for line in text.splitlines() if line.lstrip().startswith("out_color = "))
        return self.save(
            "post/tonemap.frag", text.replace(line, f"    out_color = vec4({red}, {green}, {blue}, 1.0);")
        )


@pytest.fixture
def shaders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Shaders:
    """The copy, in use by every renderer that is opened in this test."""
    made = Shaders(tmp_path / "shaders")
    for module in (on_vulkan, on_gl):
        monkeypatch.setattr(module, "CHAPTER", made.chapter)
    monkeypatch.setattr(shader_text, "SHADERS", made.common)
    return made


@pytest.fixture(scope="module", params=["vulkan", "gl"])
def chapter(request: pytest.FixtureRequest) -> Chapter:
    """Chapter 1 on a device of each backend."""
    device: Any = request.getfixturevalue("vulkan_device" if request.param == "vulkan" else "gl_context")
    return Chapter(1, request.param, device)


@pytest.fixture(autouse=True)
def _silent(request: pytest.FixtureRequest) -> Iterator[None]:
    """Fail a test on any message of the layers or the driver."""
    if "chapter" not in request.fixturenames:
        yield
        return
    chapter: Chapter = request.getfixturevalue("chapter")
    chapter.device.sink.messages.clear()
    if chapter.backend == "gl":
        chapter.device.make_current()
    yield
    if chapter.backend == "gl":
        assert_silent(chapter.device)
    else:
        assert chapter.device.sink.report() == []
