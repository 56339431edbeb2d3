"""What everything outside a chapter sees of a renderer, whatever its chapter and backend.

`Renderer` and `Frame` are what `chapters.open` returns and `render` gives; every pass of a chapter derives from `Pass`;
`Capabilities` says what a device can do, `resolve` which path each feature takes.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np

from backends.arguments import MAX_TIME_S as MAX_TIME_S
from backends.arguments import check_arguments as check_arguments
from backends.arguments import check_moment as check_moment
from backends.arguments import check_names as check_names
from backends.arguments import check_size as check_size
from backends.arguments import check_time as check_time
from backends.features import FEATURES, MAIN_USES, OTHER_USES, REQUIRED_USES
from common.errors import UnsupportedError, UserError
from common.names import suggest

if TYPE_CHECKING:
    from pathlib import Path

    from common.scene import Pose, Scene
    from common.view.camera import View

BACKENDS = ("vulkan", "gl")

# --- features ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Capabilities:
    """What one device can do, as probed; `why_not` explains each missing feature in a few words."""

    backend: str
    device: str
    driver: str
    api_version: tuple[int, int, int]
    kind: Literal["discrete", "integrated", "virtual", "software", "other"]
    features: frozenset[str]
    why_not: Mapping[str, str] = field(default_factory=dict)
    limits: Mapping[str, int] = field(default_factory=dict)
    broken: Mapping[str, str] = field(default_factory=dict)  # "feature/use": what is wrong with it

    @property
    def is_software(self) -> bool:
        """Whether the device is a program on the CPU: goldens are compared on one such driver alone."""
        return self.kind == "software"

    def use(self, feature: str, use: str) -> bool:
        """Whether the device has `feature` and it works for `use`; KeyError if there is no such use.

        "Works" means that no self-test of this driver failed, and that it is not one of the uses known not to work.
        """
        known = (MAIN_USES, REQUIRED_USES, OTHER_USES)
        if not any(use in uses.get(feature, ()) for uses in known):
            raise KeyError(f"{feature}/{use}")
        there = feature in self.features or feature not in FEATURES
        return there and f"{feature}/{use}" not in self.broken


@dataclass(frozen=True)
class Choice:
    """The path that one feature takes, and why."""

    feature: str
    native: bool
    path: str
    reason: str


@dataclass(frozen=True)
class Plan:
    """One choice per feature that a chapter uses."""

    choices: tuple[Choice, ...]

    def native(self, feature: str) -> bool:
        """Whether `feature` takes its native path; a feature that the chapter did not ask for does not."""
        return any(choice.feature == feature and choice.native for choice in self.choices)

    def falling_short(self, setting: str, path: str, reason: str) -> Plan:
        """Return the plan with one more line: what becomes of a preset's wish that the device cannot meet."""
        return Plan((*self.choices, Choice(setting, False, path, reason)))


def check_without(without: Iterable[str]) -> frozenset[str]:
    """Return the features to be switched off, with 'all' expanded; raise UserError for an unknown name."""
    wanted = set(check_names(without, "without"))
    for name in sorted(wanted - {"all"} - FEATURES.keys()):
        near = suggest(name, ["all", *FEATURES])
        raise UserError(
            f"There is no feature '{name}' to do without{near}" + ("" if near.endswith("?") else ".")
        )
    return frozenset(FEATURES) if "all" in wanted else frozenset(wanted)


def resolve(
    required: Iterable[str], optional: Iterable[str], capabilities: Capabilities, without: Iterable[str] = ()
) -> Plan:
    """Choose a path per feature. A feature in `without` takes the same path as on a device that lacks it.

    Raises UnsupportedError, naming the feature, where a required one is missing.
    """
    off = check_without(without)
    choices = []
    for feature in sorted({*required, *optional}):
        native, reason = feature in capabilities.features, "the device has it"
        if not native:
            reason = capabilities.why_not.get(feature, "the device lacks it")
        elif feature in off:
            native, reason = False, "switched off by --without"
        if not native and feature in set(required):
            raise UnsupportedError(f"This chapter needs {FEATURES[feature][0]} ({feature}), but {reason}.")
        choices.append(Choice(feature, native, FEATURES[feature][0 if native else 1], reason))
    return Plan(tuple(choices))


# --- renderer and frame -----------------------------------------------------------------------------------------------


