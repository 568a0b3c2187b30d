// The data of each pupil for kernels over several pupils. The including shader defines PUPILS, the binding of the
// table. One of its arguments is `members`, the pupils of a dispatch (z).

struct Pupil {
    // Window in the grid, and the columns of the window that are in use.
    uint y0, x0, rows, columns;
    uint first, used;
    // Start of its range in each buffer, in values. The windows of sub-frames are `window_stride` apart.
    uint window, window_stride, transfer, pixels, accumulator, losses;
    // Start of its range in each table, in entries.
    uint spans, row_weights, column_weights, row_taps, column_taps;
    // Size of the level from which its target image comes.
    uint level_height, level_width;
    // Arguments of `pass_pupil`, `pupil_adjoint` and `intensity`.
    float pass_scale, back_scale, gain;
    // Arguments of `compare`.
    uint mode;
    float exposure, weight, low, limit;
    // Arguments of `transfer`, each float64 as (high, low).
    float slope_y, slope_y_low, slope_x, slope_x_low, turns, turns_low, shift_y, shift_y_low, shift_x, shift_x_low;
    int bin_y, bin_x;
};

layout(std430, binding = PUPILS) readonly buffer Pupils { Pupil pupils[]; };
