"""The passes of rays.

    ray_structures   instances and what deforms -> ray_world, or the buffers of our BVH
    rays             these, color_hdr, fog -> color_traced, over a part of the rasterised picture

The picture is one text, whatever finds the hits: a raygen shader, a kernel with ray queries, or a kernel over our BVH.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from backends.contract import Access, Pass, Sources
from common.errors import UserError
from common.scene import Pose, Scene

from ..cloth.passes import VERTICES
from ..fog.passes import PIXELS, FogPass
from ..frames.commands import Commands, SceneBinding
from ..graph.execute.bindings import OWNED
from ..graph.types import External, Touch
from ..pipelines.compute_description import ComputeDescription
from ..pipelines.description import Built, Described
from ..scene.pages import PAGE_BYTES
from ..scene.pass_parts import PassParts
from ..scene.textures.arrays import ARRAYS
from ..settings import Settings
from . import picture
from .groups import ray_description
from .tiles import tiles

TRACED = "color_traced"

WORLD = "ray_world"
"""The acceleration structures of the driver in the graph."""

BUFFERS = ("ray_nodes", "ray_triangles", "ray_instances")
"""The buffers of our BVH in the graph, in the order of their bindings."""

SOURCES = Sources(set=3, first={"texture": 16, "storage": 5, "uniform": 3})
"""The bindings of structures and target: behind those of the scene, a page and textures."""


class Structures(Protocol):
    """What rays traverse, by one way."""

    work: Mapping[str, int]

    @property
    def sizes(self) -> Mapping[str, int]:
        """Bytes of the buffers of the frame graph, by name; none if the graph does not see them."""

    def prepare(self, slot: int, pose: Pose, deformed: bool = False) -> int:
        """Find out what a frame builds; return the bytes written. `deformed` says that a pass moves vertices."""

    def key(self) -> Any:
        """Return what the recording of `record` depends on."""

    def record(self, commands: Any, slot: int) -> None:
        """Record what the frame builds."""

    def trace_by(self, pipelines: Sequence[Built]) -> None:
        """Let several pipelines of one pass trace, which have one layout; for a single one `bind_pass` is enough."""

    def bind_pass(
        self, commands: Any, pipeline: Built, scene: SceneBinding, page: Any, textures: Any
    ) -> None:
        """Bind a pass that traces: a scene's binding, a page, a set of textures or None, and the structures."""

    def close(self) -> None:
        """Free everything; no frame is in flight."""


def structure_accesses(way: str, sizes: Mapping[str, int], writes: bool) -> tuple[Access, ...]:
    """Return the accesses to the structures of a way, whose buffers have these sizes."""
    if way == picture.BVH:
        return tuple(Access(name, "storage", bytes=size) for name, size in sizes.items())
    stages = ("build",) if writes else ("rgen",) if way == picture.PIPELINE else ("compute",)
    return (Access(WORLD, "structure", bytes=OWNED, stages=stages),)


