// Study torus-knot, fragments: a lamp beside the camera, and a colour that goes once around with the knot.

layout(location = 0) in vec3 in_position;
layout(location = 1) in vec3 in_normal;
layout(location = 2) in vec2 in_place;
layout(location = 0) out vec4 out_color;

void main() {
    vec3 normal = normalize(in_normal), eye = normalize(-in_position), lamp = normalize(vec3(-0.5, 0.7, 0.9));
    vec3 color = 0.55 + 0.35 * cos(6.2831853 * (in_place.x + vec3(0.0, 0.33, 0.67)));
    float diffuse = max(dot(normal, lamp), 0.0), shine = pow(max(dot(normal, normalize(lamp + eye)), 0.0), 40.0);
    out_color = vec4(color * (0.12 + 0.88 * diffuse) + 0.4 * shine, 1.0);
}
