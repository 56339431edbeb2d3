"""What mutations put into a glTF document: ends of numbers, texts, URIs, and the lists that its numbers refer to."""

from __future__ import annotations

INTEGERS = (
    -1,
    0,
    1,
    2,
    3,
    255,
    256,
    65535,
    65536,
    2**24,
    2**24 + 1,
    2**31 - 1,
    2**31,
    2**32,
    2**53 + 1,
    10**30,
)
SMALL = (0, 0, 1, 1, 2, 3, 4, 5, 8, 16, 100)
FLOATS = (
    *(
        0.0,
        -0.0,
        1.0,
        -1.0,
        0.5,
        1e-7,
        1e-30,
        5e-324,
        1e6,
        1e9,
        1e12,
        1e17,
        1e18,
        -1e18,
        1.1e18,
        1e25,
        3.4e38,
        3.5e38,
    ),
    *(1e154, 1e300, -1e308, 1.7976931348623157e308, 3.141592653589793, 6.3, 90.0),
)
RAW = ("NaN", "Infinity", "-Infinity", "1e999", "-1e999", "1" + "0" * 5000, "0x10", "01", "tru", "1e-400")
"""Texts that json.dumps would not write, or not so."""

TYPES = ("SCALAR", "VEC2", "VEC3", "VEC4", "MAT2", "MAT3", "MAT4", "VEC5", "scalar", "")
COMPONENTS = (5120, 5121, 5122, 5123, 5125, 5126, 5124, 0)
URIS = (
    *(
        "/dev/zero",
        "..%2f..%2fdev%2fzero",
        "..%2fsecret.png",
        "../secret.png",
        "%2e%2e/secret.png",
        "link.png",
        "zero",
    ),
    *(
        "pipe",
        "./pipe",
        "folder.png",
        ".",
        "",
        "/",
        "\\\\host\\share\\a.png",
        "C:\\a.png",
        "file:///dev/zero",
    ),
    *(
        "http://127.0.0.1:9/a.png",
        "data:",
        "data:,",
        "data:;base64,A",
        "data:image/png;base64,",
        "DATA:,x",
        "a\x00b.png",
    ),
    *(
        "data:application/octet-stream;base64,//8",
        "\ud800.png",
        "%ff%fe.png",
        "%00",
        "x" * 5000,
        "a/b/../../../secret.png",
    ),
    *(
        "missing.png",
        "SCENE.BIN",
        "picture%200.PNG",
        "scene.gltf",
        "scene.glb",
        "/proc/self/environ",
        "/etc/passwd",
    ),
)
FORGED = "strata: forged"
"""A line of a message that no program of this project writes."""
TEXTS = (
    *(
        "\ud800",
        "a\udfffb",
        "\x1b[31mred\x1b[0m",
        f"x\n{FORGED}",
        f"x\r{FORGED}",
        f"x\u2028{FORGED}",
        f"x\x85{FORGED}",
    ),
    *(
        "\x00",
        "\x07\x08",
        "\u202egnp.exe",
        "[/bold]",
        "[link=http://x]y",
        ":smile:",
        "%s{0}{x!r}",
        "",
        " ",
        "n" * 20000,
        "../x",
    ),
    *("a\u0301" * 300, "\U0010ffff", "\ufeff", "CON", "-v", "\x9b31m"),
)
EXTENSIONS = (
    *("KHR_texture_transform", "KHR_lights_punctual", "EXT_mesh_gpu_instancing", "KHR_materials_unlit"),
    *(
        "KHR_mesh_quantization",
        "KHR_materials_emissive_strength",
        "KHR_draco_mesh_compression",
        "VENDOR_unknown",
    ),
)
REFERENCES = {
    "mesh": "meshes",
    "material": "materials",
    "source": "images",
    "sampler": "samplers",
    "skin": "skins",
    "camera": "cameras",
    "node": "nodes",
    "bufferView": "bufferViews",
    "buffer": "buffers",
    "indices": "accessors",
    "input": "accessors",
    "output": "accessors",
    "inverseBindMatrices": "accessors",
    "skeleton": "nodes",
    "index": "textures",
    "scene": "scenes",
}
"""Keys that hold the number of an entry, and the list that has it; attributes hold numbers of accessors."""