class Frame(Protocol):
    """One rendered frame. Images can be read until the frame's slot is used again, two frames later."""

    index: int  # frames since `reset_history` or `resize`, else since the renderer was opened
    cpu_ms: float  # time that `render` took on the CPU
    reset: str
    """Why nothing of the frames before was used: "first frame", "resize", "camera cut", "time ran backwards" or what
    `reset_history` was given; "" where nothing was reset. `work` counts it as "history_resets"."""

    def image(self, name: str) -> np.ndarray:
        """Wait for the frame and return an output as (H, W) or (H, W, C), row 0 on top.

        Of a renderer opened with `inspect=True`, "pass/resource" is the resource as that pass left it, as it is stored.

        Raises StaleFrameError when the slot was used again or `name` was not in `outputs`.
        """

    @property
    def timings(self) -> dict[str, float]:
        """GPU milliseconds by pass name, in the order of the frame."""

    @property
    def work(self) -> dict[str, int]:
        """Counters of what was done and of what was skipped; "history_resets" is 1 where `reset` is not ""."""


@dataclass(frozen=True)
class Reloaded:
    """What a renderer did for files of shaders that were edited.

    `pipelines` are the names of those built anew, `graph` whether the frame graph is; `at_start` are files whose
    shaders ran when the renderer was opened and run no more, so that the edit is seen when it is opened again.
    """

    pipelines: tuple[str, ...]
    at_start: frozenset[Path] = frozenset()
    graph: bool = False


class Renderer(Protocol):
    """A chapter's renderer: one stream of frames of one view of one scene. A context manager."""

    capabilities: Capabilities
    plan: Plan
    scene: Scene
    settings: Any
    size: tuple[int, int]

    passes: Sequence[Any]
    """The passes of a frame, in order; see `Pass`. A study has none."""

    inspection: Any
    """`inspection.work.by_pass`: the counters of each pass of the last frame, if opened with `inspect=True`."""

    graph: Any
    """The compiled frame graph, `logic.graph_types.Graph`, changed by `logic.graph_stream`; from chapter 4 on."""

    nodes: Sequence[Any]  # beside `passes`, what they read and write, by the graph's names

    techniques: Mapping[str, Technique]  # by name; from chapter 4 on

    @property
    def prepared_ms(self) -> dict[str, float]:
        """Milliseconds of GPU work before the first frame, by what was made; what came from a cache is left out."""

    @property
    def present_source(self) -> Any:
        """The image that holds the last frame's picture, for a window: 8-bit sRGB codes, row 0 on top.

        StaleFrameError unless the renderer was opened with `presents=True` (nothing is copied to the CPU for it) or
        with the output "color". On Vulkan it is a `backends.vulkan.resources.Image`, in state 'copy_source' after each
        frame's submission. Copies from it that are submitted to the same queue end before the next frame draws to it.
        `resize` makes another one.
        """

    def render(self, view: View, time: float = 0.0) -> Frame:
        """Enqueue one frame of `view` at `time` seconds; nothing is waited for.

        UserError for what is no view, and for a time that is not finite or beyond `MAX_TIME_S`.
        """

    def idle(self, view: View, time: float = 0.0) -> bool:
        """Whether a frame now would equal the last one, with every temporal pass done."""

    def resize(self, size: tuple[int, int]) -> None:
        """Change the picture to (width, height) pixels; histories are reset."""

    def reset_history(self, reason: str) -> None:
        """Start again at frame 0: the same calls afterwards give the same pixels. The next frame's `reset` is `reason`.

        Resizing, a view with `cut` and a time before the last one reset by themselves what depends on earlier frames.
        """

    @property
    def shader_files(self) -> frozenset[Path]:
        """All on disk that decides about the texts of this renderer's shaders, files that are not there included.

        None where it cannot exchange its shaders: then another renderer is opened in its place.
        """

    def reload_shaders(self, changed: Collection[Path]) -> Reloaded:
        """Build anew the pipelines that use one of these files, all or none; between frames, which go on as before.

        ShaderError, with nothing changed, where a shader does not compile or expects other data than the host gives.
        """

    def close(self) -> None:
        """Release every object on the GPU."""

    def __enter__(self) -> Renderer: ...

    def __exit__(self, *_: object) -> None: ...


class PassWork:
    """What each pass of a frame had to do, from counters that run over the whole frame."""

    def __init__(self) -> None:
        self.by_pass: dict[str, dict[str, int]] = {}
        self._frame: Mapping[str, int] = {}
        self._before: dict[str, int] = {}

    def add(self, name: str, counters: Mapping[str, int]) -> None:
        """Note what pass `name` added to the frame's `counters`; another frame has another mapping."""
        if counters is not self._frame:
            self._frame, self.by_pass, self._before = counters, {}, {}
        self.by_pass[name] = {key: value - self._before.get(key, 0) for key, value in counters.items()}
        self._before = dict(counters)


# --- passes -----------------------------------------------------------------------------------------------------------

Use = Literal["color", "depth", "sampled", "storage", "copy", "uniform", "indirect"]


