"""How `strata reference` ends where it cannot go on: pictures that are too large, places that take no file, signals."""

from __future__ import annotations

import pytest

from backends.vulkan import api as vk
from backends.vulkan.device import Device
from chapters import scenes
from common.errors import UserError
from tools.reference import tracing

pytestmark = pytest.mark.feature("path-tracer/accumulation")

SMALL = ("--scene", "cornell", "--size", "16x12")


@pytest.fixture
def kept(tmp_path_factory, monkeypatch):
    """Keep sums in a folder of the test: return it."""
    folder = tmp_path_factory.mktemp("references")
    monkeypatch.setattr(tracing, "cache_dir", lambda name: folder)
    return folder


# --- too large ---


def test_a_picture_whose_sums_do_not_fit_is_refused_before_anything_is_opened(strata, tmp_path, monkeypatch):
    """16384x16384 pixels: twice 6 sums of 64 bits, and 8 values of 32 bits, are 32 GiB."""
    monkeypatch.setattr(tracing, "free_memory", lambda: (32 << 30) - 1)
    code, out, err = strata("reference", 12, "--scene", "cornell", "--size", "16384x16384", "--out", "a.png")
    assert (code, out) == (2, "")
    assert err == (
        "strata: A reference of 16384x16384 pixels is too large: its sums take 32.0 GiB of memory, and 32.0 GiB are "
        "free. A smaller --size needs less.\n"
    )
    (tmp_path / "s.toml").write_text('chapter = 12\nscene = "cornell"\nsize = "16384x16384"\n')
    code, out, err = strata("reference", "--sweep", "s.toml", "--workers", 0)
    assert (code, out) == (2, "") and "too large" in err and err.count("\n") == 1
    with pytest.raises(UserError, match="too large"):
        tracing.reference(12, scenes.load("cornell"), size=(16384, 16384))
    for free in (32 << 30, None):  # None: the system does not say
        monkeypatch.setattr(tracing, "free_memory", lambda free=free: free)
        tracing.check_room((16384, 16384))


@pytest.mark.parametrize("command", ["reference", "run"])
def test_memory_that_the_device_refuses_is_one_sentence_and_nothing_is_left(
    strata, kept, tmp_path, monkeypatch, command
):
    """The image is made, and has no memory: so software drivers refuse more than 2 GiB."""
    refuse(monkeypatch, width=16)
    code, out, err = strata(command, 12, *SMALL, "--backend", "vulkan", "--out", "a.png")
    assert (code, out) == (2, "")
    last = err.splitlines()[-1]
    assert last.startswith("strata: There is no memory on the device for '") and "of 16x12 pixels" in last
    assert "a smaller --size or scene needs less" in last and "File" not in err and "outlived" not in err
    assert not [*tmp_path.iterdir()] and not [*kept.iterdir()]


def refuse(monkeypatch, width):
    """Have no device memory for images that are so wide."""
    create, check, widths = Device.create, vk.check, []

    def created(device, call, info, *rest):
        if call == "vkCreateImage":
            widths.append(info.extent.width)
        return create(device, call, info, *rest)

    def checked(code, call, *arguments):
        is_refused = call == "vkBindImageMemory" and widths[-1] == width
        return check(vk.VK_ERROR_OUT_OF_DEVICE_MEMORY if is_refused else code, call, *arguments)

    monkeypatch.setattr(Device, "create", created)
    monkeypatch.setattr(vk, "check", checked)
