// Light that a surface of a path asks for by itself: rays to the scene's lights, and to a direction of the environment or a
// point of an emissive triangle, drawn from tables.

#include "paths/light_tables.glsl"
#include "paths/random.glsl"
#include "rays/surface.glsl"
#include "clusters/walk.glsl"
#include "bsdf.glsl"
#include "environment.glsl"
#include "luminance.glsl"
#include "mis.glsl"

const float FAR = 3.402823e38;

// A ray towards light, and what arrives along it if nothing is in the way.
struct LightRay {
    Ray ray;
    vec3 value;  // what leaves the surface, over the density of the ray, and weighted
    float way;   // t of the light, up to which a medium takes a part
};

const LightRay NO_RAY = LightRay(Ray(vec3(0.0), 0.0, vec3(0.0), 0.0), vec3(0.0), 0.0);

#include "paths/collisions.glsl"

// A surface reflects light from the side of its triangle from which it is seen, whatever its normal says. The albedo of a medium
// is in what the path carries.
vec3 reflected(Bsdf bsdf, Surface s, vec3 to_light, vec3 view) {
#ifdef FOG
    if (in_medium) {
        return vec3(phase_towards(to_light, view));
    }
#endif
    return dot(to_light, s.flat_normal) > 0.0 ? bsdf_value(bsdf, s.normal, to_light, view) : vec3(0.0);
}

// The density with which a path goes on in a direction.
float reflected_pdf(Bsdf bsdf, Surface s, vec3 to_light, vec3 view) {
#ifdef FOG
    if (in_medium) {
        return phase_towards(to_light, view);
    }
#endif
    return bsdf_pdf(bsdf, s.normal, to_light, view);
}

#ifdef LIT
LightRay ray_to_light(uint number, Surface s, Bsdf bsdf, vec3 view) {
    vec3 to_light;
    vec3 received = exposed_illuminance(number, s.at.position, to_light);
    vec3 origin = ray_origin(s.at, to_light);
    float far = FAR, way = FAR;
    if (lights[number].kind != LIGHT_DIRECTIONAL) {
        // Bulbs cast no shadow of their own lamp, as in rays/picture.glsl.
        vec3 along = abs(to_light);
        float near = SHADOW_NEAR * frame.eye.w / max(along.x, max(along.y, along.z));
        way = dot(lights[number].position - origin, to_light);
        far = max(way - near, 0.0);
    }
    return LightRay(Ray(origin, 0.0, to_light, far), received * reflected(bsdf, s, to_light, view), way);
}

#include "paths/light_tree.glsl"

// How many lights are drawn from the tree at a vertex. One of them is kept by what it really adds (Talbot, Cline and Egbert
// 2005, "Importance Resampling for Global Illumination"): the tree knows nothing of cones and materials.
const uint TREE_DRAWS = 4u;

// A ray to one light. It is drawn in proportion to what the lights would add without shadows, so that without shadows the
// sum is exact: weighted reservoir sampling (Chao 1982), with a random number for each light. Where there are many, those
// without a place and some that the tree draws stand for all.
LightRay ray_to_one_light(Surface s, Bsdf bsdf, vec3 view, inout uint state) {
    LightRay kept = NO_RAY;
    float sum = 0.0, own = 0.0;
    uint each = path.tree.y != 0u ? light_count.y : light_count.x;
    uint shown = path.tree.y != 0u ? each + TREE_DRAWS : each;
    for (uint i = 0u; i < shown; ++i) {
        float probability = 1.0;
        uint number = i;
        if (i >= each) {
            number = drawn_light(s.at.position, s.flat_normal, state, probability);
            probability *= float(TREE_DRAWS);
        }
        if (number != NO_LIGHT) {
            LightRay ray = ray_to_light(number, s, bsdf, view);
            ray.value /= probability;
            float weight = luminance(ray.value);
            sum += weight;
            if (weight > 0.0 && pcg_float(state) * sum < weight) {
                kept = ray;
                own = weight;
            }
        }
    }
    kept.value *= own > 0.0 ? sum / own : 0.0;
    return kept;
}
#endif

// The weight of a ray towards light with density `own`, where reflected rays have that direction with density `other`.
float weight_of(float own, float other) {
    return path.knobs.z == STRATEGY_MIS ? power_heuristic(own, other) : 1.0;
}

#ifdef ENVIRONMENT
vec3 environment_along(vec3 direction) {
    vec3 turned = turned_back(direction, frame.environment.yz);
    return frame.environment.x * exposure() * textureLod(environment_radiance, turned, 0.0).rgb;
}

// The density per solid angle with which rays to light have a direction of the environment as it was before its turn.
float environment_pdf(vec3 turned) {
    uint face, size = uint(path.choice.y);
    uvec2 texel = min(uvec2(cube_uv(turned, face) * path.choice.y), uvec2(size - 1u));
    float probability = probability_in(0u, (face * size + texel.y) * size + texel.x);
    return path.choice.x * probability / cube_texel_solid_angle(turned, path.choice.y);
}

