// Study blue-noise: the ramp, and what an image should be.

struct Asked {
    uint frames, first, steps;
    uint columns;  // 1: the transform of columns, 0: that of rows
};
PUSH(Asked, asked)

// 0 at the left, 1 at the right.
float light_at(uint column) { return (float(column) + 0.5) / float(SIZE); }

// How many frames an image of a kind sums.
float summed(uint kind) { return (kind & 1u) == 0u ? 1.0 : float(asked.frames); }

// What light 1 is in a frame: a sample is 1, a code is as many as there are steps.
float white_of(uint kind) { return kind < 2u ? 1.0 : float(asked.steps); }

// The mean square of the error of one frame, in steps: v (1 - v) over the ramp, and that of triangular noise, rounded.
float variance(uint kind) { return kind < 2u ? 1.0 / 6.0 : 0.25; }
