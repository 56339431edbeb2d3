"""What the tests of chapter 2 share: the chapter with its one set of textures, as the truth for every other path."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from backends.vulkan.device import Device
from backends.vulkan.instance import Instance
from tests.support import snapshots
from tests.support.chapter import Chapter


@pytest.fixture(scope="session")
def bindless_device(vulkan_instance: Instance) -> Iterator[Device]:
    """A device with descriptor indexing, beside that of the variant which is tested."""
    with Device(vulkan_instance) as device:
        if not device.has("bindless"):
            pytest.skip("the device has no descriptor indexing")
        yield device


@pytest.fixture
def bindless_chapter(request: pytest.FixtureRequest, bindless_device: Device) -> Chapter:
    """The chapter that the test runs for, on that device."""
    written_for = snapshots.first_chapter(request.path)
    return Chapter(snapshots.tested(request.node).which, "vulkan", bindless_device, written_for=written_for)
