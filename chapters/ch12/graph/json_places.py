"""A JSON parser whose values keep their places, so that errors about a value can name file, line and column.

Python's `json` has places for syntax errors, but not for well-formed values. So this module parses lists and objects,
and leaves strings, numbers, true, false and null to `json`.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from typing import NoReturn

DEEPEST = 32
"""The depth of nested lists and objects: graph files need less, and Python's stack is limited."""

_SPACE = re.compile(r"[ \t\n\r]*")


class JsonError(ValueError):
    """A syntax error, and the index of its character."""

    def __init__(self, what: str, at: int) -> None:
        super().__init__(what)
        self.at = at


@dataclass(frozen=True)
class Value:
    """A value of a JSON text. `at` is the index of its first character, `key_at` that of its key in an object."""

    content: bool | int | float | str | tuple[Value, ...] | dict[str, Value] | None
    at: int
    key_at: int

    @property
    def kind(self) -> str:
        """The type of the value, as a phrase for messages."""
        names = {bool: "true or false", int: "a number", float: "a number", str: "a text", tuple: "a list"}
        return "null" if self.content is None else names.get(type(self.content), "an object")


def brief(value: object) -> str:
    """Return a value for a message, on one line of bounded length."""
    text = repr(value)
    return text if len(text) <= 40 else f"{text[:37]}..."


def line_and_column(text: str, at: int) -> tuple[int, int]:
    """Return line and column of the character of index `at`, counted from 1 as in editors."""
    return text.count("\n", 0, at) + 1, at - text.rfind("\n", 0, at)


def parse(text: str) -> Value:
    """Return the value of `text`. Raises JsonError unless it is one value."""
    return _Parser(text).whole()


def _no_number(word: str) -> NoReturn:
    raise ValueError(f"{word} is no number in JSON")


class _Parser:
    """Parses a text once; `at` is the index of the next character."""

    _decoder = json.JSONDecoder(parse_constant=_no_number)

    def __init__(self, text: str) -> None:
        self.text, self.at, self.depth = text, 0, 0

    def whole(self) -> Value:
        """Return the value of the whole text."""
        value = self.value()
        if self.next():
            raise JsonError("more follows where the file should end", self.at)
        return value

    def next(self) -> str:
        """Return the next character that is no space, without consuming it; "" at the end."""
        spaces = _SPACE.match(self.text, self.at)
        assert spaces is not None, "it matches no space too"
        self.at = spaces.end()
        return self.text[self.at : self.at + 1]

    def expect(self, what: str) -> bool:
        """Consume the next character, which is one of `what`; return whether it is the last of `what`."""
        char = self.next()
        if not char or char not in what:
            self.refuse_comment()
            expected = " or ".join(repr(char) for char in what)
            raise JsonError(f"{expected} is missing before {self.seen()}", self.at)
        self.at += 1
        return char == what[-1]

    def seen(self) -> str:
        """Return the text at the current place, for a message."""
        word = re.match(r"\S{1,20}", self.text[self.at : self.at + 20])
        return repr(word[0]) if word else "the end of the file"

    def value(self, key_at: int | None = None) -> Value:
        """Parse one value and return it."""
        char, at = self.next(), self.at
        key_at = at if key_at is None else key_at
        if char not in ("{", "["):
            return Value(self.scalar(), at, key_at)
        if self.depth == DEEPEST:
            raise JsonError(f"more than {DEEPEST} lists and objects are inside one another", at)
        self.depth += 1
        self.at += 1
        value_ = Value(self.members() if char == "{" else self.items(), at, key_at)
        self.depth -= 1
        return value_

    def items(self) -> tuple[Value, ...]:
        """Parse the items of a list and its end; return the items."""
        items: list[Value] = []
        if self.next() == "]":
            self.at += 1
            return ()
        while True:
            items.append(self.value())
            if self.expect(",]"):
                return tuple(items)
            self.refuse_end("]")

    def members(self) -> dict[str, Value]:
        """Parse the members of an object and its end; return the members. A repeated key is an error."""
        members: dict[str, Value] = {}
        if self.next() == "}":
            self.at += 1
            return {}
        while True:
            if self.next() != '"':
                self.refuse_comment()
                raise JsonError(f"a key in double quotes is missing before {self.seen()}", self.at)
            at = self.at
            key = str(self.scalar())
            if key in members:
                line, _ = line_and_column(self.text, members[key].key_at)
                raise JsonError(f"the key {brief(key)} is here twice, first in line {line}", at)
            self.expect(":")
            members[key] = self.value(at)
            if self.expect(",}"):
                return members
            self.refuse_end("}")

    def refuse_comment(self) -> None:
        """Raise JsonError at a comment: JSON has none."""
        if self.text.startswith(("//", "/*", "#"), self.at):
            raise JsonError("it has no comments", self.at)

    def refuse_end(self, char: str) -> None:
        """Raise JsonError if a list or an object ends after a comma, which JSON does not allow."""
        at = self.at
        if self.next() == char:
            raise JsonError(f"the comma has nothing behind it but {char!r}", self.text.rindex(",", 0, at))

    def scalar(self) -> bool | int | float | str | None:
        """Parse a text, a number, true, false or null, and return it."""
        at = self.at
        self.refuse_comment()
        try:
            content, self.at = self._decoder.raw_decode(self.text, at)
        except json.JSONDecodeError as error:
            if error.msg == "Expecting value":
                raise JsonError(f"a value is missing before {self.seen()}", at) from None
            reason = error.msg[:1].lower() + error.msg[1:].removesuffix(" at")
            raise JsonError(f"{reason} in a text", error.pos) from None
        except ValueError as error:  # NaN, Infinity, and more digits than Python converts
            problem = str(error) if "no number" in str(error) else "a number has too many digits"
            raise JsonError(problem, at) from None
        if isinstance(content, str) and any("\ud800" <= char <= "\udfff" for char in content):
            raise JsonError("a text holds half a character (one \\ud800 to \\udfff alone)", at)
        return content
