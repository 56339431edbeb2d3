// Paths in flight, as a structure of arrays: row r of path i is wave[r * WAVE_PATHS + i], so neighbours read neighbours.
//
//     0  origin, t_min                  7, 8, 9     a ray towards light: origin, t_max; direction; value, way
//     1  direction, pdf                 10, 11, 12  the other one
//     2  carried; rounds of the path    13          what was carried when these rays were sent
//     3  color; 1 if there is a path    14          sums of the pixel: light in nits, paths
//     4  the random stream              15          the queues: x, y: live paths by turns, z: paths with rays towards light
//     5  t, instance, primitive, flags
//     6  barycentrics; sums of the pixel: squared luminances, paths left out

layout(BIND(3, PATH_BINDING + 7, 9), std430) buffer Wave_ { uvec4 wave[]; };
layout(BIND(3, PATH_BINDING + 8, 10), std430) buffer Wave_head_ { uint wave_head[]; };
layout(BIND(3, PATH_BINDING + 9, 11), std430) writeonly buffer Wave_told_ { uint wave_told[]; };

// Words of the head: two sets of arguments of indirect dispatches, what the queues hold, and counters for the CPU.
const uint LIVE_GROUPS = 0u, SHADOW_GROUPS = 4u, LIVE = 8u, SHADOWS = 9u, NEXT_LIVE = 10u, NEXT_SHADOWS = 11u;
const uint TOLD = 16u;  // 0: lanes that live paths took, 1: those that the loop would take; 2 + round: live paths
const uint LAST_TOLD = TOLD + 2u + TOLD_ROUNDS - 1u;
const uint LANES = 32u;  // invocations that run together, in these counters

const uint RAY = 0u, CARRIED = 2u, COLOR = 3u, RANDOM = 4u, HIT = 5u, AT = 6u, TOWARDS = 7u, BEFORE = 13u, OWN = 14u, QUEUES = 15u;

uvec4 row(uint r, uint i) { return wave[r * WAVE_PATHS + i]; }
vec4 row_of_floats(uint r, uint i) { return uintBitsToFloat(row(r, i)); }
void set_row(uint r, uint i, uvec4 value) { wave[r * WAVE_PATHS + i] = value; }
void set_row(uint r, uint i, vec4 value) { set_row(r, i, floatBitsToUint(value)); }

void store_ray(uint r, uint i, Ray ray, float more) {
    set_row(r, i, vec4(ray.origin, ray.t_min));
    set_row(r + 1u, i, vec4(ray.direction, more));
}

Ray ray_at(uint r, uint i) {
    vec4 from = row_of_floats(r, i);
    return Ray(from.xyz, from.w, row_of_floats(r + 1u, i).xyz, FAR);
}

void store_hit(uint i, Hit hit) {
    set_row(HIT, i, uvec4(floatBitsToUint(hit.t), hit.instance, hit.primitive, hit.flags));
    wave[AT * WAVE_PATHS + i].xy = floatBitsToUint(hit.at);
}

Hit hit_at(uint i) {
    uvec4 found = row(HIT, i);
    return Hit(uintBitsToFloat(found.x), found.y, found.z, uintBitsToFloat(row(AT, i).xy), found.w);
}

void store_random(uint i, Random random) { set_row(RANDOM, i, uvec4(random.state, random.index, random.seed, random.pair)); }

Random random_at(uint i) {
    uvec4 at = row(RANDOM, i);
    return Random(at.x, at.y, at.z, at.w);
}

// `number` is that of the ray, 0 or 1. Its t_max takes the place of t_min, which all rays of a path have from its beginning.
void store_light_ray(uint number, uint i, LightRay towards) {
    Ray ray = Ray(towards.ray.origin, towards.ray.t_max, towards.ray.direction, 0.0);
    store_ray(TOWARDS + 3u * number, i, ray, 0.0);
    set_row(TOWARDS + 3u * number + 2u, i, vec4(towards.value, towards.way));
}

LightRay light_ray_at(uint number, uint i, float begin) {
    Ray ray = ray_at(TOWARDS + 3u * number, i);
    vec4 more = row_of_floats(TOWARDS + 3u * number + 2u, i);
    return LightRay(Ray(ray.origin, begin, ray.direction, ray.t_min), more.xyz, more.w);
}
