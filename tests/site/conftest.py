"""A site for tests: chapter 1 alone, nothing drawn, code without colours; served to a browser where there is one."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from html import escape
from pathlib import Path

import pytest

from tests.support import browser as browsers
from tools.site import code, site


@pytest.fixture
def plain(monkeypatch: pytest.MonkeyPatch) -> None:
    """Code without its colours, which take a chapter's page from a tenth of a second to two."""
    monkeypatch.setattr(code, "highlighted", lambda source: [escape(line) for line in source.lines])


@pytest.fixture(scope="session")
def built(tmp_path_factory: pytest.TempPathFactory) -> site.Built:
    """The site of one chapter; without colours it is built in a second, and all links are there."""
    pytest.importorskip("material", reason="mkdocs-material is not installed")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(code, "highlighted", lambda source: [escape(line) for line in source.lines])
        return site.build(tmp_path_factory.mktemp("site") / "built", [1], drawing=False)


@pytest.fixture(scope="session")
def address(built: site.Built) -> Iterator[str]:
    """Where the built site is served, "http://127.0.0.1:port"."""
    with site.server(built.folder, 0) as serving:
        thread = threading.Thread(target=serving.serve_forever, args=(0.01,), daemon=True)
        thread.start()
        yield f"http://127.0.0.1:{serving.server_address[1]}"
        serving.shutdown()
        thread.join()


@pytest.fixture(scope="session")
def browser() -> Iterator[browsers.Browser]:
    """A headless Chromium; tests with it are skipped where there is none."""
    program = browsers.find()
    if program is None:
        pytest.skip("there is no Chromium")
    with browsers.Browser(program) as opened:
        yield opened


@pytest.fixture
def out(tmp_path: Path) -> Path:
    """A folder that is not there yet."""
    return tmp_path / "out" / "site"
