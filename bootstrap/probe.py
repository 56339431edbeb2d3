"""Ask the graphics drivers of this machine what they offer, with ctypes alone: `python probe.py vulkan|gl`.

Drivers crash and hang, so `ask` runs this file in a child process and takes every bad end for "there is none".
"""

from __future__ import annotations

import ctypes
import json
import os
import subprocess
import sys
from ctypes import POINTER, byref, c_char_p, c_int, c_uint32, c_void_p
from pathlib import Path
from typing import Any

TIMEOUT_S = (
    30  # a software driver that has to compile its first program on a busy machine needs a few seconds
)


def ask(what: str, timeout_s: float = TIMEOUT_S, script: str = __file__) -> dict[str, Any]:
    """Return what the child process found out about "vulkan" or "gl"; {} when it crashed, hung or found nothing."""
    command = [sys.executable, "-I", script, what]
    try:
        done = subprocess.run(
            command, stdin=subprocess.DEVNULL, capture_output=True, timeout=timeout_s, check=False
        )
        found = json.loads(done.stdout) if done.returncode == 0 else {}
    except (OSError, ValueError, subprocess.TimeoutExpired):
        return {}
    return found if isinstance(found, dict) else {}


def vulkan() -> dict[str, Any]:
    """Return {"device", "version", "layers"}: the device with the highest version of the API, as [major, minor]."""
    library = _load(_vulkan_names())
    get = library.vkGetInstanceProcAddr
    get.restype, get.argtypes = c_void_p, [c_void_p, c_char_p]

    def function(instance: Any, name: str, *arguments: Any) -> Any:
        address = get(instance, name.encode())
        if not address:
            raise OSError(f"the Vulkan loader has no {name}")
        return ctypes.CFUNCTYPE(c_int, *arguments)(address)

    def names(enumerate_: Any, size: int) -> list[str]:
        count = c_uint32()
        enumerate_(byref(count), None)
        records = ctypes.create_string_buffer(size * max(count.value, 1))
        enumerate_(byref(count), records)
        return [_text(records.raw[i * size : i * size + 256]) for i in range(count.value)]

    layer_call = function(None, "vkEnumerateInstanceLayerProperties", POINTER(c_uint32), c_void_p)
    extension_call = function(
        None, "vkEnumerateInstanceExtensionProperties", c_char_p, POINTER(c_uint32), c_void_p
    )
    layers = names(layer_call, 520)  # sizeof(VkLayerProperties)
    extensions = names(lambda count, data: extension_call(None, count, data), 260)

    # MoltenVK is listed only to programs that say that they know it is not complete.
    portability = [e for e in extensions if e == "VK_KHR_portability_enumeration"]
    application = _Application(0, None, b"strata", 0, None, 0, (1 << 22) | (3 << 12))
    extension_array = (c_char_p * 1)(*(e.encode() for e in portability))
    create_info = _InstanceCreate(
        1, None, len(portability), ctypes.pointer(application), 0, None, len(portability), extension_array
    )
    instance = c_void_p()
    create = function(None, "vkCreateInstance", POINTER(_InstanceCreate), c_void_p, POINTER(c_void_p))
    if create(byref(create_info), None, byref(instance)) != 0:
        return {"layers": layers}

    list_devices = function(
        instance, "vkEnumeratePhysicalDevices", c_void_p, POINTER(c_uint32), POINTER(c_void_p)
    )
    properties_of = function(instance, "vkGetPhysicalDeviceProperties", c_void_p, c_void_p)
    devices = (c_void_p * 16)()
    count = c_uint32(16)
    list_devices(instance, byref(count), devices)
    best: dict[str, Any] = {}
    for device in devices[: count.value]:
        # VkPhysicalDeviceProperties (824 bytes) begins with five 32-bit numbers, the first is the API's version,
        # and the name of the device.
        record = ctypes.create_string_buffer(4096)
        properties_of(device, record)
        packed = int.from_bytes(record.raw[:4], sys.byteorder)
        version = [(packed >> 22) & 0x7F, (packed >> 12) & 0x3FF]
        if version > best.get("version", [0, 0]):
            best = {"device": _text(record.raw[20:276]), "version": version}
    return {**best, "layers": layers}


