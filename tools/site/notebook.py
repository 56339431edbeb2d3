"""The page of the notebook: its text and code, with what each cell shows, run when the site is built."""

from __future__ import annotations

import re
from base64 import b64decode
from pathlib import Path

from common.errors import UserError
from common.paths import ROOT
from tools.run import notebooks
from tools.site.draft import TEXTS, Draft, reason

PATH = "examples/notebook.ipynb"
PAGE = TEXTS[PATH]
TITLE = "In a notebook"
"""What the page is called where the notebook does not say it."""
_REACHED = 'tabindex="0" role="group" aria-label="What the cell shows"'
"""Keys can scroll what is wider than a phone."""
_PICTURE = re.compile(r'src="data:image/png;base64,([^"]+)"')


def add(draft: Draft, drawing: bool = True) -> None:
    """Add the page; `drawing` False runs nothing, and shows text and code alone."""
    path = ROOT / PATH
    try:
        cells = notebooks.read(path)
    except UserError as error:
        draft.pages[PAGE] = f"# {TITLE}\n\n{draft.lack(PAGE, f'the notebook, since {reason(error)}.')}\n"
        return
    draft.files[Path(PATH).name] = path.read_bytes()
    if drawing:

        def make() -> str:
            notebooks.run(cells)
            return ""

        lack = draft.attempt(PAGE, "what its cells show", make)
    else:
        lack = draft.lack(PAGE, "what its cells show: nothing was to be drawn.")
    parts = [part for cell in cells for part in _parts(draft, cell)]
    if not parts or not parts[0].startswith("# "):
        parts.insert(0, f"# {TITLE}")
    download = f'<p><a href="{Path(PATH).name}" download>The notebook, to run it yourself</a></p>'
    draft.pages[PAGE] = "\n\n".join([*parts[:1], *([lack] if lack else []), download, *parts[1:]]) + "\n"


def _parts(draft: Draft, cell: notebooks.Cell) -> list[str]:
    if cell.kind != "code":
        return [draft.localised(cell.text, PATH, PAGE)]

    def filed(found: re.Match[str]) -> str:
        name = f"notebook/{sum(name.startswith('notebook/') for name in draft.files) + 1}.png"
        draft.files[name] = b64decode(found[1])
        return f'src="{name}" loading="lazy"'

    parts = [f"```python\n{cell.text}\n```"]
    shown = "".join(_PICTURE.sub(filed, one) for one in cell.shown)
    if shown:  # on one line, since a blank one would end the HTML
        parts.append(f'<div class="shown" {_REACHED}>{shown.replace(chr(10), "&#10;")}</div>')
    return parts
