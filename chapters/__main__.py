"""`python -m chapters`: the command line, behind the one place where an error becomes a sentence and an exit code."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from common.errors import ShaderError, StrataError
from common.paths import ROOT

LIBRARY = ("common", "backends", "chapters", "tools", "assets", "bootstrap")
"""Folders of the clone whose frames a traceback shows only with -v; a chapter's own folder is the reader's code."""


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run one command and exit.

    With 0, 1 for a fault of ours, 2 for one of the user's, 130 after Ctrl-C, 143 after SIGTERM, 141 if the output pipe
    is closed.
    """
    try:
        words = list(sys.argv[1:] if arguments is None else arguments)
        sys.exit(run(words))
    except KeyboardInterrupt:  # while the modules below were imported, or after all was done
        print("strata: stopped.", file=sys.stderr)
        sys.exit(130)


def run(words: list[str]) -> int:
    """Run one command and return its exit code; nothing is raised."""
    from tools.cli import console

    console.prepare()
    try:
        from tools.cli.commands import invoke

        code = invoke(words)
        sys.stdout.flush()  # here, where a full disk is a sentence
        return code
    except SystemExit as ended:
        if console.reader_is_gone(ended.__context__):  # rich and typer make this of it
            return console.READER_GONE
        raise
    except StrataError as error:
        console.say(f"strata: {error}")
        # A wrong input is no one's code. A fault of a chapter or a shader is code that the reader may be writing.
        if error.exit_code == 1 and not isinstance(error, ShaderError):
            console.say(reader_trace(error, whole="-v" in words))
        return error.exit_code
    except KeyboardInterrupt:
        from tools.cli.stopping import stop_code

        console.say("strata: stopped.")
        return stop_code()
    except MemoryError:
        console.say("strata: this does not fit into memory; a smaller --size or scene may.")
        return 2
    except OSError as error:
        if console.reader_is_gone(error):
            return console.READER_GONE
        if error.filename is None and error.errno is None:
            raise
        where = f"{error.filename}: " if error.filename else ""
        console.say(f"strata: {where}{error.strerror or error}.")
        if not error.filename:
            console.drop_output()
        console.say(reader_trace(error, whole=True)) if "-v" in words else None
        return 2
    except Exception as error:
        console.say(f"strata: {type(error).__name__}: {error}")
        console.say(reader_trace(error, whole="-v" in words))
        console.say("strata: this is a fault of the code, not of what you typed." + _hint(words))
        return 1


def _hint(words: list[str]) -> str:
    return "" if "-v" in words else " -v shows all of the traceback."


def reader_trace(error: BaseException, whole: bool) -> str:
    """Return the traceback of `error`, cut to the lines of chapters and of the reader's own files unless `whole`.

    An error that never touched those keeps its last line of our code, so that there is always a place to look at.
    """
    frames = traceback.extract_tb(error.__traceback__)
    if not whole:
        own = [frame for frame in frames if is_readers(Path(frame.filename))]
        ours = [frame for frame in frames if Path(frame.filename).is_relative_to(ROOT)]
        frames = traceback.StackSummary.from_list(own or ours[-1:])
    lines = traceback.format_list(frames)
    if isinstance(error, SyntaxError):  # the line that is wrong was never run: no frame has it
        lines += traceback.format_exception_only(error)[:-1]
    return "".join(lines).rstrip()


def is_readers(path: Path) -> bool:
    """Whether a file is a chapter's or the reader's own: neither foundation nor an installed package."""
    if "site-packages" in path.parts or not path.exists():
        return False
    if not path.is_relative_to(ROOT):
        return not path.is_relative_to(Path(sys.base_prefix))
    parts = path.relative_to(ROOT).parts
    in_chapter = len(parts) > 2 and parts[0] == "chapters" and parts[1].startswith("ch")
    return in_chapter or (len(parts) > 1 and parts[0] not in LIBRARY)  # a fork may lie beside these folders


if __name__ == "__main__":
    main()
