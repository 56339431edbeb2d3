"""The pipeline cache on disk: what is loaded, what is refused, and that no state of disk or file stops a program."""

from __future__ import annotations

import errno
import hashlib
import logging
import os
import struct
import threading

import pytest

from backends.vulkan import api as vk
from backends.vulkan.device import Device
from chapters.ch02.pipelines import vulkan_cache
from chapters.ch02.pipelines.description import PipelineDescription
from chapters.ch02.pipelines.vulkan import Pipelines
from chapters.ch02.pipelines.vulkan_cache import PipelineCache
from common import paths

disk_cache = pytest.mark.feature("pipeline-cache/disk-cache")
PLAIN = PipelineDescription(("post/fullscreen.vert", "post/tonemap.frag"), color="rgba8", depth=None)
HEADER = struct.Struct("<4I16s")  # Vulkan 1.3, section 10.7.4: VkPipelineCacheHeaderVersionOne
PREFIX = 16 + 4 + 8 + 32  # mark, driver version, length, SHA-256
FIELDS = {"size": 0, "version": 4, "vendor": 8, "device": 12, "UUID": 16, "UUID's end": 31}


def used(device, folder, described=PLAIN):
    """Build a pipeline with the cache in `folder`, as a program does; return the cache, closed."""
    cache = PipelineCache(device, folder)
    pipelines = Pipelines(device, cache)
    try:
        assert pipelines.get([described])[0].handle
    finally:
        pipelines.close()
        cache.close()
    return cache


def signed(file, body):
    """Write `body` to a cache file with a right prefix, as nobody but the program itself would."""
    prefix = bytearray(file.read_bytes()[:PREFIX])
    prefix[20:28] = struct.pack("<Q", len(body))
    prefix[28:60] = hashlib.sha256(body).digest()
    file.write_bytes(bytes(prefix) + body)


@pytest.fixture
def file(vulkan_device, tmp_path):
    """The file of an earlier run."""
    cache = used(vulkan_device, tmp_path)
    assert (cache.loaded_bytes, cache.saved, cache.warnings) == (0, 1, [])
    (found,) = tmp_path.iterdir()
    assert found == cache.path
    return found


@disk_cache
def test_a_second_run_loads_what_the_first_one_saved(vulkan_device, file):
    before = file.read_bytes()
    cache = used(vulkan_device, file.parent)
    assert cache.loaded_bytes == len(before) - PREFIX >= HEADER.size
    assert cache.warnings == []
    if vulkan_device.physical.kind == "software":  # lavapipe keeps the header alone, which never changes
        assert cache.saved == 0 and file.read_bytes() == before


@disk_cache
def test_the_header_is_that_of_the_device(vulkan_device, file):
    size, version, vendor, device, uuid = HEADER.unpack_from(file.read_bytes(), PREFIX)
    properties = vk.new("VkPhysicalDeviceProperties")
    vulkan_device.instance.fn.vkGetPhysicalDeviceProperties(vulkan_device.physical.handle, properties)
    assert (size, version) == (32, 1)
    assert (vendor, device) == (properties.vendorID, properties.deviceID)
    assert uuid.hex() == vulkan_device.physical.cache_uuid


@disk_cache
def test_creation_works_without_a_path(vulkan_device):
    cache = used(vulkan_device, None)
    assert (cache.path, cache.loaded_bytes, cache.saved, cache.warnings) == (None, 0, 0, [])


