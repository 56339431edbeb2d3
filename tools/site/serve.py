"""Show the built site to this machine's browsers: a server for its files that nobody else can reach."""

from __future__ import annotations

from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

from common.errors import UserError
from tools.cli.console import say


class _Quiet(SimpleHTTPRequestHandler):
    """Gives out files without a line for each."""

    def log_message(self, format: str, *args: object) -> None:
        """Say nothing."""


def server(folder: Path, port: int) -> ThreadingHTTPServer:
    """Return a server on the loopback address that has not begun; port 0 takes a free one. Raises UserError."""
    try:
        return ThreadingHTTPServer(("127.0.0.1", port), partial(_Quiet, directory=str(folder)))
    except (OSError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or error
        raise UserError(
            f"--port {port} cannot be used ({reason}): name another, or 0 for a free one."
        ) from None


def serve(folder: Path, port: int) -> None:
    """Show a folder until Ctrl-C."""
    with server(folder, port) as serving:
        say(f"The site is at http://127.0.0.1:{serving.server_address[1]}/; Ctrl-C ends it.")
        serving.serve_forever(poll_interval=0.1)
