"""A small writer of glTF 2.0: numpy in, pygltflib objects and one binary buffer out.

Every float that reaches a file is rounded to multiples of 2^-12 (a quarter of a millimetre): generators then write the
same numbers on every processor although their sines differ in the last bit, and the numbers compress well.
"""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pygltflib as gl
from numpy.typing import NDArray
from PIL import Image

from assets.shapes import Float64, Mesh, Vector
from common.paths import write_whole

GRID = 2.0**-12
"""Step of every float in a generated file, in its own unit (metres, uv, candela...)."""

CAMERA_NEAR = 0.05  # metres
_COMPONENT = {
    np.dtype(np.uint8): gl.UNSIGNED_BYTE,
    np.dtype(np.uint16): gl.UNSIGNED_SHORT,
    np.dtype(np.uint32): gl.UNSIGNED_INT,
    np.dtype(np.float32): gl.FLOAT,
}
Channel = tuple[int, str, Float64, Float64, str]
"""What moves: node, path, times (K,), values (K, C) or for CUBICSPLINE (3K, C), interpolation."""

_TYPE = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}


def on_grid(values: Any) -> NDArray[np.float64]:
    """Return `values` as float64 rounded to the grid, without negative zeros."""
    return np.round(np.asarray(values, np.float64) / GRID) * GRID + 0.0


def numbers(values: Vector) -> list[float]:
    """Return `values` on the grid as a list for JSON, whole numbers as int."""
    return [int(v) if v == int(v) else float(v) for v in on_grid(values)]


def number(value: float) -> float:
    """Return one value on the grid for JSON."""
    return numbers([value])[0]


def axis_angle(axis: Vector, degrees: float) -> tuple[float, float, float, float]:
    """Return the quaternion xyzw that turns by `degrees` about the unit vector `axis`."""
    half = math.radians(degrees) / 2
    s = math.sin(half)
    return (axis[0] * s, axis[1] * s, axis[2] * s, math.cos(half))


def look_at(eye: Vector, target: Vector) -> tuple[float, float, float, float]:
    """Return the rotation xyzw of a camera or light at `eye` whose -z axis points at `target`, without roll.

    The two points must not lie straight above each other.
    """
    to_target = np.subtract(target, eye).astype(np.float64)
    yaw = math.atan2(-to_target[0], -to_target[2])
    pitch = math.atan2(to_target[1], math.hypot(to_target[0], to_target[2]))
    cy, sy, cp, sp = math.cos(yaw / 2), math.sin(yaw / 2), math.cos(pitch / 2), math.sin(pitch / 2)
    return (cy * sp, sy * cp, -sy * sp, cy * cp)


@dataclass(frozen=True)
class Texture:
    """One use of an image by a material; `transform` is the body of KHR_texture_transform."""

    image: int
    uv_set: int = 0
    transform: dict[str, Any] | None = None
    scale: float | None = None  # of a normal map
    strength: float | None = None  # of an occlusion map


