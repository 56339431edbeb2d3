"""The study first-triangle on Vulkan: everything the GPU must know to draw is fixed in one object, the pipeline."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from backends import shader_text
from backends.vulkan import api as vk
from backends.vulkan.shaders.compiler import compile_shader
from common.view.camera import View

from ...frames.vulkan_commands import Commands
from ..stage_vulkan import Stage
from . import STUDY

FOLDER = Path(__file__).parent
EVERY_CHANNEL = (
    vk.VK_COLOR_COMPONENT_R_BIT
    | vk.VK_COLOR_COMPONENT_G_BIT
    | vk.VK_COLOR_COMPONENT_B_BIT
    | vk.VK_COLOR_COMPONENT_A_BIT
)


class Renderer(Stage):
    """A triangle without a vertex buffer."""

    study = STUDY
    moves = False

    def create(self) -> None:
        """Build the pipeline. Slow, and so done before the first frame: drivers compile machine code here."""
        device = self.device
        files = ("triangle.vert", "triangle.frag")
        # GLSL text becomes the words of SPIR-V that a driver takes.
        codes = [compile_shader(shader_text.build(FOLDER / file, "vulkan")) for file in files]
        vertex, fragment = (self._module(code, file) for code, file in zip(codes, files, strict=True))
        # What shaders read from outside: nothing. The study rotating-cube fills this in.
        self._layout = device.create(
            "vkCreatePipelineLayout", vk.new("VkPipelineLayoutCreateInfo"), "triangle"
        )
        # The format of the image that will be drawn to. Not the image itself: any of this format will do.
        targets = vk.new(
            "VkPipelineRenderingCreateInfo", pColorAttachmentFormats=[vk.VK_FORMAT_R8G8B8A8_UNORM]
        )
        info = vk.new(
            "VkGraphicsPipelineCreateInfo",
            pNext=targets,
            pStages=[
                {"stage": vk.VK_SHADER_STAGE_VERTEX_BIT, "module": vertex, "pName": "main"},
                {"stage": vk.VK_SHADER_STAGE_FRAGMENT_BIT, "module": fragment, "pName": "main"},
            ],
            pVertexInputState={},  # no vertex buffers
            pInputAssemblyState={"topology": vk.VK_PRIMITIVE_TOPOLOGY_TRIANGLE_LIST},
            # One viewport; which one is said when drawing, so that a window can change its size.
            pViewportState={"viewportCount": 1, "scissorCount": 1},
            pDynamicState={"pDynamicStates": [vk.VK_DYNAMIC_STATE_VIEWPORT, vk.VK_DYNAMIC_STATE_SCISSOR]},
            # Both sides are drawn: with one triangle there is no inside that could be left out.
            pRasterizationState={
                "polygonMode": vk.VK_POLYGON_MODE_FILL,
                "cullMode": vk.VK_CULL_MODE_NONE,
                "lineWidth": 1.0,
            },
            pMultisampleState={"rasterizationSamples": 1},
            # What is written replaces what was there, in all four channels.
            pColorBlendState={"pAttachments": [{"colorWriteMask": EVERY_CHANNEL}]},
            layout=self._layout,
        )
        infos = vk.array("VkGraphicsPipelineCreateInfo", [info])
        self._pipeline = device.create_pipelines("vkCreateGraphicsPipelines", infos, ["triangle"])[0]
        # The pipeline holds the compiled code; the modules were only the way in.
        for module in (vertex, fragment):
            device.destroy("VkShaderModule", module)

    def _module(self, code: bytes, file: str) -> Any:
        """Return a shader as the pipeline takes it."""
        info = vk.new("VkShaderModuleCreateInfo", codeSize=len(code), pCode=code)
        return self.device.create("vkCreateShaderModule", info, file)

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Record the draw. The barrier and the cleared attachment of the study clear-window are in `begin`."""
        fn, (width, height) = self.device.fn, self.size
        self.begin(commands)
        fn.vkCmdBindPipeline(commands.handle, vk.VK_PIPELINE_BIND_POINT_GRAPHICS, self._pipeline)
        # From the shader's -1..1 to pixels; whatever falls outside of the scissor is left out.
        viewport = vk.new("VkViewport", width=float(width), height=float(height), maxDepth=1.0)
        fn.vkCmdSetViewport(commands.handle, 0, 1, viewport)
        scissor = vk.new("VkRect2D", extent={"width": width, "height": height})
        fn.vkCmdSetScissor(commands.handle, 0, 1, scissor)
        # Three vertices, once, from vertex 0 on.
        fn.vkCmdDraw(commands.handle, 3, 1, 0, 0)
        self.end(commands)
        self.work.draws, self.work.triangles = 1, 1

    def destroy(self) -> None:
        """Free the pipeline and its layout."""
        for kind, name in (("VkPipeline", "_pipeline"), ("VkPipelineLayout", "_layout")):
            if hasattr(self, name):
                self.device.destroy(kind, getattr(self, name))
