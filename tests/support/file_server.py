"""A server of files on this machine that misbehaves on request: cuts answers short, ignores ranges, is silent."""

from __future__ import annotations

import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from tests.support.timing import PATIENCE_S


class FileServer(ThreadingHTTPServer):
    """Serves `files` (path without the first "/" to bytes).

    `ranges` says whether a part can be asked for. An answer ends after the first of `cuts`, bytes, if there is one,
    which is then used up. `status` is what every request gets, if set; `shift` moves where a part begins. `asked` are
    the paths that were asked for with their ranges, `sent` counts the bytes of answers. Where `gate` is not None, an
    answer stops after half of it until that event is set.
    """

    daemon_threads = True

    def __init__(self, files: dict[str, bytes]) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.files = files
        self.ranges = True
        self.cuts: list[int] = []
        self.status: int | None = None
        self.shift = 0
        self.asked: list[tuple[str, str | None]] = []
        self.sent = 0
        self.gate: threading.Event | None = None
        self.halfway = threading.Event()

    @property
    def address(self) -> str:
        """The beginning of every address."""
        return f"http://127.0.0.1:{self.server_port}"


class _Handler(BaseHTTPRequestHandler):
    server: FileServer

    def do_GET(self) -> None:
        server, wanted = self.server, self.headers.get("Range")
        server.asked.append((self.path.lstrip("/"), wanted))
        data = server.files.get(self.path.lstrip("/"))
        if server.status is not None or data is None:
            self.send_error(server.status or 404)
            return
        begin = int(re.fullmatch(r"bytes=(\d+)-", wanted)[1]) if wanted and server.ranges else 0
        if begin >= len(data):
            self.send_error(416)
            return
        if begin:
            begin += server.shift
            self.send_response(206)
            self.send_header("Content-Range", f"bytes {begin}-{len(data) - 1}/{len(data)}")
        else:
            self.send_response(200)
        body = data[begin:]
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        if server.cuts:
            body = body[: server.cuts.pop(0)]
        half = len(body) // 2 if server.gate is not None else len(body)
        self._send(body[:half])
        if server.gate is not None:
            server.halfway.set()
            server.gate.wait(PATIENCE_S)
            self._send(body[half:])
        self.close_connection = True

    def _send(self, data: bytes) -> None:
        self.server.sent += len(data)  # before who asked can have all of it
        try:
            self.wfile.write(data)
            self.wfile.flush()
        except OSError:
            pass  # who asked has gone

    def log_message(self, *_words: object) -> None:
        """Say nothing."""


@contextmanager
def serving(files: dict[str, bytes]) -> Iterator[FileServer]:
    """Give a server of `files` that runs until the end of the block."""
    with FileServer(files) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True)
        thread.start()
        try:
            yield server
        finally:
            if server.gate is not None:
                server.gate.set()
            server.shutdown()
            thread.join()
