// The units of each light: a work group for each light of the round and each batch of draws.
//
// The group walks over the draws of its batch, 256 at a time, and tests their instances. Then it walks over the units of
// those that are left, and tests meshlets. Places are prefix sums, so that lists have the order of the scene.

#include "shadows/cull.glsl"
#include "culling/sums.glsl"

shared uint starts[256];  // the units before each of the draws

Caster caster_of(Instance instance) {
    return Caster(instance.bounds_centre.xyz, instance.bounds_extent.xyz, instance.bounds_centre.w);
}

Caster caster_of(Instance instance, Meshlet meshlet) {
    mat3x4 world = instance.world_from_object;
    vec3 extent = vec3(
        dot(abs(world[0].xyz), meshlet.extent), dot(abs(world[1].xyz), meshlet.extent),
        dot(abs(world[2].xyz), meshlet.extent)
    );
    return Caster(transform_point(world, meshlet.sphere.xyz), extent, meshlet.sphere.w * stretch_bound(world));
}

bool faces_away(ShadowFace face, Instance instance, Caster caster, Meshlet meshlet) {
    bool orthographic = face.ahead.w == 0.0;
    vec3 eye = orthographic ? -face.ahead.xyz : face.origin.xyz;
    float distance = orthographic ? 1.0 : length(caster.centre - face.origin.xyz);
    float snapped = distance / (128.0 * min(face.right.w, face.down.w));  // vertices are snapped to 1/256 of a texel
    return cone_faces_away(
        meshlet.cone, meshlet.sphere.xyz, meshlet.sphere.w, eye_in_object(instance.world_from_object, eye, orthographic),
        orthographic, grazing_margin(caster.radius, rounding_of(face, caster) + snapped)
    );
}

void main() {
    uint me = gl_LocalInvocationIndex, batch = gl_WorkGroupID.x, list = gl_WorkGroupID.y;
    uint word = shadow_lists[pushed.first.x + list], base = word & 0xffffffu, count = word >> 24, kept = 0u;
    if (count == 0u) {  // nothing is drawn to the layers of this number
        if (me == 0u) {
            numbers[units_number(list, batch)] = 0u;
        }
        return;
    }
    ShadowFace face = shadow_faces[base];
    uint end = draws_end(batch), place = place_of(list, batch);
    for (uint first = batches[batch].x; first < end; first += 256u) {
        uint number = first + me, units = 0u;
        if (number < end) {
            Draw draw = draws[number];
            Caster caster = caster_of(instance_of(draw.instance));
            uint moves = shadow_moving[draw.instance >> 5] >> (draw.instance & 31u) & 1u;
            bool left = !tests(1u) || is_in_reach(face, caster);
            left = left && faces_of(base, count, caster) != 0u;
            units = left || (draw.flags & ALWAYS) != 0u ? draw.units : 0u;
            units = moves == pushed.sizes.z ? units : 0u;
        }
        uvec2 all;
        starts[me] = sum_before(uvec2(units, 0u), all).x;
        barrier();
        for (uint begin = 0u; begin < all.x; begin += 256u) {
            uint unit = begin + me, low = 0u, high = 256u, mask = 0u;
            if (unit < all.x) {
                while (high - low > 1u) {
                    uint middle = (low + high) / 2u;
                    if (starts[middle] <= unit) { low = middle; } else { high = middle; }
                }
                Draw draw = draws[first + low];
                Instance instance = instance_of(draw.instance);
                unit -= starts[low];
                if ((draw.flags & ALWAYS) != 0u) {
                    mask = (1u << count) - 1u;
                } else if ((draw.flags & WHOLE) != 0u) {
                    mask = faces_of(base, count, caster_of(instance));
                } else {
                    Meshlet meshlet = meshlets[draw.first_meshlet + unit];
                    Caster caster = caster_of(instance, meshlet);
                    bool left = !tests(2u) || is_in_reach(face, caster);
                    if (tests(4u) && (draw.flags & TWO_SIDED) == 0u) {
                        left = left && !faces_away(face, instance, caster, meshlet);
                    }
                    mask = left ? faces_of(base, count, caster) : 0u;
                }
            }
            uvec2 total;
            uint position = kept + sum_before(uvec2(mask != 0u ? 1u : 0u, 0u), total).x;
            if (mask != 0u && position < batches[batch].z) {
                lists[place + position] = uvec2(first + low, unit | mask << 24);
            }
            kept += total.x;
        }
        barrier();
    }
    if (me == 0u) {
        numbers[units_number(list, batch)] = min(kept, batches[batch].z);
    }
}
