// The overlay, one box, sphere or frustum for each instance of the draw; SHAPE says which. A vertex follows from its
// number alone: there are no vertex buffers. Six vertices are a line, a rectangle of WIDTH pixels: devices differ in how
// they draw lines, and not all draw any but the narrowest.

#define SHAPE_BOXES 0
#define SHAPE_SPHERES 1
#define SHAPE_FRUSTUM 2
#define SHAPE_PYRAMID 3

#include "culling/overlay.glsl"
#include "culling/records.glsl"
#include "culling/tests.glsl"

const vec3 GREEN = vec3(0.2, 1.0, 0.2), RED = vec3(1.0, 0.15, 0.1), ORANGE = vec3(1.0, 0.55, 0.0),
           VIOLET = vec3(0.75, 0.35, 1.0), YELLOW = vec3(1.0, 0.95, 0.1);

const float WIDTH = 1.4;
const vec4 OUTSIDE = vec4(2.0, 2.0, 2.0, 1.0);  // of the picture

layout(location = 0) flat out vec4 out_color;

// A line in the world; without a colour nothing is drawn.
struct Line {
    vec3 from;
    vec3 to;
    vec3 color;
};
const Line NOTHING = Line(vec3(0.0), vec3(0.0), vec3(0.0));

// The end of an edge of a box, -1 or 1 along each axis: four edges for each axis.
vec3 box_corner(uint edge, uint end) {
    uint axis = edge / 4u;
    vec3 corner;
    corner[axis] = float(end);
    corner[(axis + 1u) % 3u] = float(edge & 1u);
    corner[(axis + 2u) % 3u] = float((edge >> 1) & 1u);
    return 2.0 * corner - 1.0;
}

// The end of a line of one of three circles around a sphere of radius 1.
vec3 circle_point(uint line, uint end) {
    uint axis = line / SEGMENTS;
    float angle = 6.2831853 * float((line + end) % SEGMENTS) / float(SEGMENTS);
    vec3 point = vec3(0.0);
    point[(axis + 1u) % 3u] = cos(angle);
    point[(axis + 2u) % 3u] = sin(angle);
    return point;
}

// Whether the frame sees an instance: the flag that the kernels wrote.
bool is_seen(uint number) {
#ifdef TESTED
    return (visible[number] & 1u) != 0u;
#else
    return true;
#endif
}

Line box_line(uint number, uint line) {
    Instance instance = instance_of(number);
    if ((instance.flags & INSTANCE_VISIBLE) == 0u) {
        return NOTHING;
    }
    vec3 centre = instance.bounds_centre.xyz, extent = instance.bounds_extent.xyz;
    return Line(
        centre + box_corner(line, 0u) * extent, centre + box_corner(line, 1u) * extent, is_seen(number) ? GREEN : RED
    );
}

// The colour tells which test left a meshlet out. The tests are made again here: the kernels keep a bit for each meshlet,
// which does not say why.
vec3 sphere_color(Sphere sphere, Instance instance) {
    if (CULLING >= 1 && (sphere.flags & WHOLE) == 0u) {
        Bounds bounds = bounds_of_meshlet(instance, sphere.sphere, sphere.extent);
        if (outside(bounds)) {
            return RED;
        }
        if (CULLING >= 2 && (sphere.flags & TWO_SIDED) == 0u
            && faces_away(instance.world_from_object, bounds, sphere.cone, sphere.sphere)) {
            return VIOLET;
        }
#if CULLING >= 3
        if (hidden(bounds)) {
            return ORANGE;
        }
#endif
    }
    return GREEN;
}

Line sphere_line(uint number, uint line) {
    Sphere sphere = spheres[number];
    if (!is_seen(sphere.instance)) {
        return NOTHING;  // its meshlets are not tested
    }
    Instance instance = instance_of(sphere.instance);
    vec4 world = instance.bounds_centre;
    if ((sphere.flags & WHOLE) == 0u) {
        mat3x4 placed = instance.world_from_object;
        world = vec4(transform_point(placed, sphere.sphere.xyz), sphere.sphere.w * stretch_bound(placed));
    }
    return Line(
        world.xyz + world.w * circle_point(line, 0u), world.xyz + world.w * circle_point(line, 1u),
        sphere_color(sphere, instance)
    );
}

