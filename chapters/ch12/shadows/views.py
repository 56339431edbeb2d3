"""The views of shadows, in the order of their numbers (shading/views.glsl)."""

SHADOWS = {
    "shadow-factor": (
        "How much of the light that would arrive without casters does arrive: white is all of it, black is none."
    ),
    "cascade": (
        "Which cascade of the first directional light a surface reads: finest to coarsest in colours, grey for none."
    ),
    "residency": "Each tile of the shadow map of the light that gives most in a colour of its own; grey has no map.",
    "shadow-resolution": (
        "Texels of that map along a face: blue is 40, green 128, yellow 256, orange 512, white more; grey has no map."
    ),
    "redrawn-pages": "Orange where the frame drew the tile of that map, blue where it kept the tile, grey for no map.",
}
"""Names and sentences."""
