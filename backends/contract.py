"""The interface of a renderer: the same for every chapter and backend, and all that code outside a chapter uses.

`chapters.open` returns a `Renderer`, and its `render` returns a `Frame`. Every pass derives from `Pass`, and every
technique from `Technique`. `Capabilities` lists the features of a device; `resolve` chooses a path for each feature.
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
    """The features of one device, as probed; `why_not` gives the reason for each missing feature in a few words."""

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
        """Whether the device is a software driver; goldens are compared on one such driver only."""
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
        """Return the plan with one more choice: the path of a preset's setting that the device cannot meet."""
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
    """The reason for which histories were reset: "first frame", "resize", "camera cut", "time ran backwards" or the
    argument of `reset_history`; "" if none were. `work` counts it as "history_resets"."""

    def image(self, name: str) -> np.ndarray:
        """Wait for the frame and return an output as (H, W) or (H, W, C), row 0 on top.

        If the renderer was opened with `inspect=True`, "pass/resource" names a resource right after that pass wrote it.

        Raises StaleFrameError when the slot was used again or `name` was not in `outputs`.
        """

    @property
    def timings(self) -> dict[str, float]:
        """GPU milliseconds by pass name, in the order of the frame."""

    @property
    def work(self) -> dict[str, int]:
        """Counters of work that was done and of work that was skipped; "history_resets" is 1 if `reset` is not ""."""


@dataclass(frozen=True)
class Reloaded:
    """The result of reloading shader files that were edited.

    `pipelines` are the names of the rebuilt pipelines; `graph` says whether the frame graph was rebuilt. `at_start`
    are files whose shaders ran only while the renderer was opened: an edit shows after opening it again.
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
    """The passes of a frame in their order; none in a study."""

    inspection: Any
    """`inspection.work.by_pass`: the counters of each pass of the last frame, if opened with `inspect=True`."""

    graph: Any
    """The compiled frame graph (`graph.types.Graph`), from chapter 4 on."""

    nodes: Sequence[Any]  # for each pass what it reads and writes, by the names of the graph

    techniques: Mapping[str, Technique]  # by name; from chapter 4 on

    @property
    def prepared_ms(self) -> dict[str, float]:
        """Milliseconds of GPU work before the first frame, by result; results that came from a cache are left out."""

    @property
    def present_source(self) -> Any:
        """The image that holds the last frame's picture, for a window: 8-bit sRGB codes, row 0 on top.

        Raises StaleFrameError unless the renderer was opened with `presents=True` (which copies nothing to the CPU) or
        with the output "color". On Vulkan it is a `backends.vulkan.resources.Image`, in state 'copy_source' after each
        frame's submission. Copies from it that are submitted to the same queue end before the next frame draws to it.
        `resize` makes another one.
        """

    def render(self, view: View, time: float = 0.0) -> Frame:
        """Enqueue one frame of `view` at `time` seconds; nothing is waited for.

        Raises UserError if `view` is not a View, and for a time that is not finite or beyond `MAX_TIME_S`.
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
        """The files of its shaders, also those that are missing; None if it cannot reload: the caller opens another."""

    def reload_shaders(self, changed: Collection[Path]) -> Reloaded:
        """Rebuild the pipelines that use one of these files, all or none of them; view, time and frame index stay.

        Raises ShaderError, and changes nothing, if a shader does not compile or its interface differs from the host's.
        """

    def close(self) -> None:
        """Release every object on the GPU."""

    def __enter__(self) -> Renderer: ...

    def __exit__(self, *_: object) -> None: ...


class PassWork:
    """The counters of each pass, from counters that run over the whole frame."""

    def __init__(self) -> None:
        self.by_pass: dict[str, dict[str, int]] = {}
        self._frame: Mapping[str, int] = {}
        self._before: dict[str, int] = {}

    def add(self, name: str, counters: Mapping[str, int]) -> None:
        """Store how much pass `name` added to the frame's `counters`; each frame has a mapping of its own."""
        if counters is not self._frame:
            self._frame, self.by_pass, self._before = counters, {}, {}
        self.by_pass[name] = {key: value - self._before.get(key, 0) for key, value in counters.items()}
        self._before = dict(counters)


# --- passes -----------------------------------------------------------------------------------------------------------

Use = Literal["color", "depth", "sampled", "storage", "copy", "uniform", "indirect"]
RateUse = Literal["rate"]
"""The use of a mask of shading rates by the rasteriser of a pass that draws. Only some frame graphs know it."""
RayUse = Literal["structure", "build"]
"""An acceleration structure that is traced or built, and the input of its build. Only some frame graphs know them."""


@dataclass(frozen=True)
class Access:
    """One read or write of a pass: the name of the resource, its use, and for images format and size.

    `format` is a short name such as 'rgba16f'; None leaves it to the renderer. `scale` is relative to the output;
    `size` is absolute and replaces it. An image with a value for each `texel` of pixels covers the output: its size is
    divided by that, and rounded up. With `slices` it is a 3D image of `size` and so many slices. `clear` is the value
    that an attachment is cleared to. `samples` is the number of samples per pixel of an attachment. A buffer has
    `bytes`, and neither format nor size.

    A name stands for the result of one pass. A pass that draws over the result of another pass writes a new name, and
    `of` is the old one: the same memory at a later moment. Without `of` and `clear` the old contents are lost. If the
    frame leaves the writer out, its readers get the resource named by `instead`, or else the one named by `of`.

    `previous` reads the result of the previous frame. `stages` are the shader stages that read or write. By default
    they are the fragment shader of a pass that draws (for "uniform" also the vertex shader), or the compute shader.
    """

    resource: str
    use: Use | RateUse | RayUse
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
    texel: tuple[int, int] = (1, 1)
    slices: int = 0


