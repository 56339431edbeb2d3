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
    """The graphics driver refused a call or was lost; the text names the call and gives a hint.

    `is_full`: there is no memory for what was asked. That is too large, and the code has no fault.
    """

    def __init__(self, text: str, is_full: bool = False) -> None:
        super().__init__(text)
        self.is_full = is_full
        if is_full:
            self.exit_code = UserError.exit_code

    def __reduce__(self) -> tuple[type[DeviceError], tuple[str, bool]]:
        """Be the same sentence in another process, where the call's arguments mean nothing."""
        return DeviceError, (str(self), self.is_full)

    def add_size(self, what: str, size: int) -> None:
        """Name what finds no memory, and its bytes, in front of the call that failed; other errors stay as they are."""
        if self.is_full:
            call = str(self).partition(": ")[0]
            needs = f"There is no memory on the device for {what}, {size / 2**20:,.1f} MiB"
            self.args = (f"{needs}: a smaller --size or scene needs less ({call}).",)


class StaleFrameError(StrataError):
    """An image was asked for after its frame's slot was used again, or it was not among `outputs`."""
