"""The light lists outside of their pass: the buffer follows the size of the picture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from backends.contract import FrameInfo, Pass, Technique

from ..frames.backend.backend import Backend
from ..scene.pass_parts import PassParts
from .model import ListLayout, needed
from .passes import LIT, LightListsPass, ListBuffer, read_lists


class ClusterTechnique(Technique):
    """Owns the buffer of the lists; scenes with few lights have none."""

    name = "clusters"

    def create(self, parts: PassParts, backend: Backend, passes: Mapping[str, Pass]) -> None:
        """Make the pass, and let the passes that light surfaces read its lists."""
        self._parts, self._backend = parts, backend
        self._buffer: ListBuffer | None = None
        self._whole: ListLayout | None = None
        self._pass = LightListsPass(parts)
        self.passes = {self._pass.name: self._pass}
        if needed(parts.scene, parts.settings):
            self._buffer = backend.part(__package__).Buffer(backend)
            read_lists([gpu_pass for name, gpu_pass in passes.items() if name in LIT])

    def prepare(self, frame: FrameInfo) -> int:
        """Lay the lists out for the pixels that are drawn, and make the buffer anew if the picture has another size.

        The buffer has room for lists of all pixels of the picture.
        """
        count = len(self._parts.scene.lights)
        kept = min(count, self._parts.settings.clusters.most_lights)
        self.work = {"lights": kept, "lights_left_out": count - kept} if kept < count else {}
        if self._buffer is None or (self._pass.layout and self._pass.layout.size == frame.size):
            return 0
        whole = ListLayout.of(kept, frame.picture, self._buffer.most_bytes)
        self._pass.layout = replace(whole, size=frame.size)
        if whole == self._whole:
            return 0
        self._whole = whole
        self._buffer.make(whole.words * 4)
        self._backend.make_sets(frame.passes)
        self._backend.frames.forget()
        draws = self._parts.draws
        draws.revision += 1  # groups of draws hold sets of pages and textures, which are other ones now
        binding = self._parts.data.binding(frame.slot)
        draws.binding = draws.binding._replace(frame=binding.frame)
        return 0

    def close(self) -> None:
        """Free the buffer."""
        if getattr(self, "_buffer", None) is not None:
            self._buffer.close()  # type: ignore[union-attr]
