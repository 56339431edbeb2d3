// Weights of samples that several strategies could have made (Veach 1997, "Robust Monte Carlo Methods for Light Transport
// Simulation", section 9.2).

// The power heuristic with exponent 2, a^2 / (a^2 + b^2), for a sample of the strategy with density `a` that the other
// one has with density `b`. The two weights of a pair sum to 1, whatever the densities: infinity (a direction that only
// a light without size has) takes all, and two zeros or two infinities share. The larger density is divided out before
// squares overflow. Above 1e37 densities count as equal, since their reciprocal would be below the smallest float that
// every device has.
float power_heuristic(float a, float b) {
    float p = min(a, 1e37), q = min(b, 1e37);
    float larger = max(p, q);
    if (!(larger >= 1.2e-38)) {
        return 0.5;
    }
    float x = p / larger, y = q / larger;
    return x * x / (x * x + y * y);
}
