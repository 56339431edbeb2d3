"""What self-tests found out about a driver: kept on disk, and taken off what the driver says of itself.

A driver advertises features that crash or draw nonsense. `backends.vulkan.selftest` tries each use of each feature in
a process of its own; here its verdicts are stored, one small file per device and driver, and applied to
`Capabilities`: what failed counts as missing.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from backends.contract import FEATURES, MAIN_USES, Capabilities
from common.paths import ROOT, cache_dir, user_cache, write_whole

OK = "ok"
UNCHECKED = "unchecked"
"""A verdict is "ok", "unchecked: why" (no compiler, say), or a sentence that says what went wrong."""

Verdicts = dict[str, dict[str, str]]
"""feature -> use -> verdict."""

KNOWN: tuple[tuple[str, str, str], ...] = (
    # (how the driver's name begins, use, what is wrong): measured on llvmpipe of Mesa 25.0.7, by `selftests/`.
    # They hold where no verdict is cached; a self-test that passes on a later driver takes them back.
    (
        "llvmpipe",
        "sparse/attachment",
        "the software driver writes sparse attachments by rows and reads them by pages",
    ),
    (
        "llvmpipe",
        "sparse/depth-attachment",
        "the software driver writes sparse attachments by rows and reads them by pages",
    ),
    (
        "llvmpipe",
        "sparse/cube-array",
        "the software driver reads row 0 of a sparse cube array wherever it is sampled",
    ),
    (
        "llvmpipe",
        "sparse/plain-image",
        "the software driver crashes when a sparse fetch reads an image that is not sparse",
    ),
    (
        "llvmpipe",
        "pipeline-statistics/after-push-constants",
        "the software driver crashes when it begins to count compute invocations after push constants for compute "
        "and before a compute pipeline is bound",
    ),
)


@dataclass(frozen=True)
class Identity:
    """Whose verdicts these are: device and driver with its version, and the build that made its pipeline cache."""

    device: str
    driver: str
    build: str = ""

    @property
    def file(self) -> str:
        """The name of the cache file."""
        text = "\n".join((self.device, self.driver, self.build))
        return hashlib.sha256(text.encode()).hexdigest()[:32] + ".json"


@functools.cache
def sources_hash() -> str:
    """Return a hash of the self-tests' own text: a verdict of other tests is none."""
    folder = ROOT / "backends" / "vulkan"
    digest = hashlib.sha256()
    for path in (folder / "selftest.py", *sorted((folder / "selftests").glob("*.py"))):
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def read(identity: Identity) -> Verdicts | None:
    """Return the verdicts kept for this driver and these self-tests, or None; a damaged file is none."""
    try:
        found = json.loads((user_cache() / "selftest" / identity.file).read_bytes())
        if found["sources"] != sources_hash():
            return None
        return {
            str(feature): {str(use): str(verdict) for use, verdict in uses.items()}
            for feature, uses in found["verdicts"].items()
        }
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def write(identity: Identity, verdicts: Verdicts) -> Path | None:
    """Keep `verdicts`, in place of earlier ones; return the file, None where nothing can be written."""
    folder = cache_dir("selftest")
    if folder is None:
        return None
    content = {
        "device": identity.device,
        "driver": identity.driver,
        "build": identity.build,
        "sources": sources_hash(),
        "verdicts": verdicts,
    }
    path = folder / identity.file
    with contextlib.suppress(OSError):  # a full disk: the next start asks again
        write_whole(path, json.dumps(content, indent=1).encode())
        return path
    return None


def broken(driver: str, verdicts: Verdicts | None) -> dict[str, str]:
    """Return "feature/use" -> what is wrong: what self-tests found, and for uses they did not try what is known."""
    wrong = {use: reason for begin, use, reason in KNOWN if driver.startswith(begin)}
    for feature, uses in (verdicts or {}).items():
        for use, verdict in uses.items():
            if verdict.startswith(UNCHECKED):
                continue
            wrong.pop(f"{feature}/{use}", None)
            if verdict != OK:
                wrong[f"{feature}/{use}"] = verdict
    return wrong


def apply(capabilities: Capabilities, wrong: Mapping[str, str]) -> Capabilities:
    """Return `capabilities` without what is wrong: a feature whose main use fails is missing, for that reason."""
    why_not = dict(capabilities.why_not)
    for feature in sorted(capabilities.features & FEATURES.keys()):
        for use in MAIN_USES.get(feature, ()):
            if f"{feature}/{use}" in wrong:
                why_not[feature] = f"its self-test failed ({use}): {wrong[f'{feature}/{use}']}"
                break
    return replace(
        capabilities,
        features=capabilities.features - why_not.keys(),
        why_not=why_not,
        broken=dict(wrong),
    )
