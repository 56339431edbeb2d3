"""A headless Chromium for tests of pages, spoken to by the DevTools protocol over two pipes: no driver, no package.

    with Browser(find()) as browser:
        page = browser.open("http://127.0.0.1:8000/index.html")
        assert page.value("document.title") == "Strata"

Protocol: <https://chromedevtools.github.io/devtools-protocol/>; `--remote-debugging-pipe` reads JSON
from file 3 and writes it to file 4, each message ended by a zero byte.
"""

from __future__ import annotations

import base64
import json
import os
import select
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
PATIENCE_S = 30.0
MOVE = """
import fcntl, os, sys
pipes = [fcntl.fcntl(int(number), fcntl.F_DUPFD, 10) for number in sys.argv[1:3]]
for wanted, pipe in zip((3, 4), pipes):
    os.dup2(pipe, wanted)
os.execvp(sys.argv[3], sys.argv[3:])
"""


def find() -> str | None:
    """Return the program, that of `STRATA_BROWSER` or the first on the PATH; None where there is none."""
    if os.name != "posix":  # files 3 and 4 are POSIX's
        return None
    chosen = os.environ.get("STRATA_BROWSER")
    return chosen or next((path for path in map(shutil.which, NAMES) if path), None)


class Browser:
    """A browser process with an empty profile, ended with the `with` that it was made for."""

    def __init__(self, program: str) -> None:
        self._profile = tempfile.mkdtemp(prefix="strata-browser-")
        read_theirs, self._write = os.pipe()
        self._read, write_theirs = os.pipe()
        flags = ["--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--mute-audio"]
        flags += ["--disable-background-networking", "--disable-component-update", "--no-first-run"]
        command = [
            program,
            *flags,
            "--remote-debugging-pipe",
            f"--user-data-dir={self._profile}",
            "about:blank",
        ]
        # The protocol wants 3 and 4: a Python of its own puts the pipes there, whatever numbers they have here.
        self._process = subprocess.Popen(
            [sys.executable, "-S", "-c", MOVE, str(read_theirs), str(write_theirs), *command],
            pass_fds=(read_theirs, write_theirs),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(read_theirs)
        os.close(write_theirs)
        self._buffer, self._last = b"", 0
        self._events: list[dict[str, Any]] = []

    def __enter__(self) -> Browser:
        return self

    def __exit__(self, *_: object) -> None:
        with suppress(OSError, TimeoutError):
            self.call("Browser.close")
        try:
            self._process.wait(5)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        os.close(self._read)
        os.close(self._write)
        shutil.rmtree(self._profile, ignore_errors=True)

    def call(self, method: str, session: str | None = None, **params: Any) -> dict[str, Any]:
        """Call a method of the protocol and return its result; raise RuntimeError for its errors."""
        self._last += 1
        message = {
            "id": self._last,
            "method": method,
            "params": params,
            **({"sessionId": session} if session else {}),
        }
        os.write(self._write, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next(PATIENCE_S)
            if answer.get("id") == self._last:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']['message']}")
                result: dict[str, Any] = answer["result"]
                return result
            self._events.append(answer)

    def events(self, session: str) -> Iterator[dict[str, Any]]:
        """Give the events of a page that have come since the last time."""
        kept, self._events = self._events, []
        for event in kept:
            if event.get("sessionId") == session:
                yield event
            else:
                self._events.append(event)

    def wait(self, session: str, method: str) -> None:
        """Wait for an event of a page; all that come before it stay."""
        until = time.monotonic() + PATIENCE_S
        while not any(e.get("sessionId") == session and e.get("method") == method for e in self._events):
            self._events.append(self._next(until - time.monotonic()))

    def _next(self, seconds: float) -> dict[str, Any]:
        until = time.monotonic() + seconds
        while b"\0" not in self._buffer:
            left = until - time.monotonic()
            if left <= 0 or not select.select([self._read], [], [], left)[0]:
                raise TimeoutError("the browser does not answer")
            data = os.read(self._read, 1 << 20)
            if not data:
                raise OSError("the browser has ended")
            self._buffer += data
        text, _, self._buffer = self._buffer.partition(b"\0")
        found: dict[str, Any] = json.loads(text)
        return found

    def open(self, address: str, width: int = 1280, height: int = 900, dark: bool = False) -> Page:
        """Return a loaded page in a tab of its own; `dark` as a system that prefers that.

        It knows nothing of other pages: a site may remember which colours it was shown in first.
        """
        context = self.call("Target.createBrowserContext")["browserContextId"]
        target = self.call("Target.createTarget", url="about:blank", browserContextId=context)["targetId"]
        session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable", session)
        page = Page(self, session, context)
        page.resize(width, height)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", session, features=[scheme])
        self.call("Page.navigate", session, url=address)
        self.wait(session, "Page.loadEventFired")
        return page


class Page:
    """One tab: what it logs and asks for is collected from the beginning."""

    def __init__(self, browser: Browser, session: str, context: str) -> None:
        self.browser, self._session, self._context = browser, session, context
        self._seen: list[dict[str, Any]] = []

    def resize(self, width: int, height: int) -> None:
        """Give the page a window of so many pixels."""
        self._call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )

    def value(self, expression: str) -> Any:
        """Return the value of JavaScript, awaited, as Python has it; raise RuntimeError for an exception."""
        found = self._call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in found:
            raise RuntimeError(str(found["exceptionDetails"].get("exception", {}).get("description")))
        return found["result"].get("value")

    def press(self, key: str, text: str = "") -> None:
        """Press and release a key, "ArrowRight"; `text` is what it writes, "\\r" for Enter where that has to act."""
        codes = {"ArrowRight": 39, "ArrowLeft": 37, "ArrowDown": 40, "Home": 36, "End": 35}
        codes |= {"Enter": 13, "Escape": 27}
        code = codes[key] if key in codes else ord(key.upper())
        for kind in ("keyDown", "keyUp"):
            self._call(
                "Input.dispatchKeyEvent",
                type=kind,
                key=key,
                code=key,
                windowsVirtualKeyCode=code,
                **({"text": text} if text and kind == "keyDown" else {}),
            )

    def type(self, text: str) -> None:
        """Press the keys of a text one after the other."""
        for letter in text:
            self.press(letter, letter)

    def paste(self, text: str) -> None:
        """Write a text into what has the focus, in the place of what is selected there, with no key pressed."""
        self._call("Input.insertText", text=text)

    def until(self, expression: str) -> Any:
        """Return the value of JavaScript as soon as it is true, also of the page that comes next; or TimeoutError."""
        until = time.monotonic() + PATIENCE_S
        while time.monotonic() < until:
            with suppress(RuntimeError):  # between two pages there is nothing to ask
                if found := self.value(expression):
                    return found
            time.sleep(0.01)
        raise TimeoutError(expression)

    def point(self, x: float, y: float, click: bool = False) -> None:
        """Move the pointer to a place of the window, and press there if asked to."""
        for kind in ("mouseMoved", *(("mousePressed", "mouseReleased") if click else ())):
            more = {"button": "left", "clickCount": 1, "buttons": 1} if kind != "mouseMoved" else {}
            self._call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)

    def picture(self) -> bytes:
        """Return a PNG of the window."""
        return base64.b64decode(self._call("Page.captureScreenshot", format="png")["data"])

    def close(self) -> None:
        """Close the tab and forget what its pages have stored."""
        self.browser.call("Target.disposeBrowserContext", browserContextId=self._context)

    def complaints(self) -> list[str]:
        """Return errors and warnings of the console, exceptions, and requests that failed, until now."""
        found = []
        for event in self._gathered():
            params = event["params"]
            if event["method"] == "Log.entryAdded" and params["entry"]["level"] in ("error", "warning"):
                found.append(f"{params['entry']['text']} {params['entry'].get('url', '')}")
            elif event["method"] == "Runtime.exceptionThrown":
                found.append(str(params["exceptionDetails"].get("exception", {}).get("description")))
            elif event["method"] == "Runtime.consoleAPICalled" and params["type"] in (
                "error",
                "warning",
                "assert",
            ):
                found.append(" ".join(str(one.get("value")) for one in params["args"]))
        return found

    def requests(self) -> list[str]:
        """Return the addresses of all that the page has asked for."""
        return [
            event["params"]["request"]["url"]
            for event in self._gathered()
            if event["method"] == "Network.requestWillBeSent"
        ]

    def _call(self, method: str, **params: Any) -> dict[str, Any]:
        return self.browser.call(method, self._session, **params)

    def _gathered(self) -> list[dict[str, Any]]:
        self._seen += self.browser.events(self._session)
        return self._seen
