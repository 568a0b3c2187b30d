// What kernels over several pupils know of each: a shader defines PUPILS, the binding of the table, and has `members` among
// its arguments, the pupils of a dispatch (z).

struct Pupil {
    // Its window in the grid; of its columns those in use.
    uint y0, x0, rows, columns;
    uint first, used;
    // Where its buffers start, in values; the windows of sub-frames are a stride apart.
    uint window, window_stride, transfer, pixels, accumulator, losses;
    // Where its tables start, in values of theirs.
    uint spans, row_weights, column_weights, row_taps, column_taps;
    // The level of its photograph.
    uint level_height, level_width;
    // Of `pass_pupil`, `pupil_adjoint` and `intensity`.
    float pass_scale, back_scale, gain;
    // Of `compare`.
    uint mode;
    float exposure, weight, low, limit;
    // Of `transfer`: each float64 as (high, low).
    float slope_y, slope_y_low, slope_x, slope_x_low, turns, turns_low, shift_y, shift_y_low, shift_x, shift_x_low;
    int bin_y, bin_x;
};

layout(std430, binding = PUPILS) readonly buffer Pupils { Pupil pupils[]; };
