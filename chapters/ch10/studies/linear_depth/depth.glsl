// Study linear-depth: distance from depth, and depth as clip coordinates from distance, for both directions of Z.

struct Push {
    vec4 lamp;  // tangents of half the angles across and down; metres to the near and to the far plane
};
PUSH(Push, push)

// The z of clip coordinates whose w is the distance `z` along the axis.
float clip_depth(float z, bool standard) {
    float near = push.lamp.z, far = push.lamp.w;
    precise float clip = standard ? far * (z - near) / (far - near) : near * (far - z) / (far - near);
    return clip;
}

// Metres along the axis. Both denominators are near * far / z.
float distance_of(float depth, bool standard) {
    float near = push.lamp.z, far = push.lamp.w;
    precise float z = near * far / (standard ? far - depth * (far - near) : near + depth * (far - near));
    return z;
}
