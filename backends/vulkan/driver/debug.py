"""What the driver and the validation layers say, tied to the pass, the objects and the Python line that caused it.

The messenger's callback runs inside the Vulkan call that is wrong, on the thread that made it. So Python's stack at
that moment still shows the line of the caller, and no bookkeeping is needed to find it.
"""

from __future__ import annotations

import re
import sys
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from itertools import groupby
from typing import Any, Literal

from backends.callers import calling_line
from backends.vulkan import api as vk

Severity = Literal["info", "warning", "error"]


@dataclass(frozen=True)
class Message:
    """One message of the validation layers or the driver."""

    severity: Severity
    id: str  # the rule's name, such as VUID-vkCmdDraw-None-08600
    text: str
    objects: tuple[str, ...]  # names given with `Device.name`, else type and handle
    labels: tuple[str, ...]  # command-buffer and queue labels that were open: the pass
    line: str  # "file:line" of the caller; see `calling_line`

    def __str__(self) -> str:
        """The place first: it is the reader's own line, and the text of a rule may fill half a screen."""
        where = f" in pass {' > '.join(self.labels)}" if self.labels else ""
        objects = f" [{', '.join(self.objects)}]" if self.objects else ""
        return f"called from {self.line}{where}: {self.severity}: {self.text}{objects}"


ALLOWED: tuple[tuple[str, str], ...] = (
    # A layer that is older than the driver does not know the driver's newer extensions. That says nothing about the
    # program: Strata enables only what the header of 1.3.275 has.
    ("WARNING-DEBUG-PRINTF", "is not supported by this layer"),
    ("", "is not supported by this layer"),
    # Mesa before 23 warns of what SPIR-V allows on a member of gl_PerVertex ("Decorations"), and obeys it all the same.
    ("", "Decoration not allowed on struct members: SpvDecorationInvariant"),
    # Software drivers are conformant by their own statement only; the loader says so once for each.
    ("", "is not a conformant Vulkan implementation"),
)
"""(id prefix, part of the text) of messages that are not counted, with the reason beside each."""


_COUNTERS = re.compile(r"\b(seq_no|reset_no):? \d+")
"""Numbers of submissions in a text, which would make the same message another one in every frame."""


class ValidationSink:
    """Receives every message once, keeps each distinct one with its count, and hands it to the callbacks.

    `messages` maps message -> count, warnings and errors alone; tests assert that it is empty.
    """

    def __init__(self) -> None:
        self.messages: dict[Message, int] = {}
        self.callbacks: list[Callable[[Message], None]] = []
        self.failure: BaseException | None = None
        self._pointer = vk.ffi.callback(
            "PFN_vkDebugUtilsMessengerCallbackEXT", self._receive, onerror=self._failed
        )

    def create_info(self) -> Any:
        """Return the messenger's create-info; chain it to the instance's too, so that its creation is covered."""
        return vk.keep(
            vk.new(
                "VkDebugUtilsMessengerCreateInfoEXT",
                messageSeverity=vk.VK_DEBUG_UTILS_MESSAGE_SEVERITY_WARNING_BIT_EXT
                | vk.VK_DEBUG_UTILS_MESSAGE_SEVERITY_ERROR_BIT_EXT,
                messageType=vk.VK_DEBUG_UTILS_MESSAGE_TYPE_GENERAL_BIT_EXT
                | vk.VK_DEBUG_UTILS_MESSAGE_TYPE_VALIDATION_BIT_EXT
                | vk.VK_DEBUG_UTILS_MESSAGE_TYPE_PERFORMANCE_BIT_EXT,
                pfnUserCallback=self._pointer,
            ),
            self,
        )

    def _receive(self, severity: int, kinds: int, data: Any, user: Any) -> int:
        kind: Severity = (
            "error" if severity >= vk.VK_DEBUG_UTILS_MESSAGE_SEVERITY_ERROR_BIT_EXT else "warning"
        )
        labels = _label_names(data.pQueueLabels, data.queueLabelCount)
        labels += _label_names(data.pCmdBufLabels, data.cmdBufLabelCount)
        message = Message(
            kind,
            vk.text(data.pMessageIdName),
            _COUNTERS.sub(r"\1 n", vk.text(data.pMessage)),
            tuple(_object_name(data.pObjects[i]) for i in range(data.objectCount)),
            tuple(labels),
            calling_line(sys._getframe(1)),
        )
        if any(message.id.startswith(prefix) and part in message.text for prefix, part in ALLOWED):
            return 0
        self.messages[message] = self.messages.get(message, 0) + 1
        for callback in self.callbacks:
            callback(message)
        return 0

    def _failed(self, kind: type[BaseException], error: BaseException, trace: Any) -> int:
        """An exception cannot pass through the driver's C code: keep it, and show it now."""
        self.failure = error
        traceback.print_exception(kind, error, trace)
        return 0

    def report(self) -> list[str]:
        """Return one text per distinct message, with its count."""
        return [
            f"{message}" + (f" ({count} times)" if count > 1 else "")
            for message, count in self.messages.items()
        ]


def _label_names(labels: Any, count: int) -> list[str]:
    """Return the names of open labels, outermost first.

    The layers list them from the inside out, and layer 1.3.239 lists each twice.
    """
    names = [vk.text(labels[index].pLabelName) for index in reversed(range(count))]
    return [name for name, _ in groupby(names)]


def _object_name(described: Any) -> str:
    name = vk.text(described.pObjectName)
    return name or f"object {described.objectType} 0x{described.objectHandle:x}"
