"""Read apt's lists of sources, in both of their formats, and write the one for Debian's backports beside them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

BACKPORTS_FILE = "/etc/apt/sources.list.d/strata-backports.sources"
PIN_FILE = "/etc/apt/preferences.d/strata-backports"


@dataclass(frozen=True)
class Source:
    """One place that apt takes packages from: its addresses, its suites, and the options that go with them."""

    uris: tuple[str, ...]
    suites: tuple[str, ...]
    components: tuple[str, ...]
    options: tuple[
        tuple[str, str], ...
    ] = ()  # names as in deb822: ("Signed-By", path), ("Trusted", "yes"), ...


def parse_deb822(text: str) -> list[Source]:
    """Return the enabled binary sources of a `.sources` file (apt's deb822 format, one paragraph per source)."""
    sources = []
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    for paragraph in re.split(r"\n[ \t]*\n", "\n".join(lines)):
        fields: dict[str, str] = {}
        name = ""
        for line in paragraph.splitlines():
            if line[:1] in (" ", "\t") and name:  # a value goes on, as keys written out in Signed-By do
                fields[name] += "\n" + line
            elif ":" in line:
                name, value = line.split(":", 1)
                name = name.strip().title()
                fields[name] = value.strip()
        if "deb" not in fields.get("Types", "").split() or fields.get("Enabled", "yes").lower() in (
            "no",
            "false",
        ):
            continue
        options = tuple((k, fields[k]) for k in ("Architectures", "Signed-By", "Trusted") if k in fields)
        uris, suites = fields.get("Uris", "").split(), fields.get("Suites", "").split()
        sources.append(
            Source(tuple(uris), tuple(suites), tuple(fields.get("Components", "").split()), options)
        )
    return sources


def parse_one_line(text: str) -> list[Source]:
    """Return the binary sources of a `sources.list` file: `deb [option=value ...] URI SUITE COMPONENT...`."""
    names = {"signed-by": "Signed-By", "trusted": "Trusted", "arch": "Architectures"}
    sources = []
    for line in text.splitlines():
        match = re.match(r"\s*deb\s+(?:\[([^\]]*)\]\s+)?([^#]+)", line)
        words = match.group(2).split() if match else []
        if match is None or len(words) < 2:
            continue
        pairs = (word.split("=", 1) for word in (match.group(1) or "").split() if "=" in word)
        options = sorted((names[k], value.replace(",", " ")) for k, value in pairs if k in names)
        sources.append(Source((words[0],), (words[1],), tuple(words[2:]), tuple(options)))
    return sources


def read_all(folder: Path = Path("/etc/apt")) -> list[Source]:
    """Return every enabled binary source of this machine, in apt's order."""
    sources = []
    files = [folder / "sources.list", *sorted((folder / "sources.list.d").glob("*"))]
    for path in files:
        parse = {".list": parse_one_line, ".sources": parse_deb822}.get(path.suffix)
        if parse is not None and path.is_file():
            sources += parse(path.read_text("utf-8", "replace"))
    return sources


def has_backports(sources: tuple[Source, ...], codename: str) -> bool:
    """Return whether the backports of a release are among the sources."""
    return any(f"{codename}-backports" in source.suites for source in sources)


def backports_of(sources: tuple[Source, ...], codename: str) -> str | None:
    """Return the text of a source for the backports of a release: same host, keys and options as the release itself.

    None when the release itself is not among the sources (a mirror of another name, a cdrom): then nothing is known
    about where its backports are.
    """
    for source in sources:
        uris = [uri for uri in source.uris if not uri.startswith("cdrom:")]
        if uris and codename in source.suites and "main" in source.components:
            options = "".join(f"{name}: {value}\n" for name, value in source.options)
            return (
                "# Written by Strata's set-up: newer Mesa drivers. What may come from here is in preferences.d.\n"
                f"Types: deb\nURIs: {' '.join(uris)}\nSuites: {codename}-backports\nComponents: main\n{options}"
            )
    return None


def pin_of(codename: str, sources: str, hold_the_rest: bool) -> str:
    """Return apt preferences that take the binaries of `sources` ("src:mesa ...") from backports.

    500 is the priority of the release itself, so that for these the newer version wins. `hold_the_rest` keeps all else
    below it; a machine that had backports before keeps its owner's own priorities.
    """
    release = f"Pin: release n={codename}-backports\n"
    text = (
        "# Written by Strata's set-up: from backports come the Mesa drivers and the library that they need.\n"
        f"Package: {sources}\n{release}Pin-Priority: 500\n"
    )
    return text + (f"\nPackage: *\n{release}Pin-Priority: 100\n" if hold_the_rest else "")