@dataclass(frozen=True)
class Sources:
    """The bindings of the images and buffers that a pass reads.

    `set` is the number of their descriptor set. OpenGL numbers the bindings of each kind separately: `first` has the
    first number of each kind ("texture", "image", "storage", "uniform") that does not begin at 0. `filter` is that of
    the sampler.
    """

    set: int = 0
    filter: Literal["nearest", "linear"] = "nearest"
    first: Mapping[str, int] = field(default_factory=dict)


class Pass:
    """One pass of a chapter, written once for both backends. Every pass derives from this class.

    Renderers and executors use only the members below. `record` contains draws and dispatches only: barriers, targets,
    clears, labels and timestamps are recorded around it. Members that only a frame graph uses have defaults.
    """

    name: str
    reads: tuple[Access, ...] = ()
    writes: tuple[Access, ...] = ()

    queue: str = "graphics"
    """The queue on which the pass runs: "graphics", or "compute" for a pass that only dispatches."""

    externals: Mapping[str, Any] = {}
    """Resources that the pass brings into the graph, by name (`graph.types.External`)."""

    sources: Sources | None = None
    """The bindings of what the pass reads; None if the pass binds everything itself."""

    pipelines: Sequence[Any] = ()
    """The pipelines that `create` built. The renderer creates their descriptor sets of the scene."""

    beside: Collection[str] | None = None
    """The names of the passes that are switched on; a frame graph sets it before it calls `declare`."""

    resting: bool = False
    """Whether the pass has no work in this frame; a batch of resting passes is not submitted."""

    @staticmethod
    def needed(scene: Scene, settings: Any) -> bool:
        """Whether the scene and the settings need this pass; a pass that is not needed is never created."""
        return True

    def declare(self) -> None:
        """Bring `reads` and `writes` up to date with the scene; called before a frame graph is compiled."""

    def create(self) -> None:
        """Build the pipelines and other objects of the pass; called again when a material changes its variant."""

    def pre_render(self, commands: Any) -> None:
        """Record commands directly before the attachments of the pass begin."""

    def record(self, commands: Any) -> None:
        """Record this frame's draws and dispatches into the `Commands` of the chapter."""
        raise NotImplementedError

    def key(self, slot: int) -> Any:
        """Return a value that the recording for a slot depends on; the frame is recorded again when it changes."""
        return None


@dataclass(frozen=True)
class FrameInfo:
    """The input of `Technique.prepare`. `pose` is the pose of the whole scene, `size` is in pixels."""

    slot: int
    view: View
    time: float
    size: tuple[int, int]
    pose: Pose
    passes: Collection[Pass]
    """The passes of this frame."""

    still: bool = False
    """Whether the frame shows what the last one showed, and all subjects rest that do not settle last. False without
    a subject that settles last."""

    settling: bool = False
    """Whether a subject that settles last does not rest: the frame may be drawn for it alone."""

    valid_histories: int = 0
    """The histories that the frame may use, as bits (`common.layouts.CONSTANTS`); 0 in chapters that do not use it."""

    picture: tuple[int, int] = (0, 0)
    """The size of the finished picture, which may have more pixels than are drawn (`size`), from chapter 11 on."""


class Technique:
    """The work of a subject outside its passes, from the opening of a renderer to its closing.

    A renderer creates one object of each class in its `TECHNIQUES`, in that order, and uses only the members below.
    """

    name: str
    """The key in `Renderer.techniques`: the name of the subject's folder."""

    scene: Scene
    """The scene that is drawn: the scene of the constructor, or a view of it."""

    passes: Mapping[str, Pass]
    """The passes of the subject by name, from `create` on."""

    readers: Mapping[str, Mapping[str, str]]
    """For each pass that reads a resource of the subject: that resource, by the one that it replaces."""

    work: dict[str, int]
    """Counters of the last frame."""

    settles_last = False
    """Whether the subject begins to rest when all others do: it reads `FrameInfo.still`."""

    def __init__(self, scene: Scene, settings: Any) -> None:
        self.scene = scene
        self.passes, self.readers, self.work = {}, {}, {}

    def create(self, parts: Any, backend: Any, passes: Mapping[str, Pass]) -> None:
        """Create the passes of the subject from the chapter's `PassParts` and `Backend`; `passes` are the others."""

    def pose(self, pose: Pose) -> Pose:
        """Return the pose that is drawn, from the pose of the scene."""
        return pose

    def constants(self, frame: FrameInfo) -> dict[str, Any]:
        """Return arguments of `common.layouts.fill_frame_constants`; called once a frame, from chapter 11 on."""
        return {}

    def prepare(self, frame: FrameInfo) -> int:
        """Prepare a frame before its passes are recorded; return the number of bytes written."""
        return 0

    @property
    def tells(self) -> bool:
        """Whether the GPU writes counters of its own; reading the work of a frame then waits for the frame."""
        return False

    def told(self, slot: int) -> dict[str, int]:
        """Return the counters that the GPU wrote in the last frame of a slot, which is over."""
        return {}

    def resting(self, time: float) -> bool:
        """Whether a frame at `time` would show the same as the last one."""
        return True

    def reset(self, reason: str) -> None:
        """Drop all history: the next frame starts without earlier frames."""

    def close(self) -> None:
        """Free the GPU objects of the subject; no frame is in flight."""
