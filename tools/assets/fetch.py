"""Fetches the files of a model: resumed where they were cut short, checked, and only then under their names.

A file that is under way is called NAME.part. It becomes NAME by a rename, after its size and its SHA-256 were found to
be those of the manifest, so that whoever sees NAME sees all of it.
"""

from __future__ import annotations

import errno
import http.client
import re
import shutil
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from urllib.error import HTTPError, URLError
from urllib.parse import urlsplit
from urllib.request import Request, urlopen

from bootstrap.environment import try_lock
from common.errors import UserError
from common.models.manifest import SOURCES, Model, PinnedFile
from common.models.store import folder_of, in_bytes, is_whole, sha256_of, writable_place

TIMEOUT_S = 30.0
"""How long a server may be silent."""
TRIES = 10
"""How often a file is asked for that was cut short; each time must have brought something."""
CHUNK = 1 << 18

Progress = Callable[[float, str], object]
"""Called with the part of all bytes that is here, 0 to 1, and the file that is under way."""


class _CutShortError(Exception):
    """The connection ended, or there never was one; what arrived is in the part."""


def fetch(
    model: Model,
    progress: Progress = lambda _part, _name: None,
    sources: Mapping[str, str] = SOURCES,
    pause_s: float = 1.0,
) -> int:
    """Bring every file of a model that is not here; return how many bytes came over the network.

    A file that is here but is not the pinned one is fetched anew. Stopped at any point, the next call goes on where
    this one was; `pause_s` is waited before a file that was cut short is asked for again.

    Raises:
        UserError: another process is fetching this model, there is no network, the server has no such file or gives
            other bytes, the disk is full or cannot be written. One sentence.
    """
    writable_place()
    folder, host = folder_of(model), urlsplit(model.url(model.files[0], sources)).hostname or ""
    try:
        folder.mkdir(exist_ok=True)
        with _alone(folder, model.name):
            missing = [file for file in model.files if not is_whole(folder / file.name, file)]
            needed = sum(file.size - _size(_part(folder / file.name)) for file in missing)
            if shutil.disk_usage(folder).free < needed:
                raise _full(folder, needed)
            done = model.size - sum(file.size for file in missing)
            came = 0
            for file in missing:

                def advance(bytes_here: int, before: int = done, name: str = file.name) -> None:
                    progress((before + bytes_here) / model.size, name)

                (folder / file.name).unlink(missing_ok=True)
                came += _bring(model.url(file, sources), folder / file.name, file, host, advance, pause_s)
                done += file.size
            return came
    except OSError as error:
        if error.errno == errno.ENOSPC:
            raise _full(folder, 0) from None
        raise UserError(f"{folder} cannot be written ({error.strerror or error}).") from None


def unfinished(model: Model) -> int:
    """Return how many bytes of a model are here in parts."""
    return sum(_size(_part(folder_of(model) / file.name)) for file in model.files)


@contextmanager
def _alone(folder: Path, name: str) -> Iterator[None]:
    """Hold the lock of a model's folder, which the system ends with its holder; raise UserError if it is taken."""
    with open(folder / ".lock", "ab") as stream:
        if not try_lock(stream.fileno()):
            raise UserError(f"{name} is being fetched by another strata: wait for that.")
        yield


def _bring(
    url: str, target: Path, file: PinnedFile, host: str, advance: Callable[[int], None], pause_s: float
) -> int:
    """Fetch one file into its part, check that and give it its name; return how many bytes came."""
    target.parent.mkdir(parents=True, exist_ok=True)
    part, came = _part(target), 0
    for tried in range(TRIES):
        before = _size(part)
        if before == file.size:
            break
        try:
            came += _receive(url, part, file, host, advance)
        except _CutShortError as error:
            here = _size(part)
            came += max(here - before, 0)
            if here == before or tried == TRIES - 1:
                raise UserError(_cut_short(file, here, host, str(error))) from None
            time.sleep(pause_s)
    if (found := sha256_of(part)) != file.sha256:
        part.unlink()
        raise UserError(
            f"{file.name} from {host} is not the file of the manifest (SHA-256 {found[:12]}..., not "
            f"{file.sha256[:12]}...): it was thrown away."
        )
    part.replace(target)
    return came


def _receive(url: str, part: Path, file: PinnedFile, host: str, advance: Callable[[int], None]) -> int:
    """Ask for what the part lacks and append it; return how many bytes came. The part is whole afterwards."""
    have = _size(part)
    if have > file.size:  # a part of something else
        part.unlink()
        have = 0
    headers = {"User-Agent": "strata", "Accept-Encoding": "identity"}
    if have:
        headers["Range"] = f"bytes={have}-"
    try:
        response = urlopen(Request(url, headers=headers), timeout=TIMEOUT_S)
    except HTTPError as error:
        error.close()
        if error.code == 416 and have:  # the server's file ends before ours does
            part.unlink()
            raise UserError(
                f"{file.name} at {host} is shorter than the manifest says: it was thrown away."
            ) from None
        raise UserError(f"{host} answers {error.code} {error.reason} for {url}: try later.") from None
    except (URLError, OSError, http.client.HTTPException) as error:
        raise _CutShortError(_reason(error)) from None
    came = 0
    with response:
        if have and response.status != 206:  # a server that gives whole files alone
            have = 0
        elif have and not _goes_on(response, have):
            part.unlink()
            raise _CutShortError(f"asked for what follows byte {have}, it gave something else")
        with part.open("ab" if have else "wb") as stream:
            while have < file.size:
                try:
                    chunk = response.read1(CHUNK)
                except (OSError, http.client.HTTPException) as error:
                    raise _CutShortError(_reason(error)) from None
                if not chunk:
                    raise _CutShortError("the connection ended")
                have += len(chunk)
                came += len(chunk)
                stream.write(chunk[: len(chunk) - max(have - file.size, 0)])
                stream.flush()  # a process that is stopped loses none of it
                advance(min(have, file.size))
    return came


def _goes_on(response: http.client.HTTPResponse, have: int) -> bool:
    """Whether an answer with a part of the file begins where ours ends."""
    begins = re.match(r"bytes (\d+)-", response.headers.get("Content-Range", ""))
    return begins is not None and int(begins[1]) == have


def _cut_short(file: PinnedFile, here: int, host: str, reason: str) -> str:
    if not here:
        return (
            f"{host} cannot be reached ({reason}): try again when the network is back; nothing else needs it."
        )
    return (
        f"{file.name} was cut short at {in_bytes(here)} of {in_bytes(file.size)} ({reason}): what came is kept, and "
        "the same command goes on from there."
    )


def _reason(error: Exception) -> str:
    cause = getattr(error, "reason", error)  # of URLError
    if isinstance(cause, TimeoutError):
        return f"silent for {TIMEOUT_S:g} s"
    if isinstance(cause, OSError) and cause.strerror:
        return cause.strerror
    return str(cause) or type(cause).__name__


def _full(folder: Path, needed: int) -> UserError:
    more = f"{in_bytes(needed)} are needed" if needed else "a model did not fit"
    return UserError(f"The disk of {folder} is full: {more}; free some, and the same command goes on.")


def _part(target: Path) -> Path:
    return target.with_name(f"{target.name}.part")


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0
