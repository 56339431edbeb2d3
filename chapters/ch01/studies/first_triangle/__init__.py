"""Study: three corners, three colours. The first shaders, the first pipeline, the first draw."""

from common.lessons import Study

STUDY = Study(
    title="first triangle",
    idea="A vertex shader places three corners, the GPU finds the pixels between them, a fragment shader colours each.",
    order=2,
    features=("intro/first-triangle",),
)
