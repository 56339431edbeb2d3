// Adaptation: a state that follows a target with a time constant, the same at any frame rate.

// The value after `dt` seconds on the way from `previous` to `target` with time constant `tau` in seconds; 0 is at once.
// The remaining distance falls as exp(-t / tau), so two steps give the same as one of their length.
float approached(float previous, float target, float tau, float dt) {
    float left = tau > 0.0 ? exp(-dt / tau) : 0.0;
    return target + (previous - target) * left;
}

// The same by the cookbook's factor (Kosarevsky, Latypov 2021, chapter 8): 0.98^(dt * speed), with `dt` in milliseconds.
// Its step has dt = 30 in every frame. The time constant is 49.5 ms / speed.
float adapted(float previous, float target, float speed, float dt) {
    return previous + (target - previous) * (1.0 - pow(0.98, dt * speed));
}
