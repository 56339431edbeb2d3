"""A parsed and checked glTF document: one dictionary, its buffers, and what the user should be told about it.

A file is taken as the standard library's json gives it. pygltflib, whose classes know the standard's defaults,
decodes every object into a dataclass, which costs about 1.2 ms per mesh, as much as all else that a model of a few
meshes takes but its pictures. It is the second opinion: asked for, it ends in the same `Document`, and a test holds
that both give equal scenes.
"""

from __future__ import annotations

import json
import re
import warnings
from pathlib import Path
from typing import Any

from common.gltf.container import Bytes, Container, Opened, open_container, read_uri
from common.gltf.refusal import Refusal, refuse
from common.gltf.schema import check_document
from common.names import is_visible, visible

SUPPORTED = frozenset(
    {
        "EXT_mesh_gpu_instancing",
        "KHR_lights_punctual",
        "KHR_materials_emissive_strength",
        "KHR_materials_unlit",
        "KHR_mesh_quantization",
        "KHR_texture_transform",
    }
)

REQUIRED_ADVICE = {
    "KHR_draco_mesh_compression": "export it without Draco compression",
    "EXT_meshopt_compression": "export it without meshopt compression",
    "KHR_texture_basisu": "export it with PNG or JPEG images",
    "EXT_texture_webp": "export it with PNG or JPEG images",
}

Object = dict[str, Any]

FREE_ELEMENTS = 2**23
"""Vertices, offsets of morph targets and zeros of accessors without a buffer view that a scene may have whatever the
size of its file; see `Document.afford`."""


class Document:
    """A checked document; `root` follows the schema, so its keys can be read without asking again.

    Buffers are mapped or decoded when first used, so that one which nothing refers to costs nothing, and may
    be missing.
    """

    def __init__(self, root: Object, container: Container, opened: Opened | None = None) -> None:
        self.root = root
        self._folder: Path = container.folder
        self._opened = opened
        self.warnings: list[str] = []
        self._binary = container.binary
        self._buffers: dict[int, Bytes] = {}
        self._views: dict[int, Bytes] = {}
        self._charged = 0

    def items(self, name: str) -> list[Object]:
        """Return a top-level list, empty where the document has none."""
        return self.root.get(name) or []

    def warn(self, text: str) -> None:
        """Keep a sentence for the user, each one once."""
        told = visible(text)
        if told not in self.warnings:
            self.warnings.append(told)

    def read_uri(self, uri: str, place: str) -> Bytes:
        """Return the bytes that a URI of this document names. Raises Refusal as `container.read_uri` does."""
        return read_uri(uri, self._folder, place, self._opened)

    def afford(self, count: int, place: str) -> None:
        """Check that `count` vertices or other elements may still be made.

        A file pays for one with each byte of its buffers, and one takes about 100 bytes of memory: what lies in the
        file has always paid for itself. Without that limit one accessor, named again and again, would fill any memory.

        Raises:
            Refusal: with them the scene would have more than `FREE_ELEMENTS` and the bytes of the buffers in use.
        """
        size = sum(len(data) for data in self._buffers.values())
        if self._charged + count > FREE_ELEMENTS + size:
            refuse(
                place,
                f"brings the scene to {self._charged + count} vertices and other elements; a file may have "
                f"{FREE_ELEMENTS} and one for each byte of its buffers, here {size}",
                "draw less of it, or store what it repeats",
            )

    def charge(self, count: int, place: str) -> None:
        """Count elements that are made. Raises Refusal as `afford` does."""
        self.afford(count, place)
        self._charged += count

    def buffer(self, index: int) -> Bytes:
        """Return the bytes of a buffer, exactly `byteLength` of them.

        Raises:
            Refusal: its file is missing or shorter than `byteLength`, or its URI is refused.
        """
        if index not in self._buffers:
            place = f"buffers[{index}]"
            entry = self.items("buffers")[index]
            uri, length = entry.get("uri"), entry["byteLength"]
            if uri:
                data = self.read_uri(uri, f"{place}.uri")
            elif index == 0 and self._binary is not None:
                data = self._binary
            else:
                refuse(f"{place}.uri", "is missing, and the file has no binary chunk for it")
            if length > len(data):
                refuse(
                    place, f"is cut short: {len(data)} of {length} bytes", "export or download its data again"
                )
            self._buffers[index] = data[:length]
        return self._buffers[index]

    def buffer_view(self, index: int) -> Bytes:
        """Return the bytes of a buffer view; no copy is made.

        Raises:
            Refusal: the view does not fit into its buffer.
        """
        if index not in self._views:
            entry = self.items("bufferViews")[index]
            offset, length = entry.get("byteOffset", 0), entry["byteLength"]
            data = self.buffer(entry["buffer"])
            if offset + length > len(data):
                refuse(
                    f"bufferViews[{index}]",
                    f"ends at byte {offset + length} of a buffer of {len(data)} bytes",
                )
            self._views[index] = data[offset : offset + length]
        return self._views[index]


