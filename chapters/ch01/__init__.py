"""Chapter 1: a glTF scene, lit by its own lights and drawn in one forward pass."""

from common.lessons import Lesson, Needs

LESSON = Lesson(
    number=1,
    title="A forward renderer for glTF scenes",
    adds=(
        "frames in flight",
        "handles and deferred deletion",
        "descriptor sets per material",
        "pipelines with dynamic rendering",
        "GPU timestamps",
        "metallic-roughness shading",
        "punctual lights",
        "environment lighting",
        "the same picture on OpenGL",
        "multisampling with a resolve for what is shown",
    ),
    needs=Needs(required=frozenset(), optional=frozenset({"anisotropy"})),
    reading=(
        "renderer.py",
        "passes/forward.py",
        "shaders/forward.frag",
        "graphics/frames.py",
        "graphics/resources.py",
        "graphics/descriptors.py",
        "graphics/pipelines.py",
        "graphics/commands.py",
        "graphics/profiler.py",
        "passes/tonemap.py",
        "passes/resolve.py",
        "shaders/resolve.frag",
        "logic/packing.py",
        "logic/draw_lists.py",
        "passes/sky.py",
        "logic/environment.py",
        "graphics/environment.py",
        "shaders/environment_prefilter.comp",
        "gl/renderer.py",
        "gl/forward.py",
    ),
)
