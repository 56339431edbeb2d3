// One level of the chain that rough surfaces mirror: the radiance around each direction, blurred by the lobe of D.
//
// The surface is taken to be seen from straight above, n = v = r, the approximation of the split sum: so lobes are round,
// and do not stretch at grazing angles as those of real surfaces do. Light is weighted by D(h) (n.l) (Karis 2013).
//
// The mip chain of the source is a tree: a texel is the mean of four texels of the level below. The sum walks it from the
// six faces down, and takes a texel as a whole once it is small beside the width that the lobe has there: fine texels
// around the mirrored direction, ever coarser ones away from it. So every texel of the source counts once, a sun of one
// texel with its exact energy, and there is no noise. Samples drawn from the lobe, however many, read such a sun in
// whatever part their filters happen to cover it; on a sunny panorama that was wrong by a tenth with 2048 of them.

#include "brdf.glsl"
#include "environment.glsl"
#include "half.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

struct Push {
    uvec4 size;   // x: texels along an edge of the target, y: the last level of the source, which has one texel a face
    vec4 lobe;    // x: alpha, y: texels taken as a whole are at most this part of the lobe's width
};
PUSH(Push, push)

layout(BIND(0, 0, 0)) uniform samplerCube source;
layout(BIND(0, 1, 0), FORMAT) uniform writeonly imageCube target;

// Every second bit of `code`, moved together: one coordinate of a place on the Z-shaped curve.
uint every_second_bit(uint code) {
    code &= 0x55555555u;
    code = (code | (code >> 1)) & 0x33333333u;
    code = (code | (code >> 2)) & 0x0f0f0f0fu;
    code = (code | (code >> 4)) & 0x00ff00ffu;
    return (code | (code >> 8)) & 0x0000ffffu;
}

void main() {
    uvec3 id = gl_GlobalInvocationID;
    if (any(greaterThanEqual(id.xy, push.size.xx))) {
        return;
    }
    vec3 n = normalize(cube_direction(id.z, (vec2(id.xy) + 0.5) / float(push.size.x)));
    float alpha = push.lobe.x;
    vec4 sum = vec4(0.0);
    // A node of the tree: `depth` levels below a face's only texel, and its place on the Z-shaped curve over all faces.
    uint depth = 0u;
    uint code = 0u;
    while (depth > 0u || code < 6u) {
        uint face = code >> (2u * depth);
        uint inside = code - (face << (2u * depth));
        float edge = float(1u << depth);
        vec2 texel = vec2(every_second_bit(inside), every_second_bit(inside >> 1)) + 0.5;
        vec3 d = normalize(cube_direction(face, texel / edge));
        float solid_angle = cube_texel_solid_angle(d, edge);
        float width = sqrt(solid_angle);
        // The smallest angle between n and half vectors of the texel; its corners are at most 0.75 widths away.
        float nearest = 0.5 * max(acos(clamp(dot(n, d), -1.0, 1.0)) - 0.75 * width, 0.0);
        if (nearest < 0.25 * PI) {  // else all of it is below the horizon
            float s = sin(nearest);
            float c = cos(nearest);
            // D falls by a factor of 4 when the half vector's slope grows by sqrt(alpha^2 + slope^2); angles of light are
            // twice those of half vectors.
            float lobe = 2.0 * c * sqrt(alpha * alpha * c * c + s * s);
            if (width > push.lobe.y * lobe && depth < push.size.y) {
                ++depth;
                code <<= 2;
                continue;
            }
            vec3 h = normalize(n + d);
            float weight = distribution_ggx(n, h, alpha) * max(dot(n, d), 0.0) * solid_angle;
            if (weight > 0.0) {
                sum += weight * vec4(textureLod(source, d, float(push.size.y - depth)).rgb, 1.0);
            }
        }
        ++code;
        while (depth > 0u && (code & 3u) == 0u) {  // the last of four: go on beside the texel above them
            --depth;
            code >>= 2;
        }
    }
    imageStore(target, ivec3(id), vec4(nearest_half(sum.rgb / max(sum.a, 1e-30)), 1.0));
}
