"""Packages that not every machine has: missing and broken ones are told the same way."""

from __future__ import annotations

import importlib
from types import ModuleType


def load(name: str) -> ModuleType:
    """Return the module of a package.

    Raises:
        ImportError: the package is missing or its import raises anything, as a library built for another processor
            does. The text continues a sentence: "is not installed", "cannot be imported (OSError: ...)".
    """
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if (error.name or name) == name:
            raise ImportError("is not installed") from None
        raise ImportError(f"cannot be imported ({error})") from error
    except Exception as error:
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        raise ImportError(f"cannot be imported ({reason})") from error