@disk_cache
@pytest.mark.parametrize("field", FIELDS)
def test_a_header_of_another_device_is_rejected_and_rewritten(
    vulkan_device, file, field, caplog, monkeypatch
):
    """One flipped byte, with a checksum that is right: the header itself must be looked at."""
    good = file.read_bytes()
    body = bytearray(good[PREFIX:])
    body[FIELDS[field]] ^= 1
    signed(file, bytes(body))
    given = []
    original = Device.create
    monkeypatch.setattr(
        Device,
        "create",
        lambda self, call, info, *more: (
            given.append(info.initialDataSize) if call == "vkCreatePipelineCache" else None,
            original(self, call, info, *more),
        )[1],
    )
    cache = used(vulkan_device, file.parent)
    assert given == [0], "the driver never saw it"
    assert (cache.loaded_bytes, cache.saved) == (0, 1)
    (warning,) = cache.warnings
    assert field.split("'")[0] in warning and str(file) in warning and warning.endswith(".")
    assert [record.getMessage() for record in caplog.records] == [warning]
    assert file.read_bytes()[PREFIX : PREFIX + 32] == good[PREFIX : PREFIX + 32]
    assert used(vulkan_device, file.parent).loaded_bytes > 0


DAMAGES = {
    "empty": (lambda data: b"", "it has 0 bytes, fewer than its headers"),
    "cut in the prefix": (lambda data: data[:40], "it has 40 bytes"),
    "cut in the header": (lambda data: data[: PREFIX + 31], "fewer than its headers"),
    "longer": (lambda data: data + b"x", "bytes were written and"),
    "a byte of the body": (lambda data: data[:-1] + bytes([data[-1] ^ 8]), "it is damaged"),
    "a byte of the checksum": (lambda data: data[:30] + bytes([data[30] ^ 1]) + data[31:], "it is damaged"),
    "another program's": (lambda data: b"\x20\0\0\0\1\0\0\0" + bytes(200), "not written by this program"),
    "another driver's": (
        lambda data: data[:16] + struct.pack("<I", 7) + data[20:],
        "made by another version of the driver (0x7;",
    ),
}


@disk_cache
@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_file_is_ignored_with_one_warning_and_replaced(vulkan_device, file, damage, caplog):
    change, sentence = DAMAGES[damage]
    good = file.read_bytes()
    file.write_bytes(change(good))
    cache = used(vulkan_device, file.parent)
    assert (cache.loaded_bytes, cache.saved) == (0, 1)
    (warning,) = cache.warnings
    assert sentence in warning and "\n" not in warning
    assert [record.levelno for record in caplog.records] == [logging.WARNING]
    again = used(vulkan_device, file.parent)
    assert again.loaded_bytes > 0 and again.warnings == []
    assert [path.name for path in file.parent.iterdir()] == [file.name], "nothing temporary is left"


def test_a_body_that_the_driver_refuses_is_replaced(vulkan_device, file, monkeypatch):
    original = Device.create

    def refusing(self, call, info, *more):
        if call == "vkCreatePipelineCache" and info.initialDataSize:
            raise vk.VulkanError(call, vk.VK_ERROR_OUT_OF_HOST_MEMORY)
        return original(self, call, info, *more)

    monkeypatch.setattr(Device, "create", refusing)
    cache = used(vulkan_device, file.parent)
    assert (cache.loaded_bytes > 0, cache.saved) == (True, 0) or cache.saved == 1
    assert "The driver does not take the pipeline cache" in cache.warnings[0]


def test_a_file_too_large_is_not_read(vulkan_device, file, monkeypatch):
    monkeypatch.setattr(vulkan_cache, "MOST_BYTES", PREFIX + 31)
    cache = used(vulkan_device, file.parent)
    assert cache.loaded_bytes == 0 and "larger than any" in cache.warnings[0]
    assert not file.exists(), "it is begun anew rather than grow for ever"


# --- folders ---


@disk_cache
@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EROFS, errno.EACCES], ids=errno.errorcode.get)
def test_a_full_or_read_only_folder_is_one_sentence(vulkan_device, tmp_path, monkeypatch, caplog, code):
    """As the system says it when a temporary file is made; permissions mean nothing to root, who may run this."""

    def refused(*_, **__):
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr(paths.tempfile, "mkstemp", refused)
    cache = used(vulkan_device, tmp_path)
    (warning,) = cache.warnings
    assert warning == f"The pipeline cache {cache.path} cannot be written ({os.strerror(code)})."
    assert len(caplog.records) == 1
    assert list(tmp_path.iterdir()) == []


