"""The study callables on Vulkan: a pipeline with a callable shader for each material."""

from __future__ import annotations

from ...pipelines.ray_description import HitGroup, RayDescription
from ...pipelines.vulkan_descriptors import Held
from ...rays.model import CULL_DISABLE, FORCE_OPAQUE
from ...rays.vulkan_geometry import MeshGeometry
from ..rays_vulkan import RayStage, require
from . import CALLABLES, CLOSEST, MISS, RAYGEN, STUDY, Settings, defines, faces, triangles


class Renderer(RayStage):
    """Blocks of four materials."""

    study = STUDY
    settings_class: type = Settings

    def describe(self) -> RayDescription:
        """Return the pipeline: its binding table has a record for each material, unless they are inline."""
        require(self.device, self.without, "callables")
        by_call = self.settings.shading == "callable"
        return RayDescription(
            RAYGEN,
            (MISS,),
            (HitGroup(CLOSEST),),
            CALLABLES if by_call else (),
            defines=defines(self.settings),
            linked=self.settings.linked,
            payload_bytes=48,
            name="blocks",
        )

    def hold(self) -> dict[int, Held]:
        """Upload normals and materials, and build the structure over all blocks."""
        require(self.device, self.without, "callables")
        positions, indices = triangles()
        (_, vertices), (_, listed) = self.input(positions, "positions"), self.input(indices, "indices")
        geometry = MeshGeometry(vertices, len(positions), listed, len(indices), "blocks")
        world = self.world([geometry], [CULL_DISABLE | FORCE_OPAQUE])
        return {3: self.filled(faces(self.settings), ["storage"], "normals and materials"), 4: world}
