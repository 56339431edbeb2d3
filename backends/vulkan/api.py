"""The one module between Strata and the `vulkan` package: its C types and constants, our structs, calls and checks.

The package ships Vulkan's header as a cffi interface, which is right, and a Python layer above it, which is not:
39 of its constants are wrong and 492 are None, nested structs are freed while the driver still reads them, functions
that return an address return their argument, `VK_WHOLE_SIZE` is -1, success codes such as VK_SUBOPTIMAL_KHR raise,
and a second debug messenger silently replaces the first. So only the header is used, and what a program needs above
it is here:

- constants: `vk.VK_FORMAT_R8G8B8A8_UNORM` (module attributes, taken from the header's enums);
- structs: `vk.new("VkBufferCreateInfo", size=64, usage=...)`: sType and counts filled in, everything that the struct
  points to kept alive as long as the struct itself;
- functions: a `Functions` table per instance and device, whose members are the raw C function pointers;
- results: `vk.check` raises on errors, with the call's name and a hint, and returns success codes.
"""

from __future__ import annotations

import importlib.machinery
import importlib.util
import os
import sys
import weakref
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from common.errors import DeviceError, UnsupportedError


def _load_header() -> Any:
    """Return the package's cffi object without running the package, which opens a loader by one fixed name."""
    package = importlib.util.find_spec("vulkan")
    if package is None or not package.submodule_search_locations:
        raise UnsupportedError(
            "The Python package 'vulkan' is missing: run ./strata once to set the environment up."
        )
    path = Path(next(iter(package.submodule_search_locations))) / "_vulkancache.py"
    spec = importlib.util.spec_from_file_location("_strata_vulkan_header", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.ffi


ffi: Any = _load_header()
"""Vulkan's types: `ffi.new`, `ffi.cast`, `ffi.buffer`."""

_enums: Any = ffi.dlopen(None) if sys.platform != "win32" else ffi.dlopen("kernel32")
"""Any library will do: enum constants come from the header, not from the file that is opened."""

NULL = ffi.NULL

# Macros of the header are not enums, so cffi does not know them (Vulkan specification, appendix "Defines").
_MACROS: dict[str, Any] = {
    "VK_WHOLE_SIZE": 2**64 - 1,
    "VK_REMAINING_MIP_LEVELS": 2**32 - 1,
    "VK_REMAINING_ARRAY_LAYERS": 2**32 - 1,
    "VK_QUEUE_FAMILY_IGNORED": 2**32 - 1,
    "VK_QUEUE_FAMILY_EXTERNAL": 2**32 - 2,
    "VK_ATTACHMENT_UNUSED": 2**32 - 1,
    "VK_SUBPASS_EXTERNAL": 2**32 - 1,
    "VK_SHADER_UNUSED_KHR": 2**32 - 1,
    "VK_LOD_CLAMP_NONE": 1000.0,
    "VK_TRUE": 1,
    "VK_FALSE": 0,
    "VK_API_VERSION_1_0": 1 << 22,
    "VK_API_VERSION_1_1": (1 << 22) | (1 << 12),
    "VK_API_VERSION_1_2": (1 << 22) | (2 << 12),
    "VK_API_VERSION_1_3": (1 << 22) | (3 << 12),
}


def __getattr__(name: str) -> Any:
    """Look a constant up once (`vk.VK_...`); an unknown name is an AttributeError, never None."""
    if not name.startswith("VK_"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = _MACROS.get(name)
    if value is None:
        try:
            value = getattr(_enums, name)
        except AttributeError:
            raise AttributeError(f"{name} is not a constant of Vulkan 1.3.275") from None
    globals()[name] = value
    return value


# --- structs ----------------------------------------------------------------------------------------------------------

_KEEP: dict[int, tuple[weakref.ref[Any], list[Any]]] = {}
"""id of an object -> everything that it points to. cffi keeps only the outermost allocation alive.

By identity, since cffi's pointers are equal when their addresses are: a WeakKeyDictionary would mix up a struct, its
first member, and whatever is allocated there later.
"""

_STYPES = {
    name.removeprefix("VK_STRUCTURE_TYPE_").replace("_", "").lower(): value
    for name, value in ffi.typeof("VkStructureType").relements.items()
}

_PLURALS = {"ies": "y", "ices": "ex", "sses": "ss", "Names": ""}

_COUNTS = {
    # Array members whose count has another name than theirs.
    "pBindingFlags": "bindingCount",
    "pBufferInfo": "descriptorCount",
    "pColorAttachmentFormats": "colorAttachmentCount",
    "pDescriptorCounts": "descriptorSetCount",
    "pImageIndices": "swapchainCount",
    "pImageInfo": "descriptorCount",
    "pImmutableSamplers": "descriptorCount",
    "pResolveAttachments": "colorAttachmentCount",
    "pQueuePriorities": "queueCount",
    "pSetLayouts": "descriptorSetCount",
    "pTexelBufferView": "descriptorCount",
    "pValues": "semaphoreCount",
    "pWaitDstStageMask": "waitSemaphoreCount",
}


def _counts(member: str) -> bool:
    """Whether a struct's member says how long an array is."""
    return member.endswith(("Count", "Size"))


class _StructType:
    """What `new` has to know about a struct, looked up once per name."""

    __slots__ = ("counted", "counts", "fields", "handles", "name", "pointer", "stype")

    def __init__(self, name: str) -> None:
        self.name = name
        self.pointer = ffi.typeof(f"{name} *")
        self.fields = {field: info.type for field, info in ffi.typeof(name).fields}
        self.handles = {field for field, kind in self.fields.items() if kind.cname.endswith("_T *")}
        self.stype = _STYPES[name[2:].lower()] if "sType" in self.fields else None
        self.counts = {field: count for field in self.fields if (count := self._count_of(field))}
        self.counted = any(map(_counts, self.fields))

    def _count_of(self, field: str) -> str | None:
        """Return the member that holds the length of array member `field` (pSetLayouts -> setLayoutCount)."""
        plain = field.lstrip("p")
        if plain == field or not plain:
            return None
        plain = plain[0].lower() + plain[1:]
        candidates = [plain.removesuffix("s") + "Count", plain + "Count", _COUNTS.get(field, "")]
        for ending, singular in _PLURALS.items():
            candidates.append(plain.removesuffix(ending) + singular + "Count")
        for candidate in candidates:
            if candidate in self.fields:
                return candidate
        return None


_TYPES: dict[str, _StructType] = {}


def _struct_type(name: str) -> _StructType:
    struct_type = _TYPES.get(name)
    if struct_type is None:
        try:
            # As the specification writes it: cffi calls some of them `struct VkX`.
            struct_type = _TYPES[name] = _StructType(name.removeprefix("struct ").removeprefix("union "))
        except (ffi.error, KeyError, AttributeError):
            raise AttributeError(f"{name} is not a struct of Vulkan 1.3.275") from None
    return struct_type


def new(struct: str, /, **fields: Any) -> Any:
    """Return a pointer to a new struct; what its members point to lives as long as this object does.

    Members are given by their names in the specification. sType is filled in; a list, tuple or numpy array for an
    array member also fills its count member. Nested structs are dicts or results of `new`; strings are str; None
    leaves a member zero. A wrong member name raises AttributeError, a wrong kind of value TypeError.
    """
    described = _struct_type(struct)
    kept: list[Any] = []
    pointer = ffi.new(described.pointer, _members(described, fields, kept))
    if kept:
        # By the struct rather than by the pointer: `new(...)[0]` drops the pointer.
        keep(pointer[0], *kept)
    return pointer


def _members(described: _StructType, fields: dict[str, Any], kept: list[Any]) -> dict[str, Any]:
    """Return what cffi fills a struct with; see `new`."""
    init: dict[str, Any] = {} if described.stype is None else {"sType": described.stype}
    for name, value in fields.items():
        if value is None:
            continue
        ctype = described.fields.get(name)
        if ctype is None:
            raise AttributeError(f"{described.name} has no member {name}")
        if type(value) is int or (name in described.handles and isinstance(value, ffi.CData)):
            init[name] = value  # most are, there is nothing to keep, and cffi refuses one where it is none
            continue
        init[name] = _convert(ctype, value, kept)
        if isinstance(value, (list, tuple, np.ndarray)) and ctype.kind == "pointer":
            count = described.counts.get(name)
            if count is not None and count not in fields:
                init[count] = value.size if isinstance(value, np.ndarray) else len(value)
            elif count is None and described.counted and not any(map(_counts, fields)):
                # A count left at zero would have the driver ignore the array, or read past it.
                raise TypeError(f"{described.name}: give the count of {name}, a member of another name")
    return init


def array(item: str, values: Iterable[Any]) -> Any:
    """Return a C array of structs, handles or numbers, with everything they point to kept alive."""
    kept: list[Any] = []
    array = _array(ffi.typeof(item), list(values), kept)
    return keep(array, *kept) if kept else array


def _forget(key: int, _: object, drop: Callable[..., Any] = _KEEP.pop) -> None:
    """Drop what a dead owner kept. `drop` is bound here: at exit the module's names are gone before its objects."""
    drop(key, None)


def keep(owner: Any, *things: Any) -> Any:
    """Keep `things` alive as long as the cffi object `owner`; return `owner`."""
    key = id(owner)
    kept = _KEEP.get(key)
    if kept is None:
        # The callback runs while the object dies, so before its id can be another's.
        kept = _KEEP[key] = (weakref.ref(owner, partial(_forget, key)), [])
    kept[1].extend(things)
    return owner


def _array(item: Any, values: list[Any], keep: list[Any]) -> Any:
    return ffi.new(
        f"{item.cname}[]" if item.kind != "pointer" else ffi.getctype(item, "[]"),
        [_convert(item, v, keep) for v in values],
    )


def _convert(ctype: Any, value: Any, keep: list[Any]) -> Any:
    """Turn a Python value into what cffi stores in a member of type `ctype`, noting in `keep` what must stay alive."""
    kind = ctype.kind
    if kind == "pointer":
        return _convert_pointer(ctype, value, keep)
    if kind in ("struct", "union"):
        if isinstance(value, dict):
            if kind == "union":
                fields = dict(ctype.fields)
                return {name: _convert(fields[name].type, item, keep) for name, item in value.items()}
            return _members(_struct_type(ctype.cname), value, keep)
        if isinstance(value, ffi.CData) and ffi.typeof(value).kind == "pointer":
            keep.append(value)
            return value[0]
        return value
    if kind == "array":
        if isinstance(value, (bytes, str)):
            return value.encode() if isinstance(value, str) else value
        return [_convert(ctype.item, item, keep) for item in value]
    if kind == "enum" or isinstance(value, np.integer):
        return int(value)
    if isinstance(value, np.floating):
        return float(value)
    return value


def _fits(dtype: np.dtype[Any], item: Any) -> bool:
    """Whether numbers (or records) of `dtype` are what an array of C type `item` holds, bit for bit."""
    if item.kind == "void":
        return True
    if dtype.itemsize != ffi.sizeof(item) or not dtype.isnative:
        return False
    return item.kind != "primitive" or (dtype.kind == "f") == (item.cname in ("float", "double"))


def _convert_pointer(ctype: Any, value: Any, keep: list[Any]) -> Any:
    item = ctype.item
    if isinstance(value, ffi.CData):
        keep.append(value)
        return ffi.cast("void *", value) if item.kind == "void" else value
    if isinstance(value, str):
        data = ffi.new("char[]", value.encode())
    elif isinstance(value, dict) and item.kind != "void":
        data = new(item.cname, **value)
    elif isinstance(value, np.ndarray):
        if not _fits(value.dtype, item):
            raise TypeError(f"an array of {value.dtype} was given for {ctype.cname}")
        data = ffi.from_buffer(np.ascontiguousarray(value))
        keep.append(data)
        return ffi.cast(ctype, data)
    elif isinstance(value, (bytes, bytearray, memoryview)):
        data = ffi.from_buffer(value)
        keep.append(data)
        return ffi.cast(ctype, data)
    elif isinstance(value, (list, tuple)) and item.kind != "void":
        data = _array(item, list(value), keep)
    else:
        raise TypeError(f"{type(value).__name__} given for {ctype.cname}")
    keep.append(data)
    return data


# --- functions and results --------------------------------------------------------------------------------------------


class Functions:
    """Raw C function pointers of one instance or device, resolved at first use: `functions.vkCmdDraw(...)`.

    A member is a cffi function: it converts nothing, checks nothing, and costs half a microsecond. Pass structs made
    by `new`, arrays made by `array`, `NULL`.
    """

    def __init__(self, resolve: Callable[[bytes], Any]) -> None:
        self._resolve = resolve
        self._trace: list[tuple[str, tuple[Any, ...]]] | None = None

    def __getattr__(self, name: str) -> Any:
        if not name.startswith("vk"):
            raise AttributeError(name)
        address = self._resolve(name.encode())
        if address == NULL:
            raise UnsupportedError(
                f"This Vulkan driver has no {name}: an extension or version it needs is missing."
            )
        function = ffi.cast(f"PFN_{name}", address)
        if self._trace is not None:
            function = self._traced(name, function, self._trace)
        self.__dict__[name] = function
        return function

    @staticmethod
    def _traced(name: str, function: Any, log: list[tuple[str, tuple[Any, ...]]]) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            log.append((name, arguments))
            return function(*arguments)

        return call

    def trace(self, log: list[tuple[str, tuple[Any, ...]]] | None) -> None:
        """Append (name, arguments) of every later call to `log`; None stops, and then a call costs nothing extra."""
        for name in [name for name in self.__dict__ if name.startswith("vk")]:
            del self.__dict__[name]
        self._trace = log


_RESULT_NAMES = {value: name for name, value in ffi.typeof("VkResult").relements.items()}

_HINTS = {
    "VK_ERROR_OUT_OF_DEVICE_MEMORY": "the GPU's memory is full: a smaller --size or scene needs less",
    "VK_ERROR_OUT_OF_HOST_MEMORY": "the machine's memory is full: a smaller --size or scene needs less",
    "VK_ERROR_DEVICE_LOST": "the driver stopped: run again with --validate, which names the call that was wrong",
    "VK_ERROR_INCOMPATIBLE_DRIVER": "no driver was found that can do this: ./strata doctor says what to install",
    "VK_ERROR_LAYER_NOT_PRESENT": "install the Vulkan validation layers, or run without --validate",
    "VK_ERROR_EXTENSION_NOT_PRESENT": "./strata doctor lists the extensions of every device",
    "VK_ERROR_INITIALIZATION_FAILED": "./strata doctor shows which drivers the loader found",
}


class VulkanError(DeviceError):
    """A Vulkan call failed; `code` is its VkResult, `call` the function's name."""

    def __init__(self, call: str, code: int, arguments: tuple[Any, ...] = ()) -> None:
        self.call, self.code = call, code
        self.result = _RESULT_NAMES.get(code, str(code))
        hint = f": {_HINTS[self.result]}" if self.result in _HINTS else ""
        text = f"{call}({', '.join(map(_shown, arguments))}) failed with {self.result}{hint}."
        super().__init__(text, self.result.endswith(("_DEVICE_MEMORY", "_HOST_MEMORY")))


def _shown(argument: Any) -> str:
    """Return an argument as a reader of an error message wants it: the struct's name, or the value."""
    if not isinstance(argument, ffi.CData):
        return repr(argument)
    if argument == NULL:
        return "NULL"
    return ffi.typeof(argument).cname


def check(code: int, call: str, *arguments: Any) -> int:
    """Raise VulkanError if `code` is an error; return it otherwise (VK_SUCCESS, VK_SUBOPTIMAL_KHR, VK_TIMEOUT...)."""
    if code < 0:
        raise VulkanError(call, code, arguments)
    return code


def listed(function: Any, call: str, item: str, *arguments: Any) -> list[Any]:
    """Call a function of the two-call kind (count, then data) and return its items, however often the count changes.

    Structs are returned as pointers that own their memory, with sType set.
    """
    count = ffi.new("uint32_t *")
    ctype = ffi.typeof(item)
    stype = _struct_type(item).stype if ctype.kind == "struct" else None
    while True:
        check(function(*arguments, count, NULL) or 0, call)
        # A list that grows between the two calls is cut off, which VK_INCOMPLETE says.
        data = ffi.new(ffi.getctype(ctype, "[]"), max(count[0], 1))
        if stype is not None:
            for index in range(len(data)):
                data[index].sType = stype
        if check(function(*arguments, count, data) or 0, call) != __getattr__("VK_INCOMPLETE"):
            break
    if ctype.kind != "struct":
        return [data[index] for index in range(count[0])]
    return [keep(ffi.addressof(data, index), data) for index in range(count[0])]


def text(chars: Any) -> str:
    """Return a C string as str; drivers are not always UTF-8."""
    return "" if chars == NULL else ffi.string(chars).decode("utf-8", "replace")


# --- the loader -------------------------------------------------------------------------------------------------------


def loader_names(platform: str, environment: dict[str, str]) -> list[str]:
    """Return the names under which a Vulkan loader (or MoltenVK itself) is looked for, best first."""
    if platform == "win32":
        return ["vulkan-1.dll"]
    if platform == "darwin":
        sdk = environment.get("VULKAN_SDK")
        folders = [f"{sdk}/lib"] if sdk else []
        folders += ["/opt/homebrew/lib", "/usr/local/lib"]  # Homebrew on Apple silicon and on Intel
        libraries = ("libvulkan.dylib", "libvulkan.1.dylib", "libMoltenVK.dylib")
        return [*libraries, *(f"{folder}/{library}" for library in libraries for folder in folders)]
    return ["libvulkan.so.1", "libvulkan.so"]


def open_loader() -> tuple[Any, str]:
    """Return (library, name) of the Vulkan loader; raise UnsupportedError where there is none."""
    for name in loader_names(sys.platform, dict(os.environ)):
        try:
            return ffi.dlopen(name), name
        except OSError:
            continue
    raise UnsupportedError(
        "No Vulkan loader was found on this machine: ./strata doctor says what to install."
    )


_opened: list[Any] = []
"""Loaders stay open: cffi closes a library with its last reference, and drivers would be unmapped while in use."""


def global_functions() -> tuple[Functions, Any]:
    """Return the functions that exist before an instance does, and the loader's `vkGetInstanceProcAddr`."""
    if not _opened:
        _opened.append(open_loader()[0])
    get = _opened[0].vkGetInstanceProcAddr
    return Functions(lambda name: get(NULL, name)), get
