"""The OpenGL context: without a window through EGL or in a GLFW window, its features, and the count of what lives."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, Literal

from backends.contract import check_without
from backends.gl import api as gl
from backends.gl.driver import capabilities as gc
from backends.gl.driver.debug import DebugSink
from backends.selftest import verdicts
from common.errors import DeviceError, UnsupportedError
from common.names import visible

NO_CONTEXT = "No OpenGL 4.5 was found ({}): ./strata doctor says what to install."

Kind = Literal["buffer", "texture", "sampler", "framebuffer", "vertex array", "query", "program"]

_CALLS: dict[str, tuple[str, str, int]] = {
    # kind: (creation, deletion, what labels call it)
    "buffer": ("glCreateBuffers", "glDeleteBuffers", gl.GL_BUFFER),
    "texture": ("glCreateTextures", "glDeleteTextures", gl.GL_TEXTURE),
    "sampler": ("glCreateSamplers", "glDeleteSamplers", gl.GL_SAMPLER),
    "framebuffer": ("glCreateFramebuffers", "glDeleteFramebuffers", gl.GL_FRAMEBUFFER),
    "vertex array": ("glCreateVertexArrays", "glDeleteVertexArrays", gl.GL_VERTEX_ARRAY),
    # glCreateQueries refuses the targets of pipeline statistics on Mesa; names from glGenQueries become queries of
    # the target they are first used for.
    "query": ("glGenQueries", "glDeleteQueries", gl.GL_QUERY),
    "program": ("", "", gl.GL_PROGRAM),
}

PUSH_BINDING = 14
"""The uniform binding of what Vulkan calls push constants; see PUSH in `backends.shader_text`."""

PUSH_SIZE = 256
"""Bytes of push constants at most, as a Vulkan device has at least 128."""

_current: Context | None = None
"""The context that this process made current last."""


def let_go() -> None:
    """Leave this thread without a context, for a window that is about to make one.

    Where EGL still holds the thread, GLX ends the whole process ("BadAccess"). `make_current` takes a context up again.
    """
    global _current
    if _current is None:
        return
    loader, _current = _current._loader, None
    if isinstance(loader, _WindowLoader):
        loader.let_go()
        return
    address = loader.load_opengl_function("eglReleaseThread")
    if address:
        gl.ffi.cast("unsigned int (*)(void)", address)()


class _WindowLoader:
    """What moderngl needs of a context that GLFW made; its methods have the names that moderngl asks for."""

    def __init__(self, window: Any) -> None:
        self._window = window

    def load_opengl_function(self, name: str) -> int:
        """Return the address of a call, 0 if there is none."""
        import ctypes

        import glfw

        return ctypes.cast(glfw.get_proc_address(name), ctypes.c_void_p).value or 0

    def __enter__(self) -> _WindowLoader:
        import glfw

        glfw.make_context_current(self._window)
        return self

    def let_go(self) -> None:
        """Leave the thread without this context."""
        import glfw

        nothing: Any = None
        glfw.make_context_current(nothing)

    def __exit__(self, *_: object) -> None:
        """It stays current."""

    def release(self) -> None:
        """The window frees its context when it is closed."""


def _headless_loader() -> Any:
    """Return a context without a window, current; raise UnsupportedError with the reason if there is none."""
    try:
        import glcontext

        system: str = sys.platform
        if system == "linux":
            return glcontext.get_backend_by_name("egl")(mode="standalone", glversion=450)
        return glcontext.default_backend()(mode="standalone", glversion=450)
    except ImportError as error:
        raise UnsupportedError(f"OpenGL needs the package moderngl: {error}.") from None
    except Exception as error:  # glcontext raises plain Exceptions with the reason
        raise UnsupportedError(NO_CONTEXT.format(str(error).rstrip("."))) from None


class Context:
    """An OpenGL 4.5 core context with Vulkan's conventions, current from its creation on.

    `window` is a GLFW window made by `present.open_window`; None makes a context of its own without a
    window, on EGL's first device or the one that GLCONTEXT_DEVICE_INDEX numbers. With `validate` every raw call is
    checked and raises DeviceError. `without` names features to do without. With `believe` the driver's word counts,
    whatever self-tests said about it. Raises UnsupportedError with one sentence.

    Everything is made by `create` and freed by `destroy`, so that `close` can name what was forgotten.
    """

    def __init__(
        self,
        validate: bool = False,
        without: Iterable[str] = (),
        window: Any = None,
        *,
        loader: Any = None,
        believe: bool = False,
    ) -> None:
        self.without = check_without(without)
        self.validates = validate
        self._closed = True
        let_go()
        self._loader = loader or (_headless_loader() if window is None else _WindowLoader(window))
        self.make_current()
        resolve: Callable[[str], int] = self._loader.load_opengl_function
        self.fn = gl.Functions(resolve, validate)
        self.alive: dict[tuple[str, int], str] = {}
        self.sink = DebugSink()
        self._closers: list[Callable[[], None]] = []
        try:
            self._check_version()
            self.capabilities = gc.probe(self.fn)
            reason = gc.unfit(self.capabilities, gc.extensions(self.fn))
            if not believe:
                wrong = gc.wrong(self.capabilities)
                self.capabilities = verdicts.apply(self.capabilities, wrong)
                reason = reason or verdicts.unfit(wrong)
            if reason:
                raise UnsupportedError(NO_CONTEXT.format(f"{self.capabilities.device}: {reason}"))
            self.mgl = _moderngl(self._loader)
        except BaseException:
            let_go()
            self._loader.release()
            raise
        self.limits = self.capabilities.limits
        self.features = self.capabilities.features - self.without
        self._closed = False
        self.sink.listen(self.fn)
        self._set_conventions()
        self._push: int | None = None

    def _check_version(self) -> None:
        """Refuse old contexts before anything is called that they lack: on EGL the request itself does."""
        words = gl.text(self.fn.glGetString(gl.GL_VERSION)).split()
        number = words[0] if words else ""
        parts = number.split(".")
        known = len(parts) >= 2 and parts[0].isdigit() and parts[1].isdigit()
        if not known or (int(parts[0]), int(parts[1])) < (4, 5):
            raise UnsupportedError(NO_CONTEXT.format(f"it offers OpenGL {number}" if known else "no version"))

    def _set_conventions(self) -> None:
        """Make the rasteriser agree with Vulkan's, so that depth and coverage have equal bits."""
        fn = self.fn
        # y = -1 is row 0 of memory in both APIs; depth from 0 to 1 keeps the precision that reversed z needs.
        fn.glClipControl(gl.GL_LOWER_LEFT, gl.GL_ZERO_TO_ONE)
        fn.glProvokingVertex(gl.GL_FIRST_VERTEX_CONVENTION)
        fn.glFrontFace(FRONT_FACES["counter_clockwise"])
        fn.glEnable(gl.GL_TEXTURE_CUBE_MAP_SEAMLESS)
        fn.glEnable(gl.GL_FRAMEBUFFER_SRGB)  # for attachments of an sRGB format only, as in Vulkan
        fn.glDisable(gl.GL_DITHER)
        # Rows of any width are packed without gaps.
        fn.glPixelStorei(gl.GL_UNPACK_ALIGNMENT, 1)
        fn.glPixelStorei(gl.GL_PACK_ALIGNMENT, 1)

    def make_current(self) -> None:
        """Let this thread's calls reach this context: after another one was current."""
        global _current
        if _current is not self:
            let_go()
            self._loader.__enter__()
            _current = self

    def has(self, feature: str) -> bool:
        """Whether the native path of `feature` is enabled."""
        return feature in self.features

    # --- objects ---

    def create(self, kind: Kind, name: str = "", target: int | None = None) -> int:
        """Make an object, give it its name for messages and captures, and note that it lives.

        `target` is a texture's. The object exists at once, without being bound ("direct state access").
        """
        out = gl.ffi.new("GLuint[1]")
        call = getattr(self.fn, _CALLS[kind][0])
        if kind == "texture":
            call(target, 1, out)
        else:
            call(1, out)
        handle = int(out[0])
        self.adopt(kind, handle, name)
        return handle

    def adopt(self, kind: Kind, handle: int, name: str = "") -> None:
        """Note that an object lives that was made by another call than `create`."""
        self.alive[kind, handle] = name
        if name and kind != "query":  # a query has no type, and so takes no label, before its first use
            self.name(kind, handle, name)

    def name(self, kind: Kind, handle: int, name: str) -> None:
        """Give an object the name under which messages, captures and traces show it."""
        raw = visible(name).encode()[:255]
        self.fn.glObjectLabel(_CALLS[kind][2], handle, len(raw), raw)

    def destroy(self, kind: Kind, handle: int) -> None:
        """Free an object that `create` or `adopt` noted; a second time is an error."""
        if self.alive.pop((kind, handle), None) is None:
            raise DeviceError(f"A {kind} was destroyed twice, or was never made in this context.")
        if kind != "program":  # those belong to moderngl
            getattr(self.fn, _CALLS[kind][1])(1, gl.names(handle))

    def at_close(self, close: Callable[[], None]) -> None:
        """Call `close()` when the context closes, last given first: for objects that live as long as the context."""
        self._closers.append(close)

    # --- small things every pass needs ---

    @contextmanager
    def label(self, name: str) -> Iterator[None]:
        """Open a label for the calls within: messages, captures and traces show it as the pass."""
        self.begin_label(name)
        try:
            yield
        finally:
            self.end_label()

    def begin_label(self, name: str) -> None:
        """Open a label."""
        raw = visible(name).encode()[:255]
        self.sink.labels.append(name)
        self.fn.glPushDebugGroup(gl.GL_DEBUG_SOURCE_APPLICATION, 0, len(raw), raw)

    def end_label(self) -> None:
        """Close the label that was opened last."""
        self.fn.glPopDebugGroup()
        self.sink.labels.pop()

    def push(self, data: Any) -> None:
        """Set the push constants of the next draw or dispatch from an array of at most 256 bytes.

        For a few of them a frame; many draws bind ranges of one buffer (`resources.PushTable`).
        """
        size = data.nbytes
        if size > PUSH_SIZE:
            raise ValueError(f"{size} bytes of push constants are more than {PUSH_SIZE}.")
        if self._push is None:
            self._push = self.create("buffer", "push constants")
            self.fn.glNamedBufferStorage(self._push, PUSH_SIZE, gl.NULL, gl.GL_DYNAMIC_STORAGE_BIT)
            handle = self._push
            self.at_close(lambda: self.destroy("buffer", handle))
        self.fn.glNamedBufferSubData(self._push, 0, size, gl.pointer(data))
        self.fn.glBindBufferBase(gl.GL_UNIFORM_BUFFER, PUSH_BINDING, self._push)

    # --- lifetime ---

    def wait_idle(self) -> None:
        """Wait until the GPU has nothing left to do."""
        self.fn.glFinish()

    def close(self) -> None:
        """Free the context; raise DeviceError naming whatever is still alive in it."""
        if self._closed:
            return
        self.make_current()
        for closer in reversed(self._closers):
            closer()
        self._closers.clear()
        self._closed = True
        left = [f"{kind} '{name}'" if name else kind for (kind, _), name in self.alive.items()]
        self.fn.glDebugMessageCallback(gl.NULL, gl.NULL)  # the sink may be gone before the driver is
        let_go()
        self.mgl.release()
        # Ctrl-C may come between any two lines, and so may a lack of memory: what they left behind is no fault of the
        # code, and went with the context.
        ending = sys.exception()
        is_fault = not isinstance(ending, KeyboardInterrupt) and not getattr(ending, "is_full", False)
        if left and is_fault:
            shown = ", ".join(left[:8]) + (", ..." if len(left) > 8 else "")
            raise DeviceError(f"{len(left)} objects outlived their context: {shown}.")

    def __enter__(self) -> Context:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


FRONT_FACES = {"counter_clockwise": gl.GL_CW, "clockwise": gl.GL_CCW}
"""Vulkan's names of front faces. OpenGL has the y axis pointing up, and so sees the mirror image of every winding."""


def _moderngl(loader: Any) -> Any:
    """Return moderngl's view of the current context. "standalone": it must not look for a default framebuffer."""
    try:
        import moderngl
    except ImportError as error:
        raise UnsupportedError(f"OpenGL needs the package moderngl: {error}.") from None
    return moderngl.create_context(require=450, standalone=True, context=loader)
