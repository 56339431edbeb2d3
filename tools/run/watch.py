"""`strata run N --watch`: a picture on disk that is written anew when a shader or a graph is saved, until Ctrl-C."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from common.errors import StrataError
from tools.cli.console import say
from tools.run.live import POLL_S, Live

if TYPE_CHECKING:
    from backends.contract import Frame, Renderer
    from common.view.camera import View

MOST_FRAMES = 64
"""Frames until a picture is written, even if a temporal pass were still at work."""


def watch(
    live: Live,
    renderer: Renderer,
    opener: Callable[[], Renderer],
    view: View,
    time: float,
    write: Callable[[Frame], None],
    target: Path,
) -> None:
    """Draw `view` at `time` again after every edit, and hand the frame to `write`; only an exception ends it.

    `opener` gives another renderer like this one, for those that cannot exchange their shaders. If a picture cannot
    be written, the error is printed, and the picture is written after the next edit.
    """
    own: list[Renderer] = []  # the one that was opened here last

    def renew() -> Renderer:
        made = opener()
        while own:
            own.pop().close()
        own.append(made)
        return made

    live.renew = renew
    count = sum(path.is_file() for path in live.files(renderer))
    what = (
        f"{count - 1} shader files and a graph"
        if hasattr(renderer, "graph_file")
        else f"{count} shader files"
    )
    say(f"Watching {what}: {target} is written anew when one is saved. Ctrl-C ends.")
    owed = False  # the picture could not be written
    try:
        while True:
            clock.sleep(POLL_S)
            if not live.follow(renderer) or not (live.rebuilt or (owed and not live.error)):
                continue
            renderer = live.renderer
            try:
                write(settled(renderer, view, time))
            except StrataError as error:
                say(f"strata: {error}")
                owed = True
                continue
            owed = False
            say(f"strata: wrote {target}, {clock.monotonic() - live.noticed:.2f} s after the file was saved.")
    finally:
        for made in own:
            made.close()


def settled(renderer: Renderer, view: View, time: float) -> Frame:
    """Return a frame in which everything that goes on over several frames has come to rest."""
    frame = renderer.render(view, time)
    for later in until_idle(renderer, view, time):
        frame = later
    return frame


def until_idle(renderer: Renderer, view: View, time: float) -> Iterator[Frame]:
    """Yield further frames of a view until another one would show the same; MOST_FRAMES at most."""
    for _ in range(MOST_FRAMES - 1):
        if renderer.idle(view, time):
            break
        yield renderer.render(view, time)
