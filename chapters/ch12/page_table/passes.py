"""The passes that find what a picture needs of shadow maps, behind all passes that write depth.

shadow_need -> shadow_need_boxes -> shadow_need_tell -> the CPU, two frames later
"""

from __future__ import annotations

from typing import Any

from backends.contract import Access, Pass
from common.scene import Scene

from ..fog.model import in_use as froxels_report
from ..frames.dispatches import group_count
from ..graph.types import External, Touch
from ..pipelines.compute_description import ComputeDescription
from ..scene.data import BEHIND_SCENE
from ..scene.pass_parts import PassParts
from ..settings import Settings
from ..shading import views
from ..shading.deferred import has_transparent
from ..shadows import model
from .lamps import MOST
from .memory import NEEDS, NEEDS_OF_FOG, TOLD, ReportMemory

_STORED = Touch("", frozenset({"compute"}), frozenset({"storage_read", "storage_write"}), writes=True)
_HOST_IDLE = Touch("", frozenset(), frozenset())
_HOST_READS = Touch("", frozenset({"host"}), frozenset({"host_read"}))


class NeedPass(Pass):
    """Reports what solid surfaces need."""

    name, shader = "shadow_need", "page_table/need.comp"
    number = 0
    """The place of its work groups in the buffer of a slot (`shadow_asks`)."""
    sources = BEHIND_SCENE

    def __init__(self, parts: PassParts) -> None:
        self._settings, self._pipelines, self._draws = parts.settings, parts.pipelines, parts.draws
        self._scene = parts.scene
        self.memory: ReportMemory | None = None
        """The buffers, from the technique."""
        self._places = parts.data.shadow_places
        self._bytes = 4 * self._places.report_words
        self._begin()

    def _begin(self) -> None:
        """Declare what the pass reads and writes."""
        samples = self._settings.shading.msaa
        self._samples = (("SAMPLES", samples),) if samples > 1 else ()
        self.reads = (Access(views.depth_target(self._settings), "sampled", samples=samples),)
        before = NEEDS_OF_FOG if froxels_report(self._scene, self._settings) else ""
        self.writes = (Access(NEEDS[0], "storage", bytes=self._bytes, of=before),)
        self.externals = {before or NEEDS[0]: External(None, None, _STORED, bytes=self._bytes)}

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether memory follows what pictures need."""
        return model.by_need(settings) and model.needed(scene, settings)

    def create(self) -> None:
        """Build the pipeline."""
        defines = (("MOST_TEXELS", MOST), *self._samples)
        self.pipelines = self._pipelines.get([ComputeDescription(self.shader, defines, name=self.name)])

    def extent(self, size: tuple[int, int]) -> tuple[int, ...]:
        """Return the invocations for a picture of (width, height) pixels."""
        return size

    def groups(self, size: tuple[int, int]) -> tuple[int, int, int]:
        """Return the work groups for a picture of (width, height) pixels."""
        (pipeline,) = self.pipelines
        return group_count(self.extent(size), pipeline.group)

    def record(self, commands: Any) -> None:
        """Record the kernel. The slot says how many work groups run: none in frames that do not report."""
        assert self.memory is not None, "the technique has made it"
        (pipeline,) = self.pipelines
        commands.bind_compute(pipeline, self._draws.binding)
        commands.dispatch_indirect(*self.memory.asked(commands.slot.index, self.number))


class BoxesPass(NeedPass):
    """Reports what blended objects need."""

    name, shader = "shadow_need_boxes", "page_table/boxes.comp"
    number = 1

    def _begin(self) -> None:
        self._samples = ()
        self.writes = (Access(NEEDS[1], "storage", bytes=self._bytes, of=NEEDS[0]),)

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether any object is blended."""
        return NeedPass.needed(scene, settings) and has_transparent(scene)

    def extent(self, size: tuple[int, int]) -> tuple[int, ...]:
        """Return an invocation for each object and light."""
        return len(self._scene.instances), model.records_of(self._scene, self._settings)


class TellPass(NeedPass):
    """Hands the report over to the CPU."""

    name, shader = "shadow_need_tell", "page_table/tell.comp"
    number = 2

    def _begin(self) -> None:
        self._samples = ()
        boxes = has_transparent(self._scene)
        self.writes = (
            Access(NEEDS[2], "storage", bytes=self._bytes, of=NEEDS[1] if boxes else NEEDS[0]),
            Access(TOLD, "storage", bytes=self._bytes),
        )
        self.externals = {TOLD: External(None, None, _HOST_IDLE, _HOST_READS, bytes=self._bytes)}

    def declare(self) -> None:
        """Follow blended objects, which an edit may have made."""
        self._begin()

    def extent(self, size: tuple[int, int]) -> tuple[int, ...]:
        """Return an invocation for each word."""
        return (self._bytes // 4,)

    def record(self, commands: Any) -> None:
        """Record the copy."""
        super().record(commands)
        assert self.memory is not None, "the technique has made it"
        self.memory.finish()


NEED_PASSES = (NeedPass, BoxesPass, TellPass)
