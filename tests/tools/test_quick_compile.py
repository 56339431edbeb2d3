"""Software drivers compile as little as they can in tests: it takes less time, and no bit of a picture changes."""

from __future__ import annotations

import os

import numpy as np
import pytest

from common.images import read_image
from tests.support import children, packages


@pytest.mark.needs("OpenEXR")
@pytest.mark.parametrize("backend", packages.BACKENDS)
def test_pictures_are_those_of_the_driver_as_users_have_it(strata, tmp_path, backend):
    """The other way to compile draws in a child: a driver reads the variables once."""
    words = ("run", "1", "--scene", "cornell", "--backend", backend, "--size", "48x32", "--out")
    quick = {"GALLIVM_PERF": "nopt", "LP_NATIVE_VECTOR_WIDTH": "128"}
    as_users = {"GALLIVM_PERF": "", "LP_NATIVE_VECTOR_WIDTH": "256"}
    other = as_users if os.environ.get("GALLIVM_PERF") == "nopt" else quick
    (done,) = children.commands(
        ((*words, "other.exr"), {}), cwd=tmp_path, MESA_SHADER_CACHE_DIR=str(tmp_path / "kernels"), **other
    )
    assert done.returncode == 0, done.stderr
    assert strata(*words, "here.exr")[0] == 0
    pictures = [read_image(tmp_path / f"{name}.exr") for name in ("here", "other")]
    assert pictures[0].std() > 0.01
    assert np.array_equal(*pictures)
