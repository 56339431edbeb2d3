"""Software drivers compile without optimising in tests: a shader takes less time, and no bit of a picture changes."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest

from common.images import read_image
from common.paths import ROOT
from tests.support import packages


@pytest.mark.needs("OpenEXR")
@pytest.mark.parametrize("backend", packages.BACKENDS)
def test_pictures_are_those_of_the_optimising_compiler(vulkan_instance, tmp_path, backend):
    pictures = []
    for options in ("nopt", ""):
        path = tmp_path / f"{options or 'optimised'}.exr"
        words = [
            "run",
            "1",
            "--scene",
            "cornell",
            "--backend",
            backend,
            "--size",
            "48x32",
            "--out",
            str(path),
        ]
        environment = os.environ | {"GALLIVM_PERF": options}
        subprocess.run(
            [sys.executable, "-m", "chapters", *words],
            cwd=ROOT,
            env=environment,
            check=True,
            capture_output=True,
        )
        pictures.append(read_image(path))
    assert pictures[0].std() > 0.01
    assert np.array_equal(*pictures)
