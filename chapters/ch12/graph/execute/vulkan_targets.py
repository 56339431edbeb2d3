"""The attachments of a pass from the frame graph: any number of colour targets, with load and store operations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from backends.contract import Access
from backends.vulkan import api as vk
from backends.vulkan.resources import Buffer, Image

from ...frames.vulkan_commands import Rendering
from ..sync.vulkan import layout_of
from ..types import Attachment, Step

_LOAD = {
    "clear": vk.VK_ATTACHMENT_LOAD_OP_CLEAR,
    "load": vk.VK_ATTACHMENT_LOAD_OP_LOAD,
    "discard": vk.VK_ATTACHMENT_LOAD_OP_DONT_CARE,
}
_STORE = {
    "store": vk.VK_ATTACHMENT_STORE_OP_STORE,
    "discard": vk.VK_ATTACHMENT_STORE_OP_DONT_CARE,
    # Not even the old contents are written back, so other passes may read them at the same time.
    "none": vk.VK_ATTACHMENT_STORE_OP_NONE,
}


class Targets(Rendering):
    """The VkRenderingInfo of one step; it avoids needless reads and writes of memory on tiled GPUs."""

    def __init__(
        self, step: Step, resources: Mapping[str, Image | Buffer], reads: Sequence[Access] | None = None
    ) -> None:
        assert step.size is not None, f"'{step.name}' draws"
        self.size = step.size
        colors = [self._image(target, resources) for target in step.colors]
        depth = None if step.depth is None else self._image(step.depth, resources)
        self.images = (*colors, depth)
        self.info = vk.new(
            "VkRenderingInfo",
            pNext=self._rates(step.rates(reads), resources) if reads else None,
            renderArea={"extent": {"width": step.size[0], "height": step.size[1]}},
            layerCount=1,
            pColorAttachments=[
                self._target(target, image, "color")
                for target, image in zip(step.colors, colors, strict=True)
            ]
            or None,
            pDepthAttachment=None if step.depth is None else self._target(step.depth, depth, "depth"),
        )

    @staticmethod
    def _rates(mask: tuple[str, tuple[int, int]] | None, resources: Mapping[str, Image | Buffer]) -> Any:
        """Return the attachment with the shading rates of the step; None for a step without."""
        if mask is None:
            return None
        name, (width, height) = mask
        image = resources[name]
        assert isinstance(image, Image), name
        return vk.new(
            "VkRenderingFragmentShadingRateAttachmentInfoKHR",
            imageView=image.view,
            imageLayout=layout_of("rate", image),
            shadingRateAttachmentTexelSize={"width": width, "height": height},
        )

    @staticmethod
    def _image(target: Attachment, resources: Mapping[str, Image | Buffer]) -> Image:
        image = resources[target.resource]
        assert isinstance(image, Image), target.resource
        return image

    @staticmethod
    def _target(target: Attachment, image: Any, use: str) -> dict[str, Any]:
        value: dict[str, Any] = {}
        if target.clear is not None and use == "depth":
            value = {"depthStencil": {"depth": target.clear[0]}}
        elif target.clear is not None:
            is_integer = image.format.endswith("ui")
            value = {"color": {"uint32" if is_integer else "float32": list(target.clear)}}
        return {
            "imageView": image.view,
            "imageLayout": layout_of("read" if target.store == "none" else use, image),
            "loadOp": _LOAD[target.load],
            "storeOp": _STORE[target.store],
            "clearValue": value,
        }
