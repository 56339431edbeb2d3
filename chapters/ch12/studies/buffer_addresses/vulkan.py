"""The study buffer-addresses on Vulkan: meshes in a buffer without order, structures over them, and their table."""

from __future__ import annotations

from ...pipelines.ray_description import HitGroup, RayDescription
from ...pipelines.vulkan_descriptors import Held
from ...rays.model import CULL_DISABLE, FORCE_OPAQUE
from ...rays.vulkan_geometry import MeshGeometry
from ..rays_vulkan import RayStage, require
from . import CLOSEST, MISS, RAYGEN, STUDY, Settings, arena, meshes, table


class Renderer(RayStage):
    """Meshes whose vertices a hit shader finds by address."""

    study = STUDY
    settings_class: type = Settings

    def describe(self) -> RayDescription:
        """Return the pipeline; the buffer of the meshes is bound nowhere."""
        return RayDescription(RAYGEN, (MISS,), (HitGroup(CLOSEST),), name="meshes")

    def hold(self) -> dict[int, Held]:
        """Upload the meshes, and build structures and table from their addresses."""
        require(self.device, self.without, "buffer-addresses")
        listed = meshes(self.settings)
        words, begins = arena(listed)
        _, self.address = self.input(words, "meshes")
        self.entries = table(begins, self.address)
        geometries = [
            MeshGeometry(
                int(entry["positions"]),
                len(mesh.positions),
                int(entry["indices"]),
                len(mesh.indices),
                f"mesh {number}",
            )
            for number, (entry, mesh) in enumerate(zip(self.entries, listed, strict=True))
        ]
        world = self.world(geometries, [CULL_DISABLE | FORCE_OPAQUE] * len(geometries))
        return {3: self.filled(self.entries, ["storage"], "addresses"), 4: world}
