"""The verdicts of self-tests on a driver: kept on disk, and applied to the features that the driver advertises.

Drivers advertise features that crash or draw nonsense. `backends.selftest.run` tries each use of each feature in a
child process. This module stores its verdicts, one small file per device and driver, and applies them to
`Capabilities`: a feature that failed counts as missing. The files lie in the folder
that STRATA_VERDICTS names, by default in the user's cache.
"""

from __future__ import annotations

import functools
import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from backends.contract import Capabilities
from backends.features import FEATURES, MAIN_USES, REQUIRED_USES
from common.names import visible
from common.paths import ROOT, user_cache, write_whole

OK = "ok"
AGAIN = "./strata doctor --selftest tries it again"
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
    (
        "llvmpipe",
        "ray-tracing/libraries",
        "the software driver gives no push constants to ray pipelines that are linked from libraries",
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
    """Return a hash of the self-tests' own text: verdicts of an older text are not used."""
    sources = ROOT / "backends"
    digest = hashlib.sha256()
    for path in (*sorted(sources.glob("selftest/*.py")), *sorted(sources.glob("*/selftests/*.py"))):
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def folder() -> Path:
    """Return the folder of the files with verdicts."""
    chosen = os.environ.get("STRATA_VERDICTS")
    return Path(chosen) if chosen else user_cache() / "selftest"


def variables() -> dict[str, str]:
    """Return what a process with a cache of its own needs in its environment to know the verdicts of this one."""
    return {"STRATA_VERDICTS": str(folder())}


_unkept: dict[str, dict[str, Any]] = {}
"""What could not be written, for this process."""


def read(identity: Identity) -> Verdicts | None:
    """Return the verdicts kept for this driver and these self-tests, or None; a damaged file is none."""
    try:
        record = _unkept.get(identity.file) or json.loads((folder() / identity.file).read_bytes())
        if record["sources"] != sources_hash():
            return None
        return {
            str(feature): {str(use): visible(str(verdict)) for use, verdict in uses.items()}
            for feature, uses in record["verdicts"].items()
        }
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def write(identity: Identity, verdicts: Verdicts) -> Path | None:
    """Keep `verdicts`, in place of earlier ones; return the file, None where nothing can be written."""
    content = {
        "device": identity.device,
        "driver": identity.driver,
        "build": identity.build,
        "sources": sources_hash(),
        "verdicts": verdicts,
    }
    path = folder() / identity.file
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, json.dumps(content, indent=1).encode())
    except OSError:  # a full disk, a folder that is not ours: the next start asks again
        _unkept[identity.file] = content
        return None
    _unkept.pop(identity.file, None)
    return path


def is_kept(identity: Identity) -> bool:
    """Return whether the verdicts of a driver could be written, if there are any."""
    return identity.file not in _unkept


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


def unfit(wrong: Mapping[str, str]) -> str | None:
    """Return why no chapter can use a device of which `wrong` holds the failed uses, or None."""
    for feature, uses in REQUIRED_USES.items():
        for use in uses:
            if f"{feature}/{use}" in wrong:
                return f"its self-test failed ({feature}/{use}): {wrong[f'{feature}/{use}']}; {AGAIN}"
    return None
