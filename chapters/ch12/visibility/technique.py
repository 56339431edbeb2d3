"""The visibility buffer outside of its passes: what the resolve binds, and whether the graph has it."""

from __future__ import annotations

from collections.abc import Mapping

from backends.contract import Pass, Technique
from common.errors import UserError

from ..frames.backend.backend import Backend
from ..graph.file import graph_path, read_graph
from ..graph.plan import graph_name
from ..scene.pass_parts import PassParts
from .model import RESOLVE, VISIBILITY, in_use, without_effect
from .resolve import ResolveSurfacesPass


class VisibilityTechnique(Technique):
    """Hands the bindings of the backend to the pass that resolves materials."""

    name = "visibility"

    def create(self, parts: PassParts, backend: Backend, passes: Mapping[str, Pass]) -> None:
        """Set the bindings, or say why there is none.

        Raises UserError for a graph that has a G-buffer, and no pass that would fill it.
        """
        sentence = without_effect(parts.settings)
        if sentence and sentence not in parts.scene.warnings:
            parts.scene.warnings.append(sentence)
        if not in_use(parts.settings):
            return
        resolve, file = passes[RESOLVE], read_graph(graph_path(graph_name(parts.settings)))
        names = {*file.passes.values()}
        if "gbuffer" in names and not {VISIBILITY, RESOLVE} <= names:
            raise UserError(
                f"{file.path.name} has no passes '{VISIBILITY}' and '{RESOLVE}' behind 'gbuffer': add them, or set "
                "surfaces=gbuffer."
            )
        assert isinstance(resolve, ResolveSurfacesPass), RESOLVE
        if backend.device.capabilities.is_software:
            resolve.samples_along = int(parts.data.anisotropy)
        resolve.bind = backend.part(__package__).Bindings(backend).bind
