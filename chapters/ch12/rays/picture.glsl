// A traced picture: a ray from the eye through each pixel, a ray from each hit towards each light, and from smooth
// surfaces a ray in the mirrored direction. Light is that of the rasterised picture (shading/lighting.frag) otherwise, and so
// is fog: the eye looks through it to the first hit, and what that mirrors has none of its own.
//
// Rays from the eye and from mirrors skip the backs of single-sided surfaces, as a rasterised picture from their place does.
//
// This text is one function of the number of a pixel in its tile. It is a raygen shader, a kernel with ray queries, or a kernel that
// traverses our own BVH.

#include "rays/surface.glsl"
#include "clusters/walk.glsl"
#include "brdf.glsl"
#include "finite.glsl"
#if RAY_VIEW == 4
#define STEPS
#endif
#include "palette.glsl"
#include "environment.glsl"
#include "camera_ray.glsl"
#ifdef ENVIRONMENT
#include "ibl.glsl"
#endif
#include "fog/apply.glsl"
#include "rays/tile.glsl"
#include "rays/trace.glsl"

layout(BIND(3, TARGET_BINDING, 0), FORMAT) uniform writeonly image2D color_traced;

const float FAR = 3.402823e38;

// The light of the scene's lights that a surface reflects towards `view`. A light behind another surface adds nothing; blended
// and unlit surfaces cast no shadow, and either side of others does (shadows/passes.py). With shadow_sides=front only the
// side that sees the light does: a ray towards the light leaves the surface through its back.
vec3 light_of_lights(Surface s, vec3 view, float alpha) {
    vec3 sum = vec3(0.0);
    for (uint i = 0u; i < light_count.x; ++i) {
        vec3 to_light;
        vec3 received = exposed_illuminance(i, s.at.position, to_light);
        if (max(received.r, max(received.g, received.b)) <= 0.0) {
            continue;
        }
        vec3 reflected = received * metallic_roughness(s.normal, to_light, view, s.base_color, s.metallic, alpha);
#ifdef SHADOW_RAYS
        if (reflected == vec3(0.0)) {
            continue;
        }
        vec3 origin = ray_origin(s.at, to_light);
        float far = FAR;
        if (lights[i].kind != LIGHT_DIRECTIONAL) {
            // Bulbs cast no shadow of their own lamp: the rays end at the near planes of the six faces of a shadow map.
            vec3 along = abs(to_light);
            float near = SHADOW_NEAR * frame.eye.w / max(along.x, max(along.y, along.z));
            far = dot(lights[i].position - origin, to_light) - near;
        }
        if (far > 0.0 && occluded(Ray(origin, 0.0, to_light, far), CASTERS, CASTING_SIDES)) {
            continue;
        }
#endif
        sum += reflected;
    }
    return sum;
}

// The light that leaves a surface besides what it mirrors; `mirrored` is the share of the mirrored light that it reflects.
vec3 light_without_mirror(Surface s, vec3 view, out vec3 mirrored) {
    mirrored = vec3(0.0);
    if (!s.lit) {
        return s.emission;
    }
    vec3 color = s.emission;
#ifdef LIT
    color += light_of_lights(s, view, max(s.roughness * s.roughness, ALPHA_MIN));
#endif
    vec3 albedo = mix(0.96 * s.base_color + 0.04, s.base_color, s.metallic);
    color += frame.ambient.rgb * exposure() * s.occlusion * albedo;
#ifdef ENVIRONMENT
    float n_dot_v = min(abs(dot(s.normal, view)), 1.0);
    vec2 uv = table_uv(n_dot_v, s.roughness, float(textureSize(environment_table, 0).y));
    vec3 on_irradiance;
    environment_weights(
        s.base_color, s.metallic, textureLod(environment_table, uv, 0.0).rgb, ENERGY, mirrored, on_irradiance
    );
    vec3 irradiance = textureLod(environment_irradiance, turned_back(s.normal, frame.environment.yz), 0.0).rgb;
    float scale = frame.environment.x * exposure();
    color += scale * s.occlusion * on_irradiance * irradiance;
#else
    float n_dot_v = clamp(abs(dot(s.normal, view)), 0.0, 1.0);
    mirrored = mix(vec3(0.04), s.base_color, s.metallic);
    mirrored += (1.0 - mirrored) * pow(1.0 - n_dot_v, 5.0);
#endif
    return color;
}