@dataclass
class GltfBuilder:
    """Collects a scene; `save` writes it. Every `add_*` returns the index of what it added."""

    name: str
    gltf: gl.GLTF2 = field(init=False)
    images: list[tuple[str, NDArray[np.uint8]]] = field(default_factory=list)  # name, (H, W, C) pixels
    blob: bytearray = field(default_factory=bytearray)

    def __post_init__(self) -> None:
        self.gltf = gl.GLTF2(asset=gl.Asset(version="2.0", generator="Strata scene generator"))
        self.gltf.scene = 0
        self.gltf.scenes = [gl.Scene(name=self.name, nodes=[])]

    def use_extension(self, name: str) -> None:
        """Name an optional extension in `extensionsUsed`; nothing that is generated is ever required."""
        if name not in self.gltf.extensionsUsed:
            self.gltf.extensionsUsed = sorted([*self.gltf.extensionsUsed, name])

    # -- buffers -------------------------------------------------------------------------------------------------

    def add_accessor(self, array: NDArray[Any], target: int | None = None, bounds: bool = False) -> int:
        """Store `array` (N,) or (N, C); floats are put on the grid, uint8 is written as normalised."""
        if array.dtype.kind == "f":
            array = on_grid(array).astype(np.float32)
        view = gl.BufferView(buffer=0, byteOffset=len(self.blob), byteLength=array.nbytes, target=target)
        self.blob += np.ascontiguousarray(array).tobytes()
        self.blob += bytes(-len(self.blob) % 4)
        self.gltf.bufferViews.append(view)
        accessor = gl.Accessor(
            bufferView=len(self.gltf.bufferViews) - 1,
            componentType=_COMPONENT[array.dtype],
            normalized=array.dtype == np.uint8,
            count=len(array),
            type=_TYPE[1 if array.ndim == 1 else array.shape[1]],
        )
        if bounds:
            rows = array.reshape(len(array), -1)
            accessor.min, accessor.max = numbers(rows.min(axis=0)), numbers(rows.max(axis=0))
        self.gltf.accessors.append(accessor)
        return len(self.gltf.accessors) - 1

    def add_mesh(self, name: str, *parts: tuple[Mesh, int]) -> int:
        """Add a mesh of one primitive per (geometry, material) pair."""
        return self.add_mesh_of(
            name, *((self.add_geometry(mesh, material), material) for mesh, material in parts)
        )

    def add_geometry(self, mesh: Mesh, material: int) -> gl.Primitive:
        """Store a mesh's arrays and return a primitive that several meshes may share with materials like this one.

        Only what the material can use is stored: no uv without textures, no tangents without a normal map.
        """
        mesh.check()
        used = self.gltf.materials[material]
        uv_sets = self._uv_sets(used)
        vertex = gl.ARRAY_BUFFER
        attributes = gl.Attributes(
            POSITION=self.add_accessor(mesh.positions, vertex, bounds=True),
            NORMAL=self.add_accessor(mesh.normals, vertex),
        )
        if mesh.uv0 is not None and 0 in uv_sets:
            attributes.TEXCOORD_0 = self.add_accessor(mesh.uv0, vertex)
        if mesh.uv1 is not None and 1 in uv_sets:
            attributes.TEXCOORD_1 = self.add_accessor(mesh.uv1, vertex)
        if mesh.tangents is not None and used.normalTexture is not None:
            attributes.TANGENT = self.add_accessor(mesh.tangents, vertex)
        if mesh.colors is not None:
            attributes.COLOR_0 = self.add_accessor(np.round(mesh.colors * 255).astype(np.uint8), vertex)
        kind = np.uint16 if len(mesh.positions) < 0xFFFF else np.uint32
        indices = self.add_accessor(mesh.triangles.astype(kind).ravel(), gl.ELEMENT_ARRAY_BUFFER)
        return gl.Primitive(attributes=attributes, indices=indices)

    def add_mesh_of(self, name: str, *parts: tuple[gl.Primitive, int]) -> int:
        """Add a mesh from stored geometry, (primitive, material) pairs."""
        primitives = [
            gl.Primitive(attributes=stored.attributes, indices=stored.indices, material=material)
            for stored, material in parts
        ]
        self.gltf.meshes.append(gl.Mesh(name=name, primitives=primitives))
        return len(self.gltf.meshes) - 1

    # -- materials -----------------------------------------------------------------------------------------------

    def add_image(self, name: str, pixels: NDArray[np.uint8]) -> int:
        """Add a picture (H, W), (H, W, 3) or (H, W, 4) and a texture that repeats it; return the texture's index."""
        if not self.gltf.samplers:
            filters = {"magFilter": gl.LINEAR, "minFilter": gl.LINEAR_MIPMAP_LINEAR}
            self.gltf.samplers = [gl.Sampler(**filters, wrapS=gl.REPEAT, wrapT=gl.REPEAT)]
        self.images.append((name, pixels))
        self.gltf.textures.append(gl.Texture(sampler=0, source=len(self.images) - 1, name=name))
        return len(self.images) - 1

    def add_material(
        self,
        name: str,
        color: Sequence[float] = (1.0, 1.0, 1.0),
        metallic: float = 0.0,
        roughness: float = 1.0,
        base: Texture | None = None,
        surface: Texture | None = None,
        normal: Texture | None = None,
        occlusion: Texture | None = None,
        emission: Texture | None = None,
        emissive_nits: Sequence[float] | None = None,
        alpha: str = "OPAQUE",
        double_sided: bool = False,
        unlit: bool = False,
    ) -> int:
        """Add a material: linear `color` (3 or 4), textures by role (`surface` is metallic-roughness).


        Emission is in nits. glTF's emissive factor ends at 1; what is above goes to KHR_materials_emissive_strength.
        """
        pbr = gl.PbrMetallicRoughness(
            baseColorFactor=numbers([*color, 1.0][:4]),
            metallicFactor=number(metallic),
            roughnessFactor=number(roughness),
            baseColorTexture=self._texture_info(base, gl.TextureInfo),
            metallicRoughnessTexture=self._texture_info(surface, gl.TextureInfo),
        )
        material = gl.Material(name=name, pbrMetallicRoughness=pbr, alphaMode=alpha, doubleSided=double_sided)
        material.normalTexture = self._texture_info(normal, gl.NormalMaterialTexture)
        material.occlusionTexture = self._texture_info(occlusion, gl.OcclusionTextureInfo)
        material.emissiveTexture = self._texture_info(emission, gl.TextureInfo)
        if alpha == "MASK":
            material.alphaCutoff = 0.5
        if emissive_nits is not None:
            strength = max(1.0, *emissive_nits)
            material.emissiveFactor = numbers(np.divide(emissive_nits, strength))
            if strength > 1.0:
                self.use_extension("KHR_materials_emissive_strength")
                material.extensions["KHR_materials_emissive_strength"] = {
                    "emissiveStrength": number(strength)
                }
        if unlit:
            self.use_extension("KHR_materials_unlit")
            material.extensions["KHR_materials_unlit"] = {}
        self.gltf.materials.append(material)
        return len(self.gltf.materials) - 1

    @staticmethod
    def _uv_sets(material: gl.Material) -> set[int]:
        pbr = material.pbrMetallicRoughness
        roles = (
            pbr.baseColorTexture,
            pbr.metallicRoughnessTexture,
            material.normalTexture,
            material.occlusionTexture,
            material.emissiveTexture,
        )
        return {info.texCoord for info in roles if info is not None}

    def _texture_info(self, texture: Texture | None, kind: type) -> Any:
        if texture is None:
            return None
        info = kind(index=texture.image, texCoord=texture.uv_set)
        if texture.scale is not None:
            info.scale = number(texture.scale)
        if texture.strength is not None:
            info.strength = number(texture.strength)
        if texture.transform is not None:
            self.use_extension("KHR_texture_transform")
            info.extensions["KHR_texture_transform"] = texture.transform
        return info

    # -- nodes ---------------------------------------------------------------------------------------------------

    def add_node(
        self,
        name: str,
        parent: int | None = None,
        translation: Vector | None = None,
        rotation: Vector | None = None,
        scale: Vector | None = None,
        matrix: NDArray[np.float64] | None = None,
        mesh: int | None = None,
        extras: dict[str, Any] | None = None,
    ) -> int:
        """Add a node below `parent` (None: a root). `matrix` is (4, 4) parent_from_node."""
        node = gl.Node(name=name, mesh=mesh, extras=extras or {})
        node.translation = None if translation is None else numbers(translation)
        node.rotation = None if rotation is None else numbers(rotation)
        node.scale = None if scale is None else numbers(scale)
        node.matrix = None if matrix is None else numbers(np.asarray(matrix).T.ravel())
        self.gltf.nodes.append(node)
        index = len(self.gltf.nodes) - 1
        siblings = self.gltf.scenes[0].nodes if parent is None else self.gltf.nodes[parent].children
        siblings.append(index)
        return index

    def instance_on_gpu(self, node: int, translation: Float64, rotation: Float64, scale: Float64) -> None:
        """Draw the node's mesh once per row of (N, 3), (N, 4), (N, 3) by EXT_mesh_gpu_instancing."""
        self.use_extension("EXT_mesh_gpu_instancing")
        values = {"TRANSLATION": translation, "ROTATION": rotation, "SCALE": scale}
        attributes = {key: self.add_accessor(array) for key, array in values.items()}
        self.gltf.nodes[node].extensions["EXT_mesh_gpu_instancing"] = {"attributes": attributes}

    def add_camera(
        self,
        name: str,
        eye: Vector,
        target: Vector,
        yfov_degrees: float,
        ev100: float,
        parent: int | None = None,
    ) -> int:
        """Add a perspective camera without far plane at `eye`; its exposure goes to `extras.strata.ev100`."""
        lens = gl.Perspective(yfov=number(math.radians(yfov_degrees)), znear=number(CAMERA_NEAR))
        extras = {"strata": {"ev100": number(ev100)}}
        self.gltf.cameras.append(gl.Camera(type="perspective", perspective=lens, name=name, extras=extras))
        node = self.add_node(name, parent, translation=eye, rotation=look_at(eye, target))
        self.gltf.nodes[node].camera = len(self.gltf.cameras) - 1
        return node

    def add_plan_camera(
        self, name: str, eye: Vector, half: float, far: float, ev100: float, parent: int | None = None
    ) -> int:
        """Add an orthographic camera that looks straight down, -z upwards: `half` is half the height of its view."""
        lens = gl.Orthographic(
            xmag=number(half), ymag=number(half), znear=number(CAMERA_NEAR), zfar=number(far)
        )
        extras = {"strata": {"ev100": number(ev100)}}
        self.gltf.cameras.append(gl.Camera(type="orthographic", orthographic=lens, name=name, extras=extras))
        node = self.add_node(name, parent, translation=eye, rotation=axis_angle((1, 0, 0), -90))
        self.gltf.nodes[node].camera = len(self.gltf.cameras) - 1
        return node

    def add_light(
        self,
        name: str,
        kind: str,
        color: Sequence[float],
        intensity: float,
        parent: int | None = None,
        translation: Vector | None = None,
        rotation: Vector | None = None,
        reach: float | None = None,
        cone_degrees: tuple[float, float] | None = None,
    ) -> int:
        """Add a punctual light: lux if directional, else candela; `reach` in metres; inner and outer half angles."""
        light: dict[str, Any] = {
            "name": name,
            "type": kind,
            "color": numbers(color),
            "intensity": number(intensity),
        }
        if reach is not None:
            light["range"] = number(reach)
        if cone_degrees is not None:
            inner, outer = (number(math.radians(a)) for a in cone_degrees)
            light["spot"] = {"innerConeAngle": inner, "outerConeAngle": outer}
        self.use_extension("KHR_lights_punctual")
        lights = self.gltf.extensions.setdefault("KHR_lights_punctual", {"lights": []})["lights"]
        lights.append(light)
        node = self.add_node(name, parent, translation=translation, rotation=rotation)
        self.gltf.nodes[node].extensions["KHR_lights_punctual"] = {"light": len(lights) - 1}
        return node

    def add_animation(self, name: str, channels: Sequence[Channel]) -> None:
        """Add a clip of channels."""
        clip = gl.Animation(name=name)
        for node, path, times, values, interpolation in channels:
            reader = self.add_accessor(times, bounds=True)
            sampler = gl.AnimationSampler(
                input=reader, output=self.add_accessor(values), interpolation=interpolation
            )
            clip.samplers.append(sampler)
            target = gl.AnimationChannelTarget(node=node, path=path)
            clip.channels.append(gl.AnimationChannel(sampler=len(clip.samplers) - 1, target=target))
        self.gltf.animations.append(clip)

    # -- files ---------------------------------------------------------------------------------------------------

    def save(self, folder: Path, binary: bool) -> Path:
        """Write `<name>.glb`, or `<name>.gltf` with `<name>.bin` and its PNG files, and return the main file.

        Each file appears whole or not at all, the main one last; raises OSError where `folder` cannot be written.
        """
        folder.mkdir(parents=True, exist_ok=True)
        with ThreadPoolExecutor() as pool:  # zlib works outside the interpreter's lock
            encoded = list(pool.map(lambda image: (image[0], encode_png(image[1])), self.images))
        self.gltf.buffers, self.gltf.images = [gl.Buffer(byteLength=len(self.blob))], []
        if binary:
            return self._save_binary(folder, encoded)
        for name, data in encoded:
            write_whole(folder / f"{name}.png", data)
            self.gltf.images.append(gl.Image(uri=f"{name}.png", name=name))
        self.gltf.buffers[0].uri = f"{self.name}.bin"
        write_whole(folder / f"{self.name}.bin", bytes(self.blob))
        path = folder / f"{self.name}.gltf"
        write_whole(path, self.gltf.gltf_to_json(separators=(",", ":"), indent=None).encode() + b"\n")
        return path

    def _save_binary(self, folder: Path, encoded: list[tuple[str, bytes]]) -> Path:
        views, blob = list(self.gltf.bufferViews), bytearray(self.blob)
        for name, data in encoded:
            self.gltf.images.append(
                gl.Image(bufferView=len(self.gltf.bufferViews), mimeType="image/png", name=name)
            )
            self.gltf.bufferViews.append(gl.BufferView(buffer=0, byteOffset=len(blob), byteLength=len(data)))
            blob += data + bytes(-len(data) % 4)
        self.gltf.buffers[0].byteLength = len(blob)
        self.gltf.set_binary_blob(bytes(blob))
        path = folder / f"{self.name}.glb"
        write_whole(path, b"".join(self.gltf.save_to_bytes()))
        self.gltf.bufferViews = views
        return path


def encode_png(pixels: NDArray[np.uint8]) -> bytes:
    """Return `pixels` (H, W), (H, W, 3) or (H, W, 4) as PNG."""
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, format="PNG", compress_level=6)
    return stream.getvalue()