@disk_cache
def test_a_folder_that_cannot_be_made_is_one_sentence(vulkan_device, tmp_path):
    """A file stands where a folder should be: nobody can write there, not even root."""
    (tmp_path / "taken").write_text("")
    cache = used(vulkan_device, tmp_path / "taken" / "deeper")
    assert len(cache.warnings) == 1
    assert "taken" in cache.warnings[0] and cache.saved == 0


@disk_cache
def test_a_read_only_user_cache_leaves_pipelines_in_memory(vulkan_device, tmp_path, monkeypatch, caplog):
    (tmp_path / "taken").write_text("")
    monkeypatch.setenv("STRATA_CACHE", str(tmp_path / "taken"))
    caplog.set_level(logging.INFO)
    cache = PipelineCache.on_disk(vulkan_device)
    assert cache.path is None
    (warning,) = cache.warnings
    assert "cannot be written" in warning and "nothing is kept from run to run" in warning
    assert [record.levelno for record in caplog.records] == [logging.INFO], "it is so in each run: -v says it"
    cache.close()


def test_the_users_folder_is_the_projects_cache(vulkan_device, tmp_path, monkeypatch):
    monkeypatch.setenv("STRATA_CACHE", str(tmp_path))
    cache = PipelineCache.on_disk(vulkan_device)
    cache.close()
    assert cache.path.parent == tmp_path / "pipelines" == paths.user_cache() / "pipelines"
    assert cache.path.exists()


def test_nothing_new_writes_nothing(vulkan_device, file):
    before = file.stat().st_mtime_ns, file.stat().st_ino
    cache = PipelineCache(vulkan_device, file.parent)
    cache.close()
    assert cache.saved == 0
    assert (file.stat().st_mtime_ns, file.stat().st_ino) == before


def test_pipelines_live_on_when_the_cache_is_closed(vulkan_device, tmp_path):
    cache = PipelineCache(vulkan_device, tmp_path)
    pipelines = Pipelines(vulkan_device, cache)
    pipelines.get([PLAIN])
    assert cache.save() and not cache.save()
    cache.close()
    assert cache.saved == 1
    pipelines.close()


# --- more than one ---


@disk_cache
def test_two_devices_have_a_file_each(vulkan_device, tmp_path, monkeypatch):
    """The second is a device of our own making: another number, so another file and another header."""
    real = used(vulkan_device, tmp_path)
    original = vulkan_cache._identity
    driver, header, name = original(vulkan_device)
    other = (*header[:3], header[3] + 1, header[4])
    monkeypatch.setattr(vulkan_cache, "_identity", lambda device: (driver, other, f"other-{name}"))
    cache = used(vulkan_device, tmp_path)
    assert cache.path != real.path
    assert (cache.loaded_bytes, cache.saved, cache.warnings) == (0, 0, []), (
        "what is not its own it does not write"
    )
    monkeypatch.setattr(vulkan_cache, "_identity", lambda device: (driver, other, name))
    cache = used(vulkan_device, tmp_path)
    assert cache.loaded_bytes == 0 and "its device is" in cache.warnings[0]


def test_two_caches_of_one_file_leave_it_whole(vulkan_device, tmp_path):
    """Eight of them open, build and close at once, reading while others write."""
    errors = []

    def run():
        try:
            for _ in range(4):
                cache = PipelineCache(vulkan_device, tmp_path)
                cache._on_disk = b""  # so that it writes
                cache.close()
                assert cache.warnings == []
        except BaseException as error:
            errors.append(error)

    threads = [threading.Thread(target=run) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not errors
    (file,) = tmp_path.iterdir()
    size = file.stat().st_size  # now: what is built next may be added to it
    assert used(vulkan_device, tmp_path).loaded_bytes == size - PREFIX