@dataclass(frozen=True)
class Access:
    """What a pass reads or writes: the resource's name, the kind of use, and for images format and size.

    `format` is a short name such as 'rgba16f'; None leaves it to the renderer. `scale` is relative to the output, and
    `size` is absolute, in its place. `clear` is the value an attachment starts from. `samples` are those of each pixel
    of an attachment. A buffer has `bytes`, and neither format nor size.

    A name stands for what one pass wrote. One that draws on top of another's result writes a name of its own, `of`
    which other it is the continuation: same memory, another moment. Without `of` and without `clear` nothing of what
    was there is kept. When the writer is left out of a frame, readers get the name in `instead`, or else that in `of`.

    `previous` reads what the frame before wrote. `stages` are those of the shaders that read or write, where it is not
    the fragment shader of a pass that draws (of what is "uniform" also the vertex shader), or the compute shader of one
    that does not.
    """

    resource: str
    use: Use
    format: str | None = None
    scale: float = 1.0
    clear: tuple[float, ...] | None = None
    samples: int = 1
    size: tuple[int, int] | None = None
    bytes: int = 0
    of: str = ""
    instead: str = ""
    previous: bool = False
    stages: tuple[str, ...] = ()


@dataclass(frozen=True)
class Sources:
    """How the shaders of a pass reach the images and buffers that it reads.

    `set` is the number of their descriptor set. OpenGL counts the bindings of each kind on its own: `first` says with
    which number those of a kind ("texture", "image", "storage", "uniform") begin, where that is not 0. `filter` is that
    of the sampler.
    """

    set: int = 0
    filter: Literal["nearest", "linear"] = "nearest"
    first: Mapping[str, int] = field(default_factory=dict)


class Pass:
    """One pass of a chapter, written once for both backends. Every pass derives from this class.

    It names all that a renderer or an executor asks of a pass. `record` holds draws and dispatches only: barriers,
    targets, clears, labels and timestamps stand around it. What chapter 4's frame graph asks for has its default here.
    """

    name: str
    reads: tuple[Access, ...] = ()
    writes: tuple[Access, ...] = ()

    queue: str = "graphics"
    """The queue that the pass asks for: graphics, or compute where it draws nothing."""

    externals: Mapping[str, Any] = {}
    """Resources that the pass brings into the graph, by name (`graph.types.External`)."""

    sources: Sources | None = None
    """How its shaders reach what it reads; None for a pass that binds everything itself."""

    pipelines: Sequence[Any] = ()
    """The pipelines that `create` built. The renderer makes their sets, which hold the scene; `sources` has its own."""

    resting: bool = False
    """Whether this frame gives the pass nothing to do: a batch of such passes is not submitted."""

    @staticmethod
    def needed(scene: Scene, settings: Any) -> bool:
        """Whether the scene and the settings give this pass anything to do."""
        return True

    def create(self) -> None:
        """Build pipelines and whatever else lives as long as the pass; again when a material became another kind."""

    def pre_render(self, commands: Any) -> None:
        """Record what comes directly before the pass, outside of its rendering."""

    def record(self, commands: Any) -> None:
        """Record this frame's draws and dispatches into the `Commands` of the chapter."""
        raise NotImplementedError

    def key(self, slot: int) -> Any:
        """Return what the recording for a slot depends on: when it changes, the recording is made anew."""
        return None


class Technique:
    """What a subject does outside its passes, from the start of a renderer to its end.

    A renderer makes one of each class in its `TECHNIQUES`, in their order, and knows them by this class alone.
    """

    name: str
    """By which `Renderer.techniques` has it: that of the subject's folder."""

    scene: Scene
    """The scene as this subject has it drawn: the one that it was given, or a view of it."""

    passes: Mapping[str, Pass]
    """The subject's passes by name; made by `create`."""

    readers: Mapping[str, Mapping[str, str]]
    """For passes that the graph's file does not name: which passes read another resource in place of theirs."""

    work: dict[str, int]
    """Counters of the last frame."""

    def __init__(self, scene: Scene, settings: Any) -> None:
        self.scene = scene
        self.passes, self.readers, self.work = {}, {}, {}

    def create(self, parts: Any, backend: Any, passes: Mapping[str, Pass]) -> None:
        """Make the subject's passes, from the chapter's `PassParts` and backend; `passes` are those of others."""

    def pose(self, pose: Pose) -> Pose:
        """Return the pose that is drawn, of the pose of the scene that was given."""
        return pose

    def prepare(self, frame: Any) -> int:
        """Do what a frame needs before its passes are recorded (a chapter's `FrameInfo`); return the bytes written."""
        return 0

    def resting(self, time: float) -> bool:
        """Whether a frame at `time` would show the same as the last one."""
        return True

    def reset(self, reason: str) -> None:
        """Forget the frames before: nothing of them counts for the one that is prepared next."""

    def close(self) -> None:
        """Free what the subject holds on the GPU; no frame is in flight."""