def gl() -> dict[str, Any]:
    """Return {"device", "version"} of the best OpenGL core context that EGL gives without a display."""
    library = _load(["libEGL.so.1", "libEGL.so"])
    library.eglGetProcAddress.restype = c_void_p
    library.eglGetProcAddress.argtypes = [c_char_p]

    def function(name: str, result: Any, *arguments: Any) -> Any:
        return ctypes.CFUNCTYPE(result, *arguments)(library.eglGetProcAddress(name.encode()))

    def numbers(*values: int) -> Any:
        return (c_int * len(values))(*values)

    surfaceless, none = 0x31DD, 0x3038
    display = function("eglGetPlatformDisplayEXT", c_void_p, c_int, c_void_p, POINTER(c_int))(
        surfaceless, None, None
    )
    if not display or not function("eglInitialize", c_int, c_void_p, c_void_p, c_void_p)(display, None, None):
        return {}
    function("eglBindAPI", c_int, c_int)(0x30A2)  # EGL_OPENGL_API
    version, profile = (0x3098, 4, 0x30FB, 5), (0x30FD, 1)  # 4.5, core
    context = function("eglCreateContext", c_void_p, c_void_p, c_void_p, c_void_p, POINTER(c_int))(
        display, None, None, numbers(*version, *profile, none)
    )
    make_current = function("eglMakeCurrent", c_int, c_void_p, c_void_p, c_void_p, c_void_p)
    if not context or not make_current(display, None, None, context):
        return {}
    text = function("glGetString", c_char_p, c_int)
    words = text(0x1F02).decode().split(".")  # GL_VERSION: "4.5 (Core Profile) Mesa ..."
    return {"device": text(0x1F01).decode(), "version": [int(words[0]), int(words[1].split()[0])]}


class _Application(ctypes.Structure):
    _fields_ = [
        ("sType", c_int),
        ("pNext", c_void_p),
        ("pApplicationName", c_char_p),
        ("applicationVersion", c_uint32),
        ("pEngineName", c_char_p),
        ("engineVersion", c_uint32),
        ("apiVersion", c_uint32),
    ]


class _InstanceCreate(ctypes.Structure):
    _fields_ = [
        ("sType", c_int),
        ("pNext", c_void_p),
        ("flags", c_uint32),  # 1: VK_INSTANCE_CREATE_ENUMERATE_PORTABILITY_BIT_KHR
        ("pApplicationInfo", POINTER(_Application)),
        ("enabledLayerCount", c_uint32),
        ("ppEnabledLayerNames", c_void_p),
        ("enabledExtensionCount", c_uint32),
        ("ppEnabledExtensionNames", POINTER(c_char_p)),
    ]


def _vulkan_names() -> list[str]:
    if sys.platform == "win32":
        return ["vulkan-1.dll"]
    if sys.platform == "darwin":
        libraries = ["libvulkan.dylib", "libvulkan.1.dylib", "libMoltenVK.dylib"]
        sdk = os.environ.get("VULKAN_SDK")
        folders = [Path(sdk) / "lib"] if sdk else []
        folders += [
            Path("/opt/homebrew/lib"),
            Path("/usr/local/lib"),
        ]  # Homebrew on Apple silicon and on Intel
        return libraries + [str(folder / library) for library in libraries for folder in folders]
    return ["libvulkan.so.1", "libvulkan.so"]


def _load(names: list[str]) -> ctypes.CDLL:
    for name in names:
        try:
            return ctypes.CDLL(name)
        except OSError:
            continue
    raise OSError(f"none of {', '.join(names)} can be loaded")


def _text(raw: bytes) -> str:
    return raw.split(b"\0", 1)[0].decode("utf-8", "replace")


if __name__ == "__main__":
    try:
        answer = {"vulkan": vulkan, "gl": gl}[sys.argv[1]]()
    except OSError:
        answer = {}
    sys.stdout.write(json.dumps(answer))
    sys.stdout.flush()
    os._exit(0)  # past the drivers' own clean-up, which is known to crash
