"""The chapter on OpenGL: the same passes, settings, images and counters, to be read side by side with Vulkan's.

    renderer.py      what happens in a frame, top to bottom
    frames.py        frames in flight: a fence per slot
    pipelines.py     programs with the state that Vulkan bakes into a pipeline
    scene_data.py    geometry, textures, and the buffers that are written for every frame
    commands.py      the loop over the draws
    forward.py, instance_id.py, resolve.py, tonemap.py    one module per pass, as in passes/

OpenGL keeps the order of its calls and the layouts of its images by itself, so there are no barriers here and no
command buffers: what Vulkan records, OpenGL calls.
"""
