"""Devices that tests share: opened once for a chapter and variant, given back empty and unchanged by each file."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from backends.gl.context import Context
from backends.gl.resources import create_buffer as create_gl_buffer
from backends.vulkan import api as vk
from backends.vulkan.device import Device
from backends.vulkan.resources import create_buffer, destroy_buffer
from common.errors import DeviceError, UnsupportedError
from common.paths import ROOT
from tests.support.opened import Opened

pytest_plugins = ["pytester"]

pytestmark = pytest.mark.runs_on("vulkan", "gl")


@pytest.fixture(params=["vulkan", "gl"])
def open_(request) -> Callable[[], Any]:
    """What opens a device of each backend."""
    if request.param == "vulkan":
        instance = request.getfixturevalue("vulkan_instance")
        return lambda: Device(instance)
    try:
        Context().close()
    except UnsupportedError as error:
        pytest.skip(f"no OpenGL: {error}")
    return lambda: Context(validate=True)


@pytest.fixture
def opened() -> Iterator[Opened]:
    devices = Opened()
    yield devices
    devices.close()


def a_buffer(device: Any, name: str) -> Any:
    if isinstance(device, Context):
        device.make_current()
        return create_gl_buffer(device, 64, "device", name)
    return create_buffer(device, 64, vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT, "upload", name)


def is_open(device: Any) -> bool:
    return not device._closed if isinstance(device, Context) else device.handle is not None


def test_files_of_a_place_share_a_device_for_each_kind(opened, open_):
    with opened.lent("ch02", "plain", open_) as first:
        pass
    with opened.lent("ch02", "other", open_) as other, opened.lent("ch02", "plain", open_) as again:
        assert again is first and other is not first
    with opened.lent("ch02", "other", open_) as second:
        assert second is other


def test_a_file_that_borrows_two_of_a_kind_has_two(opened, open_):
    with opened.lent("ch02", "plain", open_):
        pass
    with opened.lent("ch02", "plain", open_) as first, opened.lent("ch02", "plain", open_) as second:
        assert second is not first


def test_another_place_closes_the_devices_of_the_last_one(opened, open_):
    with opened.lent("ch02", "plain", open_) as first:
        assert is_open(first)
    assert is_open(first)
    with opened.lent("ch03", "plain", open_) as second:
        assert second is not first and not is_open(first)
    opened.close()
    assert not is_open(second)


def test_a_device_that_comes_back_late_is_closed(opened, open_):
    with opened.lent("ch02", "plain", open_) as late:
        with opened.lent("ch03", "plain", open_):
            pass
        assert is_open(late), "it is in use"
    assert not is_open(late)
    with opened.lent("ch03", "plain", open_) as next_one:
        assert next_one is not late


def test_what_a_file_leaves_alive_is_named_and_the_next_file_gets_another_device(opened, open_):
    with (
        pytest.raises(DeviceError, match=r"outlived their .*'forgotten'"),
        opened.lent("ch02", "plain", open_) as first,
    ):
        a_buffer(first, "forgotten")
    assert not is_open(first)
    with opened.lent("ch02", "plain", open_) as second:
        assert second is not first and not second.alive


def test_a_file_begins_with_no_blocks_of_memory_of_the_file_before(opened, vulkan_instance):
    with opened.lent("ch02", "plain", lambda: Device(vulkan_instance)) as device:
        destroy_buffer(device, a_buffer(device, "freed"))
        assert device.memory.allocated > 0, "the block stays for the next buffer"
    with opened.lent("ch02", "plain", lambda: Device(vulkan_instance)) as again:
        assert again is device and again.memory.allocated == 0 and not again.alive
        destroy_buffer(device, a_buffer(device, "of a new block"))


def test_the_buffer_of_push_constants_is_the_context_s_own(opened):
    try:
        with opened.lent("ch02", "gl", lambda: Context(validate=True)) as context:
            context.push(np.zeros(4, np.float32))
    except UnsupportedError as error:
        pytest.skip(f"no OpenGL: {error}")
    with opened.lent("ch02", "gl", lambda: Context(validate=True)) as again:
        assert again is context


CHANGES: dict[str, Callable[[Any], Any]] = {
    "features": lambda device: setattr(device, "features", frozenset({"none such"})),
    "sink.callbacks": lambda device: device.sink.callbacks.append(print),
    "added": lambda device: setattr(device, "added", 1),
}


@pytest.mark.parametrize("name", CHANGES)
def test_an_attribute_that_is_not_put_back_is_named_and_its_device_not_lent_again(opened, open_, name):
    device: Any = None
    try:
        with (
            pytest.raises(DeviceError, match=rf"changed {re.escape(name)} of a device for good"),
            opened.lent("ch02", "plain", open_) as device,
        ):
            CHANGES[name](device)
    finally:
        if print in device.sink.callbacks:  # an instance's, which outlives the device
            device.sink.callbacks.remove(print)
    with opened.lent("ch02", "plain", open_) as second:
        assert second is not device and not is_open(device)


def test_a_trace_of_calls_that_goes_on_is_named(opened, vulkan_instance):
    with (
        pytest.raises(DeviceError, match=r"changed fn\._trace"),
        opened.lent("ch02", "plain", lambda: Device(vulkan_instance)) as device,
    ):
        device.fn.trace([])


def test_one_device_that_fails_to_close_does_not_keep_the_others_open(opened, open_):
    with opened.lent("ch02", "a", open_) as first, opened.lent("ch02", "b", open_) as second:
        pass
    a_buffer(first, "late")
    with pytest.raises(DeviceError, match="late"):
        opened.close()
    assert not is_open(first) and not is_open(second)


# --- fixtures ---------------------------------------------------------------------------------------------------------

CONFTEST = """
from types import SimpleNamespace
from tests.conftest import open_devices, variant, vulkan_device, vulkan_instance

def pytest_configure(config):
    config.pluginmanager.register(SimpleNamespace(devices={}), "strata-report")
"""
BORROWS = """
from backends.vulkan import api as vk
from backends.vulkan.resources import create_buffer

def test_first(vulkan_device):
    print("device", id(vulkan_device))

def test_last(vulkan_device):
    if LEAVES:
        create_buffer(vulkan_device, 64, vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT, "upload", "forgotten")
"""


@pytest.mark.parametrize("leaves", [False, True])
def test_files_share_the_fixture_s_device_and_a_leak_fails_the_file_that_made_it(
    pytester, monkeypatch, leaves
):
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    pytester.makeconftest(CONFTEST)
    for name, value in {"a": leaves, "b": False}.items():
        (pytester.path / f"test_{name}.py").write_text(f"LEAVES = {value}\n{BORROWS}")
    words = ("-v", "-rA", "-p", "no:cacheprovider", f"--rootdir={pytester.path}")
    done = pytester.run(sys.executable, "-m", "pytest", *words)
    text = done.stdout.str() + done.stderr.str()
    if "no Vulkan" in text:
        pytest.skip("no Vulkan")
    numbers = re.findall(r"^device (\d+)", text, re.MULTILINE)
    assert len(numbers) == 2, text
    errors = re.findall(r"^ERROR (test_\S+)", text, re.MULTILINE)
    if leaves:
        assert errors == ["test_a.py::test_last"] and "'forgotten'" in text
    else:
        assert done.ret == 0 and numbers[0] == numbers[1], "the second file opened another device"
    assert f"4 passed{', 1 error' * leaves}" in text.splitlines()[-1]