LightRay ray_to_environment(Surface s, Bsdf bsdf, vec3 view, uvec2 bits, vec2 u) {
    float probability;
    uint texel = drawn_from(0u, path.tables.x, bits, probability), size = uint(path.choice.y);
    uvec3 at = uvec3(texel % size, texel / size % size, texel / (size * size));
    vec3 turned = normalize(cube_direction(at.z, (vec2(at.xy) + u) / path.choice.y));
    vec3 direction = turned_back(turned, vec2(frame.environment.y, -frame.environment.z));
    float pdf = path.choice.x * probability / cube_texel_solid_angle(turned, path.choice.y);
    vec3 value = reflected(bsdf, s, direction, view);
    if (value == vec3(0.0) || pdf <= 0.0) {
        return NO_RAY;
    }
    value *= environment_along(direction) * (weight_of(pdf, reflected_pdf(bsdf, s, direction, view)) / pdf);
    return LightRay(Ray(ray_origin(s.at, direction), 0.0, direction, FAR), value, FAR);
}
#endif

#ifdef EMITTERS
// The area of a triangle in the world.
float area_of(Instance instance, Mesh mesh, uvec3 v) {
    uint positions = mesh.streams[0].x;
    vec3 a = fetch3(positions, v.x);
    vec3 along = transform_vector(instance.world_from_object, fetch3(positions, v.y) - a);
    vec3 across = transform_vector(instance.world_from_object, fetch3(positions, v.z) - a);
    return 0.5 * length(cross(along, across));
}

// The density per solid angle with which rays to light have the direction to a point of an emissive triangle.
float emitter_pdf(float probability, float area, float distance2, float cosine) {
    float seen = area * abs(cosine);
    return seen > 0.0 ? (1.0 - path.choice.x) * probability * distance2 / seen : 0.0;
}

// The same for a hit at a distance, of a ray of length 1.
float emitter_pdf_of(Hit hit, vec3 direction, vec3 flat_normal) {
    uint number = emissive_number(hit.instance, hit.primitive);
    if (number == NO_LIGHT) {
        return 0.0;
    }
    Instance instance = instance_of(hit.instance);
    Mesh mesh = meshes[instance.mesh];
    float area = area_of(instance, mesh, corners_of(mesh, hit.primitive));
    float probability = probability_in(path.tables.x, number);
    return emitter_pdf(probability, area, hit.t * hit.t, dot(direction, flat_normal));
}

LightRay ray_to_emitter(Surface s, Bsdf bsdf, vec3 view, uvec2 bits, vec2 u) {
    if (path.tables.y == 0u) {  // edits have left none
        return NO_RAY;
    }
    float probability;
    uint number = drawn_from(path.tables.x, path.tables.y, bits, probability);
    uvec2 triangle = path_tables[path.tables.z + number].xy;
    Instance instance = instance_of(triangle.x);
    Mesh mesh = meshes[instance.mesh];
    Material material = materials[instance.material];
    uint flags = uint(material.uv_rows[1].w);
    uvec3 v = corners_of(mesh, triangle.y);
    float root = sqrt(u.x);
    vec2 at = vec2(root * (1.0 - u.y), root * u.y);  // uniform over the triangle
    uint positions = mesh.streams[0].x;
    SurfacePoint point = surface_point(
        instance.world_from_object, fetch3(positions, v.x), fetch3(positions, v.y), fetch3(positions, v.z), at
    );
    vec3 to_light = point.position - s.at.position;
    float distance2 = dot(to_light, to_light);
    vec3 direction = to_light * inversesqrt(max(distance2, 1e-37));
    float cosine = -dot(direction, point.normal);
    if (cosine <= 0.0 && (flags & uint(DOUBLE_SIDED_FLAG)) == 0u) {
        return NO_RAY;
    }
    float pdf = emitter_pdf(probability, area_of(instance, mesh, v), distance2, cosine);
    vec3 value = reflected(bsdf, s, direction, view);
    if (value == vec3(0.0) || pdf <= 0.0) {
        return NO_RAY;
    }
    vec3 emission = material.emissive.rgb * exposure();
#ifdef EMISSIVE_MAP
    if ((flags & 16u) != 0u) {
        find_uv(mesh, v, at);
        emission *= map_at_hit(material, 4).rgb;
    }
#endif
#ifdef NON_OPAQUE
    if ((flags & uint(MASKED_FLAG | BLENDED_FLAG)) != 0u) {
        float alpha = alpha_of(Hit(0.0, triangle.x, triangle.y, at, 0u), instance, material);
        bool masked = (flags & uint(MASKED_FLAG)) != 0u;
        emission *= masked ? float(alpha >= material.emissive.a) : clamp(alpha, 0.0, 1.0);
    }
#endif
    value *= emission * (weight_of(pdf, reflected_pdf(bsdf, s, direction, view)) / pdf);
    vec3 origin = ray_origin(s.at, direction);
    // Up to where rays begin that leave the point: the triangle itself is not in the way.
    return LightRay(Ray(origin, 0.0, ray_origin(point, -direction) - origin, 1.0), value, 1.0);
}
#endif

#if defined(ENVIRONMENT) || defined(EMITTERS)
LightRay ray_to_light_of_tables(Surface s, Bsdf bsdf, vec3 view, inout Random random) {
    uvec2 choice = random_bits(random), bits = random_bits(random);
    vec2 u = random_2d(random);
#if defined(ENVIRONMENT) && defined(EMITTERS)
    if (unit_float(choice.x) < path.choice.x) {
        return ray_to_environment(s, bsdf, view, bits, u);
    }
    return ray_to_emitter(s, bsdf, view, bits, u);
#elif defined(ENVIRONMENT)
    return ray_to_environment(s, bsdf, view, bits, u);
#else
    return ray_to_emitter(s, bsdf, view, bits, u);
#endif
}
#endif
