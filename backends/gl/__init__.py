"""The OpenGL 4.5 foundation: what no OpenGL lesson teaches.

context       the context: EGL without a window or a GLFW window, features, the count of what lives
api           raw calls that moderngl lacks, checked; constants
debug         what the driver says, tied to the pass and the Python line
capabilities  what a driver can do, in Strata's words
resources     buffers, images, views, samplers
draws         vertex arrays, push constants written ahead
targets       framebuffers and what is cleared, drawn to, resolved and blitted
programs      programs from the same GLSL text as Vulkan's
upload        mip chains, made by the same kernel as Vulkan's
readback      images back to the CPU
queries       timestamps and counts of the GPU's work
draw_lists    user interfaces, over a finished picture
present       the picture in a window
screen        a window's context, with the picture and the user interface in it

moderngl makes the context and links programs; everything else is a raw call on names ("direct state access"), so what
is bound is known here and never has to be guessed. Clip space is Vulkan's: y = -1 is row 0 in memory, depth runs from
0 to 1, and so pictures, textures and readback need no flip but the one in `present`.
"""
