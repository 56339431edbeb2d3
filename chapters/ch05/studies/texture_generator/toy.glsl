// Study texture-generator: the host of shaders that fill a texture. Each of them includes it, and defines `mainImage`.

layout(local_size_x = 16, local_size_y = 16) in;

struct Push {
    vec4 time;
};
PUSH(Push, push)

layout(BIND(0, 0, 0), rgba8) uniform writeonly image2D target;

// The names are Shadertoy's, in seconds and pixels. The size is that of the image itself.
#define iTime (push.time.x)
#define iResolution vec3(vec2(imageSize(target)), 1.0)

void mainImage(out vec4 fragColor, in vec2 fragCoord);

void main() {
    ivec2 texel = ivec2(gl_GlobalInvocationID.xy), size = imageSize(target);
    if (texel.x >= size.x || texel.y >= size.y) {
        return;  // over the edge
    }
    vec4 color = vec4(0.0);
    // In Shadertoy y goes up from the lower edge, and coordinates are those of pixel centres.
    mainImage(color, vec2(float(texel.x) + 0.5, float(size.y - texel.y) - 0.5));
    imageStore(target, texel, vec4(color.rgb, 1.0));
}
