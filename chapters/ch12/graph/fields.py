"""Fields of a graph file: JSON values that are read by type, with their place in each error."""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from common.names import suggest

from .json_places import Value, brief, line_and_column
from .types import GraphError

MAX_SIDE, MAX_SCALE = 16384, 8.0
"""The largest side of an image in pixels, and the largest scale relative to the picture."""

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_-]{0,63}")
"""Names become labels, keys of counters and parts of file names."""


@dataclass(frozen=True)
class Field:
    """A value of the file; `path` is its place, such as "passes[2].format.color_lit"."""

    file: Path
    text: str
    path: str
    value: Value

    @property
    def line(self) -> int:
        """The line in which the value begins."""
        return line_and_column(self.text, self.value.at)[0]

    def wrong(self, problem: str, at: int | None = None) -> GraphError:
        """Return the error with the sentence: place, field and `problem`, which may end in a suggestion.

        The place is that of the value, or of the character of index `at`.
        """
        line, column = line_and_column(self.text, self.value.at if at is None else at)
        end = "" if problem.endswith("?") else "."
        return GraphError(f"{self.file}:{line}:{column}: {self.path or 'the graph'} {problem}{end}")

    def wrong_key(self, problem: str) -> GraphError:
        """Return the same error with the place of the value's key."""
        return self.wrong(problem, self.value.key_at)

    def _is(self, kind: type, called: str) -> Any:
        if type(self.value.content) is not kind:
            raise self.wrong(f"must be {called}, and is {self.value.kind}")
        return self.value.content

    def members(self, known: Collection[str] | None = None) -> dict[str, Field]:
        """Return an object's values by key; raise GraphError for a key that is not `known`."""
        fields = {}
        for key, value in self._is(dict, "an object, {...}").items():
            label = key if _NAME.fullmatch(key) else brief(key)
            inner = Field(self.file, self.text, f"{self.path}.{label}".lstrip("."), value)
            if known is not None and key not in known:
                raise inner.wrong_key(f"is no key of this{suggest(key, known)}")
            fields[key] = inner
        return fields

    def items(self) -> list[Field]:
        """Return a list's values."""
        content = self._is(tuple, "a list, [...]")
        return [Field(self.file, self.text, f"{self.path}[{i}]", value) for i, value in enumerate(content)]

    def word(self) -> str:
        """Return a text."""
        return str(self._is(str, "a text"))

    def name(self) -> str:
        """Return a text that can be a name."""
        word = self.word()
        if not _NAME.fullmatch(word):
            raise self.wrong(
                f"is {brief(word)}: a name has up to 64 letters without accents, digits, _ and -"
            )
        return word

    def names(self) -> dict[str, Field]:
        """Return an object whose values are names."""
        fields = self.members()
        for inner in fields.values():
            inner.name()
        return fields

    def flag(self) -> bool:
        """Return true or false."""
        return bool(self._is(bool, "true or false"))

    def scale(self) -> float:
        """Return a factor above 0 and up to `MAX_SCALE`."""
        content = self.value.content
        if isinstance(content, bool) or not isinstance(content, int | float):
            raise self.wrong(f"must be a number, and is {self.value.kind}")
        if not 0 < content <= MAX_SCALE:
            raise self.wrong(f"is {brief(content)}: a scale is above 0 and at most {MAX_SCALE:g}")
        return float(content)

    def size(self) -> tuple[int, int]:
        """Return [width, height] in pixels."""
        sides = self.items()
        if len(sides) != 2:
            raise self.wrong(f"must be [width, height], and has {len(sides)} numbers")
        for side in sides:
            content = side.value.content
            if type(content) is not int or not 1 <= content <= MAX_SIDE:
                shown = brief(content) if type(content) in (int, float) else side.value.kind
                raise side.wrong(f"is {shown}: a side is a whole number of pixels, 1 to {MAX_SIDE}")
        width, height = (side.value.content for side in sides)
        return int(width), int(height)  # type: ignore[arg-type]

    def format(self, formats: Collection[str]) -> str:
        """Return one of `formats`."""
        word = self.word()
        if word not in formats:
            raise self.wrong(f"is {brief(word)}, which is no format{suggest(word, formats)}")
        return word
