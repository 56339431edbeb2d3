// Study phong: what both of its shaders read of a frame.

struct Light {
    vec4 place;    // in the object's space
    vec4 color;    // exposed
    vec4 axis;     // away from the light
    vec4 cosines;  // x: of the angle where the light has ended, y: of that where it begins to fade
};

layout(BIND(0, 0, 0), std140) uniform Frame_ {
    mat4 view_from_object;
    mat4 clip_from_view;
    vec4 base_color;
    vec4 eye;          // w = 0: a direction, infinitely far
    vec4 surface;      // ambient, specular, shininess
    vec4 attenuation;  // constant, linear, quadratic
    Light lights[2];
} frame;
