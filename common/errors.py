"""The family of exceptions whose text is one sentence that a user can act on."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path


class StrataError(Exception):
    """Something went wrong inside Strata; the command line exits with `exit_code`."""

    exit_code = 1


class UserError(StrataError):
    """The input is wrong: a path, an option, a setting. The text says what, where, and what to do."""

    exit_code = 2


class SceneError(UserError):
    """A scene file cannot be used; the text names the file and the place in it."""


class SettingError(UserError):
    """A setting has a wrong name or a value out of its range."""


class UnsupportedError(UserError):
    """This machine, driver or backend cannot do what was asked."""


class ShaderError(StrataError):
    """A shader does not compile; the text carries file, line, source line with caret and the chain of includes.

    `files` are those on which the shader depends: a change of one of them may repair it.
    """

    def __init__(self, text: str, files: Iterable[Path] = ()) -> None:
        super().__init__(text)
        self.files = frozenset(files)


class DeviceError(StrataError):
    """The graphics driver refused a call or was lost; the text names the call and gives a hint."""


class StaleFrameError(StrataError):
    """An image was asked for after its frame's slot was used again, or it was not among `outputs`."""