class StructuresPass(Pass):
    """Lets the structures follow instances that move and meshes that deform."""

    name = "ray_structures"
    structures: Structures
    """What rays traverse, set by the technique."""

    def __init__(self, parts: PassParts) -> None:
        self._draws = parts.draws
        self.follow(picture.BVH, dict.fromkeys(BUFFERS, OWNED))

    def follow(self, way: str, sizes: Mapping[str, int], cloth: bool = False) -> None:
        """Declare the structures of a way, and that they follow the vertices of cloth if there is some."""
        if cloth:
            self.reads = (Access(VERTICES, "storage" if way == picture.BVH else "build"),)
        self.writes = structure_accesses(way, sizes, True)
        stage, access = ("compute", "storage_read") if way == picture.BVH else ("rays", "structure_read")
        stage = "compute" if way == picture.QUERY else stage
        read = Touch("", frozenset({stage}), frozenset({access}))  # the last use in the frame before
        self.externals = {it.resource: External(None, None, read, bytes=it.bytes) for it in self.writes}

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether a part of the picture is traced."""
        return picture.in_use(scene, settings)

    def record(self, commands: Commands) -> None:
        """Record the builds of the frame."""
        self.structures.record(commands, self._draws.slot)

    def key(self, slot: int) -> Any:
        """Return what the builds depend on."""
        return self.structures.key()


class RayPicturePass(Pass):
    """Traces the picture, an invocation for each pixel, a dispatch for each tile."""

    name = "rays"
    sources = SOURCES
    shader = "rays/picture"
    """The file of the shader, without its ending."""
    structures: Structures
    """What rays traverse, set by the technique."""
    tiles = 1
    """In how many dispatches the picture is traced, set by the technique."""

    def __init__(self, parts: PassParts) -> None:
        self._scene, self._settings, self._data = parts.scene, parts.settings, parts.data
        self._draws, self._pipelines = parts.draws, parts.pipelines
        self.follow(picture.BVH, dict.fromkeys(BUFFERS, OWNED))

    def follow(self, way: str, sizes: Mapping[str, int], cloth: bool = False) -> None:
        """Declare that the structures of a way are read, and the vertices of cloth if there is some."""
        self._way = way
        stages = ("rgen",) if way == picture.PIPELINE else ()
        vertices = (Access(VERTICES, "storage", stages=stages),) * cloth
        fog = (Access(PIXELS, "storage", stages=stages),) * FogPass.needed(self._scene, self._settings)
        self.reads = (*structure_accesses(way, sizes, False), *vertices, *fog)
        format = self._settings.shading.color_format
        self.writes = (Access(TRACED, "storage", format=format, of="color_hdr", stages=stages),)

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether a part of the picture is traced, and not by paths."""
        return picture.in_use(scene, settings) and not settings.paths.path_tracer

    def defines(self) -> picture.Defines:
        """Return the defines of the shader, besides those of materials and of the way."""
        defines = picture.picture_defines(self._scene, self._settings, self._draws.used)
        return (*defines, ("TARGET_BINDING", self._behind_structures()))

    def _behind_structures(self) -> int:
        """Return the first binding behind those of the structures."""
        return len(BUFFERS) if self._way == picture.BVH else 0

    def describe(self) -> Described:
        """Return the pipeline, for all materials of the scene."""
        whole = picture.variant_of_all([self._data.variants[material] for material in self._draws.used])
        self._textured = bool(whole.roles)
        defines = (
            *whole.defines,
            *self._data.texture_defines(whole, lambda _: whole),
            *self.defines(),
            *picture.DEFINES[self._way],
        )
        if self._way == picture.PIPELINE:
            return ray_description(f"{self.shader}.rgen", defines, name=self.name)
        return ComputeDescription(f"{self.shader}.comp", defines, name=self.name)

    def create(self) -> None:
        """Build the pipeline; again when a material became another kind."""
        described = self.describe()
        self._bound()  # refuses a scene before its shader is compiled, which takes seconds
        self.pipelines = self._pipelines.get([described])

    def _bound(self) -> tuple[int, int]:
        """Return the page of geometry and the set of textures of all surfaces.

        Raises UserError if the scene has several: a ray may hit any surface. A page has room for about two million
        triangles of usual meshes; 13 arrays are enough where images have few sizes.
        """
        used = np.unique(self._scene.instances.mesh)
        pages = np.unique(self._data.page_of[used]).tolist()
        sets = np.unique(self._data.textures_of[self._draws.used]).tolist() if self._textured else [0]
        if len(pages) > 1:
            size = sum(page.size for page in self._data.pages)
            raise UserError(
                f"The geometry of this scene takes {_mib(size)} MiB in {len(pages)} pages of {_mib(PAGE_BYTES)} MiB at "
                "most, and rays, which may hit any surface, read one: set rays=off, or draw fewer and coarser meshes."
            )
        if len(sets) > 1:
            raise UserError(
                f"The textures of this scene need {len(sets)} sets of {ARRAYS} arrays at most, each of one size, "
                "format and sampler, and rays, which may hit any surface, read one set: set rays=off, give images "
                "fewer sizes and samplers, or take Vulkan with bindless textures."
            )
        return (pages or [0])[0], (sets or [0])[0]

    def record(self, commands: Commands) -> None:
        """Record the rays through the traced part of the picture."""
        (pipeline,) = self.pipelines
        page, textures = self._bound()
        images = self._data.texture_set(textures) if self._textured else None
        bound = self._data.bound_page(self._draws.slot, page)
        self.structures.bind_pass(commands, pipeline, self._draws.binding, bound, images)
        width, height = commands.extent
        left = picture.first_column(self._settings, width)
        # A software driver that draws late writes the time of the beginning when it comes to a barrier or an end.
        commands.compute_barrier()
        for x, y, columns, rows in tiles((width - left, height), self.tiles):
            commands.push(pipeline, np.array((left + x, y, 0, 0), np.uint32))
            commands.trace(pipeline, (columns, rows))

    def key(self, slot: int) -> Any:
        """Return what the recording depends on: pages and textures, and the number of tiles."""
        return self._draws.revision, self.tiles


def _mib(size: int) -> int:
    """Return MiB, rounded up."""
    return -(-size // 2**20)
