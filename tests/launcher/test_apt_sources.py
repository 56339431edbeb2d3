"""Apt's two formats of sources, as Debian's installer, its images and debootstrap write them."""

from __future__ import annotations

from pathlib import Path

import pytest

from bootstrap import apt_sources
from bootstrap.apt_sources import Source

DEB822 = """\
Types: deb
# a comment inside a paragraph
URIs: http://mirror.example/debian
Suites: bookworm bookworm-updates
Components: main non-free-firmware
Signed-By: /usr/share/keyrings/debian-archive-keyring.gpg

Types: deb
URIs: http://mirror.example/debian-security
Suites: bookworm-security
Components: main

Enabled: no
Types: deb
URIs: http://other.example/debian
Suites: bookworm
Components: main

Types: deb-src
URIs: http://source.example/debian
Suites: bookworm
Components: main
"""
ONE_LINE = """\
# deb cdrom:[Debian GNU/Linux 12]/ bookworm main
deb [arch=amd64,i386 signed-by=/k.gpg] https://mirror.example/debian/ bookworm main contrib # ours
deb-src https://mirror.example/debian/ bookworm main
deb http://mirror.example/security bookworm-security main
"""
INLINE_KEY = """\
Types: deb
URIs: https://mirror.example/debian
Suites: bookworm
Components: main
Signed-By:
 -----BEGIN PGP PUBLIC KEY BLOCK-----
 .
 mDMEYCQjIxYJ
 -----END PGP PUBLIC KEY BLOCK-----
"""


def test_deb822_keeps_enabled_binary_sources() -> None:
    first, second = apt_sources.parse_deb822(DEB822)
    keys = (("Signed-By", "/usr/share/keyrings/debian-archive-keyring.gpg"),)
    suites = ("bookworm", "bookworm-updates")
    assert first == Source(("http://mirror.example/debian",), suites, ("main", "non-free-firmware"), keys)
    assert second.suites == ("bookworm-security",)


def test_one_line_keeps_options() -> None:
    first, second = apt_sources.parse_one_line(ONE_LINE)
    assert first.uris == ("https://mirror.example/debian/",)
    assert first.components == ("main", "contrib")
    assert dict(first.options) == {"Architectures": "amd64 i386", "Signed-By": "/k.gpg"}
    assert second.suites == ("bookworm-security",)


@pytest.mark.parametrize(
    ("sources", "host"),
    [
        (apt_sources.parse_deb822(DEB822), "http://mirror.example/debian"),
        (apt_sources.parse_one_line(ONE_LINE), "https://mirror.example/debian/"),
        (apt_sources.parse_deb822(INLINE_KEY), "https://mirror.example/debian"),
    ],
)
def test_backports_come_from_the_same_host_under_the_same_keys(sources: list[Source], host: str) -> None:
    text = apt_sources.backports_of(tuple(sources), "bookworm")
    assert text is not None
    (back,) = apt_sources.parse_deb822(text)  # what we write reads back as what we meant
    assert back == Source((host,), ("bookworm-backports",), ("main",), sources[0].options)
    assert back.options
    assert apt_sources.has_backports((back,), "bookworm")
    assert not apt_sources.has_backports(tuple(sources), "bookworm")


def test_a_cdrom_or_another_release_tells_nothing() -> None:
    cdrom = apt_sources.parse_one_line("deb cdrom:[Debian]/ bookworm main")
    assert apt_sources.backports_of(tuple(cdrom), "bookworm") is None
    assert apt_sources.backports_of(tuple(apt_sources.parse_deb822(DEB822)), "trixie") is None


def test_a_folder_is_read_in_both_formats_and_backups_are_not(tmp_path: Path) -> None:
    (tmp_path / "sources.list").write_text(ONE_LINE)
    (tmp_path / "sources.list.d").mkdir()
    (tmp_path / "sources.list.d" / "debian.sources").write_text(INLINE_KEY)
    (tmp_path / "sources.list.d" / "debian.sources.bak").write_text(INLINE_KEY)
    assert len(apt_sources.read_all(tmp_path)) == 3
    assert apt_sources.read_all(tmp_path / "missing") == []