// A corner of the frustum of culling. One without an end is shown up to a quarter of the scene's diagonal.
vec3 frustum_corner(vec3 corner) {
    float far_depth = view.orthographic != 0u ? 0.0 : view.near / (0.5 * view.eye.w);
    vec4 in_view = view.view_from_clip * vec4(corner.xy, corner.z < 0.0 ? far_depth : 1.0, 1.0);
    return (view.world_from_view * vec4(in_view.xyz / in_view.w, 1.0)).xyz;
}

Line line_of(uint number, uint line) {
#if SHAPE == SHAPE_BOXES
    return box_line(number, line);
#elif SHAPE == SHAPE_SPHERES
    return sphere_line(number, line);
#else
    return Line(frustum_corner(box_corner(line, 0u)), frustum_corner(box_corner(line, 1u)), YELLOW);
#endif
}

// How far one has to go from `from` towards `to` to be inside of the view, as a fraction of the way: 0 if `from` is
// inside, and above 1 if nothing of the line is. A line has to be clipped before it gets its width.
float way_inside(vec4 from, vec4 to) {
    float way = 0.0;
    for (int plane = 0; plane < 5; ++plane) {
        vec2 distances = plane == 4 ? vec2(from.w - from.z, to.w - to.z)
                       : plane < 2  ? vec2(from.w, to.w) + (plane == 0 ? 1.0 : -1.0) * vec2(from.x, to.x)
                                    : vec2(from.w, to.w) + (plane == 2 ? 1.0 : -1.0) * vec2(from.y, to.y);
        if (distances.x < 0.0) {
            way = distances.y < 0.0 ? 2.0 : max(way, distances.x / (distances.x - distances.y));
        }
    }
    return way;
}

// A corner of a line's rectangle: at one of its ends, to one of its sides (-1 or 1).
vec4 corner_of(Line line, uint end, float side) {
    vec4 from = clip_position(frame.clip_from_view, frame.view_from_world, line.from);
    vec4 to = clip_position(frame.clip_from_view, frame.view_from_world, line.to);
    float way_from = way_inside(from, to), way_to = way_inside(to, from);
    if (way_from + way_to >= 1.0) {
        return OUTSIDE;
    }
    vec4 begin = mix(from, to, way_from), finish = mix(to, from, way_to);
    vec2 along = (finish.xy / finish.w - begin.xy / begin.w) * frame.size.xy;
    float pixels = length(along);
    if (!(pixels > 0.0)) {
        return OUTSIDE;
    }
    vec4 place = end == 0u ? begin : finish;
    place.xy += vec2(-along.y, along.x) / pixels * side * WIDTH * frame.size.zw * place.w;
    // Boxes often end in the plane of a surface: their lines are a little nearer. Faint ones are nearer than anything.
    place.z = OPACITY < 1.0 ? place.w : min(1.0005 * place.z, place.w);
    return place;
}

void main() {
    uint number = uint(INSTANCE_ID), vertex = uint(VERTEX_ID);
#if SHAPE == SHAPE_PYRAMID
    out_color = vec4(0.0);
    gl_Position = vec4(4.0 * float(vertex & 1u) - 1.0, 2.0 * float(vertex & 2u) - 1.0, 1.0, 1.0);
#else
    uint corner = vertex % 6u;
    uint end = corner == 1u || corner == 2u || corner == 4u ? 1u : 0u;
    Line line = line_of(number, vertex / 6u);
    out_color = vec4(stored(line.color), OPACITY);
    gl_Position = OUTSIDE;
    if (line.color != vec3(0.0) && are_moderate(line.from) && are_moderate(line.to)) {
        gl_Position = corner_of(line, end, corner == 2u || corner > 3u ? 1.0 : -1.0);
    }
#endif
}