// The light along a ray. A loop follows mirrored rays. It ends at the environment: behind everything, or around the
// mirrored direction, blurred for the roughness of the surface (ibl.glsl). The lookup stands behind the loop, since a
// software driver takes long to compile each one.
//
// `reached` is the point up to which the eye looks through fog, the first hit; `far` says that there is none.
vec3 light_along(Ray ray, out vec3 reached, out bool far) {
    vec3 color = vec3(0.0), share = vec3(1.0);
    float roughness = 0.0;
    bool nothing = false;
    far = false;
    reached = ray.origin;
    for (int bounce = 0;; ++bounce) {
        Hit hit = trace(ray, 0xffu, SKIP_BACKS);
        nothing = hit.instance == NO_HIT;
        far = far || (nothing && bounce == 0);
        if (nothing) {
            break;
        }
        Surface s = surface_at(hit, ray.direction);
        reached = bounce == 0 ? s.at.position : reached;
        vec3 view = -normalize(ray.direction), mirrored;
        color += share * light_without_mirror(s, view, mirrored);
        share *= mirrored;
        vec3 reflected = reflect(-view, s.normal);
        ray = Ray(ray_origin(s.at, reflected), 0.0, reflected, FAR);
        bool away = dot(reflected, s.flat_normal) > 0.0;  // a normal map may mirror into the surface
        if (bounce == BOUNCES || s.roughness > MIRROR || !away || share == vec3(0.0)) {
            share *= s.occlusion;
            roughness = s.roughness;
            break;
        }
    }
#ifdef BACKGROUND
    if (nothing) {
        return color + share * BACKGROUND;
    }
#endif
#ifdef ENVIRONMENT
    vec3 direction = turned_back(ray.direction, frame.environment.yz);
    vec3 radiance = textureLod(environment_radiance, direction, roughness * frame.environment.w).rgb;
    return color + share * frame.environment.x * exposure() * radiance;
#else
    return color;
#endif
}

// What a view shows of the first hit, as colours between 0 and 1.
vec3 shown_of(Ray ray) {
    Hit hit = trace(ray, 0xffu, SKIP_BACKS);
#if RAY_VIEW == 4
    return heat(float(bvh_steps) * (1.0 / 128.0));
#endif
    if (hit.instance == NO_HIT) {
        return vec3(0.0);
    }
#if RAY_VIEW == 1
    float distance = hit.t * length(ray.direction);
    return vec3(distance / (distance + frame.eye.w));
#elif RAY_VIEW == 2
    return id_color(hit.instance);
#else
    return vec3(1.0 - hit.at.x - hit.at.y, hit.at);
#endif
}

void run(uvec3 id) {
    ivec2 size = imageSize(color_traced), pixel = ivec2(id.xy + tile.first.xy);
    if (any(greaterThanEqual(pixel, size))) {
        return;
    }
    vec2 uv = (vec2(pixel) + 0.5) / vec2(size);
    CameraRay seen = camera_ray(uv, frame.view_from_clip, frame.world_from_view, frame.orthographic != 0u);
    Ray ray = Ray(seen.origin, 0.0, seen.direction, FAR);
#if RAY_VIEW == 0
    vec3 reached;
    bool far;
    vec3 color = light_along(ray, reached, far);
    color = far ? fog_behind(color, uv) : fog_over(color, reached, pixel);
#else
    vec3 color = shown_of(ray);
#endif
    imageStore(color_traced, pixel, vec4(finite_color(color), 1.0));
}