def read_document(path: Path, use_library: bool = False, opened: Opened | None = None) -> Document:
    """Open, parse and check a .gltf or .glb file.

    `use_library` has pygltflib decode it; `opened` is told of each other file that the document has opened.

    Raises:
        Refusal: anything that is wrong with the file, its JSON or its shape, or an extension that it requires
            and Strata does not have.
    """
    container = open_container(path)
    text = _decode(container.text)
    root = parse(text)
    check_document(root)
    _check_version(root["asset"])
    for name in root.get("extensionsRequired") or []:
        if name not in SUPPORTED:
            advice = REQUIRED_ADVICE.get(name, "export it without this extension")
            refuse("extensionsRequired", f"names {name[:80]}, which Strata does not support", advice)
    document = Document(_through_library(text, root) if use_library else root, container, opened)
    for name in root.get("extensionsUsed") or []:
        if name not in SUPPORTED:
            document.warn(f"The extension {name[:80]} is not supported and was ignored.")
    return document


def _decode(data: Bytes) -> str:
    try:
        return data.tobytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        refuse(
            "",
            f"byte {error.start} is not UTF-8 text, so this is neither a .gltf nor a .glb",
            "check the file",
        )


def _no_constant(name: str) -> float:
    raise ValueError(f"{name} is not a JSON number")


def parse(text: str) -> Any:
    """Return the value of a JSON text, with names as `visible` makes them.

    Raises:
        Refusal: the text is not JSON, is nested too deeply, or has a number that cannot be read.
    """
    try:
        return _with_visible_names(json.loads(text, parse_constant=_no_constant), text)
    except RecursionError:
        refuse("the JSON", "is nested too deeply")
    except json.JSONDecodeError as error:
        refuse(f"line {error.lineno}, column {error.colno}", f"is not valid JSON ({error.msg})")
    except ValueError as error:  # an infinite number, or one with thousands of digits
        refuse("the JSON", f"has a number that cannot be read ({error})")


_ESCAPE = re.compile(r"\\[bfnrtu]")


def _with_visible_names(root: Any, text: str) -> Any:
    """Change every text and key in the value of a JSON text to what can be shown; return the value.

    URIs stay, because they name files; where one stands in a sentence, the whole sentence is changed.
    """
    # JSON has control characters of ASCII by its escapes alone, but for DEL.
    if text.isascii() and "\x7f" not in text and _ESCAPE.search(text) is None:
        return root
    waiting: list[Any] = [root] if isinstance(root, dict | list) else []
    while waiting:
        container = waiting.pop()
        if isinstance(container, list):
            container[:] = [visible(value) if isinstance(value, str) else value for value in container]
            waiting += [value for value in container if isinstance(value, dict | list)]
            continue
        hidden = [key for key in container if not is_visible(key)]
        for key in hidden:
            container[visible(key)] = container.pop(key)
        for key, value in container.items():
            if isinstance(value, dict | list):
                waiting.append(value)
            elif isinstance(value, str) and key != "uri":
                container[key] = visible(value)
    return root


def _check_version(asset: Object) -> None:
    for key, accepted in (("version", {"2"}), ("minVersion", {"2"})):
        version = asset.get(key)
        if version is not None and version.split(".")[0] not in accepted:
            refuse(f"asset.{key}", f"is {version!r}, and only glTF 2 is supported", "export it as glTF 2.0")
    if asset.get("minVersion") not in (None, "2.0"):
        refuse(
            "asset.minVersion", f"is {asset['minVersion']!r}, newer than glTF 2.0", "export it as glTF 2.0"
        )


def _through_library(text: str, root: Object) -> Object:
    """Return the document as pygltflib understands it, without its empty fields.

    pygltflib 1.16 has no field for a node's `weights` and empties `extras`, so both are put back. Where it
    cannot decode a document that has passed our check (say, extras nested deeper than its recursion goes), or
    drops what the check asks for (an empty list of joints), the plain document is used: both say the same.
    """
    import pygltflib  # 0.1 s, not needed otherwise

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # "NoneType object value of non-optional type": harmless defaults
            decoded: Object = parse(pygltflib.GLTF2.gltf_from_json(text).gltf_to_json())
    except Exception:
        return root
    for node, original in zip(decoded.get("nodes") or [], root.get("nodes") or [], strict=True):
        node.update({key: original[key] for key in ("weights", "extras") if key in original})
    try:
        check_document(decoded)
    except Refusal:
        return root
    return decoded
