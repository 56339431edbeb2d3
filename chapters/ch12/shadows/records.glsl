// A face of a light's shadow map, and the pure functions of its projection; shadows/faces.py fills the records.

struct ShadowFace {
    vec4 right;   // xyz: the axis along rows of texels, w: texels for each unit of x / z, or for each metre
    vec4 down;    // xyz: the axis along columns, w: the same of y
    vec4 ahead;   // xyz: the axis along which depth counts, w: 1 in a perspective projection, else 0
    vec4 origin;  // xyz: where depth is 0, w: the depth of the near plane
    vec4 ends;    // x: the depth of the far plane, y: texels at each edge that only filters reach, 1 more than the radius of the kernel;
                  // zw: where the face begins in its first tile
    uvec4 place;  // x: the first word of the face's tiles in the table, y: tiles in a row, z: size in texels,
                  // w: its light
};

const float SHADOW_NOTHING = 1e30;  // the depth of a texel on which nothing lies
const int SHADOW_TILE_LOG2 = 7;     // a tile is 128x128 texels of 32 bits: 64 KiB, a page of sparse memory

// Metres along the axes of the face. The sums are written out, so that both compilers keep their order.
vec3 in_face(ShadowFace face, vec3 position) {
    vec3 p = position - face.origin.xyz;
    precise vec3 result = vec3(
        face.right.x * p.x + face.right.y * p.y + face.right.z * p.z,
        face.down.x * p.x + face.down.y * p.y + face.down.z * p.z,
        face.ahead.x * p.x + face.ahead.y * p.y + face.ahead.z * p.z
    );
    return result;
}

// Texels along the target of a face of `size` texels, which lies in its middle. It is a power of two: a viewport then rounds
// no vertex, and drivers that multiply and add in one step or in two for different stages draw the same pixels.
uint target_size(uint size) { return 1u << findMSB(2u * size - 1u); }

int target_margin(ShadowFace face) { return int(target_size(face.place.z) - face.place.z) / 2; }

// Clip position in the target of a face: reversed depth, 1 at the near plane and 0 at the far one.
vec4 face_clip(ShadowFace face, vec3 position) {
    vec3 p = in_face(face, position);
    float near = face.origin.w, far = face.ends.x;
    vec2 scale = vec2(face.right.w, face.down.w) * (2.0 / float(target_size(face.place.z)));
    precise vec4 clip = vec4(p.xy * scale, (far - p.z) / (far - near), 1.0);
    if (face.ahead.w != 0.0) {
        clip.z *= near;
        clip.w = p.z;
    }
    return clip;
}

// Metres along the axis of the face, from the depth that was rasterised.
float linear_depth(ShadowFace face, float depth) {
    float near = face.origin.w, far = face.ends.x;
    if (depth == 0.0) {
        return SHADOW_NOTHING;
    }
    return face.ahead.w != 0.0 ? near * far / (near + depth * (far - near)) : far - depth * (far - near);
}

// The depth of a texel, or nothing beyond the reach of a local light: there it gives no light that a caster could take.
// The far plane is as far away as that, and at its corners farther.
float within_reach(ShadowFace face, ivec2 texel, float depth) {
    vec2 at = (vec2(texel) + 0.5 - 0.5 * float(face.place.z)) / vec2(face.right.w, face.down.w);
    return face.ahead.w != 0.0 && depth * length(vec3(at, 1.0)) > face.ends.x ? SHADOW_NOTHING : depth;
}

// The face of a cube that a direction meets, in the order +x, -x, +y, -y, +z, -z.
uint cube_face(vec3 direction) {
    vec3 size = abs(direction);
    if (size.x >= size.y && size.x >= size.z) {
        return direction.x < 0.0 ? 1u : 0u;
    }
    if (size.y >= size.z) {
        return direction.y < 0.0 ? 3u : 2u;
    }
    return direction.z < 0.0 ? 5u : 4u;
}
