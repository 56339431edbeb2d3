"""The pipeline cache: the driver's compiled code of earlier runs, kept in a file and loaded at the start.

A driver compiles SPIR-V to machine code when a pipeline is built, which takes milliseconds to seconds. It returns the
results as one opaque body of bytes (VkPipelineCache). Only the same driver on the same device can use the body, and a
driver may crash on other data. So a file begins with our own prefix: a mark, the driver's version and a checksum of the
body. The body follows. Vulkan defines its first 32 bytes (VkPipelineCacheHeaderVersionOne): their size, a version,
vendor, device, and the UUID of the driver's build. The driver gets the body only if all of these are right.

Without a file everything works, but more slowly. Two processes may use one file: each replaces it as a whole.
"""

from __future__ import annotations

import hashlib
import logging
import struct
from pathlib import Path
from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.device import Device
from common.paths import cache_dir, cache_problem, write_whole

MOST_BYTES = 256 << 20
"""The largest file. A larger file is ignored; if a cache grows larger, its file is deleted."""

_LOG = logging.getLogger(__name__)
_MARK = b"strata-pipelines"
_PREFIX = struct.Struct("<16sIQ32s")  # mark, driver version, bytes of the body, SHA-256 of the body
_HEADER = struct.Struct("<4I16s")  # bytes of the header, its version, vendor, device, UUID


class PipelineCache:
    """A VkPipelineCache, filled from the device's file in `folder` and written back when it closes.

    Without a folder it lives in memory. Each problem with the file or the folder is logged once, and kept in
    `warnings`. `loaded_bytes` is the size of the body that the driver got at the start; `saved` counts the files
    written.
    """

    def __init__(self, device: Device, folder: Path | None = None) -> None:
        self._device = device
        self._driver, self._header, name = _identity(device)
        self.path = folder / name if folder else None
        self.warnings: list[str] = []
        self.saved = 0
        self._on_disk = self._load()
        self.handle = self._create(self._on_disk)
        self.loaded_bytes = len(self._on_disk)

    @classmethod
    def on_disk(cls, device: Device) -> PipelineCache:
        """Return the cache in the user's folder, or in memory if the folder cannot be written."""
        cache = cls(device, cache_dir("pipelines"))
        if cache.path is None:  # level INFO, as for the other caches: it is the same in each run
            cache._warn(f"The pipeline cache lives in memory: {cache_problem()}.", logging.INFO)
        return cache

    def _create(self, data: bytes) -> Any:
        def create(data: bytes) -> Any:
            info = vk.new("VkPipelineCacheCreateInfo", initialDataSize=len(data), pInitialData=data or None)
            return self._device.create("vkCreatePipelineCache", info, "pipelines")

        try:
            return create(data)
        except vk.VulkanError as error:
            if not data:
                raise
            self._warn(
                f"The driver does not take the pipeline cache {self.path} ({error}), which is replaced."
            )
            self._on_disk = b""
            return create(b"")

    # --- reading ---

    def _load(self) -> bytes:
        """Return the body in the file, or b"" if there is no valid one."""
        if self.path is None:
            return b""
        try:
            if self.path.stat().st_size > MOST_BYTES:
                reason = "it is larger than any that is written"
            else:
                body, reason = self._checked(self.path.read_bytes())
                if not reason:
                    return body
        except (FileNotFoundError, NotADirectoryError):
            return b""
        except OSError as error:
            reason = f"it cannot be read ({error.strerror or error})"
        self._warn(f"The pipeline cache {self.path} is ignored, and replaced if it can be: {reason}.")
        return b""

    def _checked(self, data: bytes) -> tuple[bytes, str]:
        """Return the body of a file's content, and the reason why it is invalid, or ""."""
        if len(data) < _PREFIX.size + _HEADER.size:
            return b"", f"it has {len(data)} bytes, fewer than its headers"
        mark, driver, size, checksum = _PREFIX.unpack_from(data)
        body = data[_PREFIX.size :]
        if mark != _MARK:
            return b"", "it was not written by this program"
        if len(body) != size:
            return b"", f"{size} bytes were written and {len(body)} are there"
        if hashlib.sha256(body).digest() != checksum:
            return b"", "it is damaged, its checksum is another one"
        if driver != self._driver:
            return (
                b"",
                f"it was made by another version of the driver ({driver:#x}; this one is {self._driver:#x})",
            )
        return body, self._foreign(body)

    def _foreign(self, body: bytes) -> str:
        """Return how the header of a body differs from that of this device and driver, or ""."""
        names = ("header's size", "header's version", "vendor", "device", "UUID")
        for name, stored, own in zip(names, _HEADER.unpack_from(body), self._header, strict=True):
            if stored != own:
                texts = [
                    value.hex() if isinstance(value, bytes) else f"{value:#x}" for value in (stored, own)
                ]
                return f"its {name} is {texts[0]}, and this device has {texts[1]}"
        return ""

    # --- writing ---

    def data(self) -> bytes:
        """Return the body: what the driver has compiled so far, in its own form."""
        fn, device = self._device.fn, self._device.handle
        size = vk.ffi.new("size_t *")
        code = vk.VK_INCOMPLETE
        while code == vk.VK_INCOMPLETE:  # another thread may add to it between the two calls
            vk.check(fn.vkGetPipelineCacheData(device, self.handle, size, vk.NULL), "vkGetPipelineCacheData")
            buffer = vk.ffi.new("char[]", size[0])
            code = fn.vkGetPipelineCacheData(device, self.handle, size, buffer)
        vk.check(code, "vkGetPipelineCacheData")
        return bytes(vk.ffi.buffer(buffer, size[0]))

    def save(self) -> bool:
        """Write the file if the driver has compiled something since it was read; return whether it was written."""
        if self.path is None:
            return False
        body = self.data()
        if body == self._on_disk or self._foreign(body):
            return False
        if len(body) > MOST_BYTES - _PREFIX.size:
            self.path.unlink(missing_ok=True)
            return False
        prefix = _PREFIX.pack(_MARK, self._driver, len(body), hashlib.sha256(body).digest())
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(self.path, prefix + body)
        except OSError as error:
            self._warn(f"The pipeline cache {self.path} cannot be written ({error.strerror or error}).")
            return False
        self._on_disk = body
        self.saved += 1
        return True

    def _warn(self, sentence: str, level: int = logging.WARNING) -> None:
        self.warnings.append(sentence)
        _LOG.log(level, sentence)

    def close(self) -> None:
        """Save the file if the cache changed, and free the cache; the pipelines that were built with it stay."""
        try:
            self.save()
        finally:
            self._device.destroy("VkPipelineCache", self.handle)


def _identity(device: Device) -> tuple[int, tuple[int, int, int, int, bytes], str]:
    """Return the driver's version, the header of its caches, and the name of the device's file.

    The name includes the driver, too: otherwise two drivers for one device would replace each other's file.
    """
    driver = vk.new("VkPhysicalDeviceDriverProperties")
    properties = vk.new("VkPhysicalDeviceProperties2", pNext=driver)
    device.instance.fn.vkGetPhysicalDeviceProperties2(device.physical.handle, properties)
    plain = properties.properties
    vendor, number, uuid = int(plain.vendorID), int(plain.deviceID), bytes(plain.pipelineCacheUUID)
    header = (_HEADER.size, int(vk.VK_PIPELINE_CACHE_HEADER_VERSION_ONE), vendor, number, uuid)
    return int(plain.driverVersion), header, f"{vendor:04x}-{number:04x}-{int(driver.driverID)}.bin"
