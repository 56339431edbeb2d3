"""Software drivers compile without optimising in tests: a shader takes less time, and no bit of a picture changes."""

from __future__ import annotations

import os

import numpy as np
import pytest

from common.images import read_image
from tests.support import children, packages


@pytest.mark.needs("OpenEXR")
@pytest.mark.parametrize("backend", packages.BACKENDS)
def test_pictures_are_those_of_the_optimising_compiler(strata, tmp_path, backend):
    """The other compiler draws in a child: a driver reads the variable once."""
    words = ("run", "1", "--scene", "cornell", "--backend", backend, "--size", "48x32", "--out")
    other = "" if os.environ.get("GALLIVM_PERF") == "nopt" else "nopt"
    (done,) = children.commands(((*words, "other.exr"), {}), cwd=tmp_path, GALLIVM_PERF=other)
    assert done.returncode == 0, done.stderr
    assert strata(*words, "here.exr")[0] == 0
    pictures = [read_image(tmp_path / f"{name}.exr") for name in ("here", "other")]
    assert pictures[0].std() > 0.01
    assert np.array_equal(*pictures)
