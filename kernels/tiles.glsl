// Applies lag over the sub-frames of a repeating set, and crosstalk along both axes, for one sub-pixel and a tile of
// pixels at a time. The values around the tile are computed with it, so no plane between the two is stored. The
// including shader has the arguments below. It defines the input of a pixel (`coming`) and the use of its result
// (`put`, `put_both`). BACK selects the transpose. Lag commutes with crosstalk, so it comes first in the transpose as
// well.

layout(local_size_x = TILE_THREADS) in;
// Reach of the crosstalk in pixels. BLURS is 1 if there is crosstalk, and LAGS is 1 if there is lag.
layout(constant_id = 1) const uint REACH_Y = 0;
layout(constant_id = 2) const uint REACH_X = 0;
layout(constant_id = 3) const uint BLURS = 0;
layout(constant_id = 4) const uint LAGS = 0;
const uint WIDE = TILE + 2u * REACH_X;
const uint COUNT = WIDE * (TILE + 2u * REACH_Y);

// Values of the tile and its surroundings. `drives` is the current sub-frame, `states` is carried by lag from one
// sub-frame to the next, and `blurred` holds sums along rows.
shared float drives[COUNT];
shared float states[LAGS * (COUNT - 1u) + 1u];
shared float blurred[TILE * (TILE + 2u * REACH_Y)];

// Weights along y, then along x, from the pixel `reach` before to the pixel `reach` after. They are not read without
// crosstalk.
layout(std430, binding = 0) readonly buffer Crosstalk { float weights[]; };
layout(push_constant) uniform Args {
    uint height, width, grid_height, grid_width, top, left;
    float bend_sin, bend_cos, lag;
    // The factor (1 - h) / (1 - h^frames).
    float settled;
    // Number of sub-frames, number of values from one to the next in phases and in drives, and first row of tiles.
    uint frames, phases_stride, wave_stride, first;
    MORE
};

// Returns the input of a pixel of a sub-frame.
float coming(uint frame, uint pixel);
// Receive the blurred drive of a pixel. The second function also receives the drive of the next pixel, in the same
// word.
void put(uint frame, uint pixel, float drive);
void put_both(uint frame, uint pixel, vec2 drive);

const uint NONE = 0xffffffffu;

// Returns the pixel at place i of the tile and its surroundings. The index wraps at the edge of the grid. Around the
// SLM there is no pixel.
uint pixel_of(uint i, uvec2 origin) {
    uint y = (origin.y + i / WIDE + top + grid_height - REACH_Y) % grid_height - top;
    uint x = (origin.x + i % WIDE + left + grid_width - REACH_X) % grid_width - left;
    return y < height && x < width ? y * width + x : NONE;
}

float weight_y(uint j) {
#ifdef BACK
    j = 2u * REACH_Y - j;
#endif
    return BLURS == 1u ? weights[j] : 1.0;
}

float weight_x(uint j) {
#ifdef BACK
    j = 2u * REACH_X - j;
#endif
    return BLURS == 1u ? weights[2u * REACH_Y + 1u + j] : 1.0;
}

uint ordered(uint i) {
#ifdef BACK
    return frames - 1u - i;
#else
    return i;
#endif
}

void settle(uvec2 origin) {
    for (uint i = gl_LocalInvocationID.x; i < COUNT; i += TILE_THREADS) {
        uint pixel = pixel_of(i, origin);
        precise float state = 0.0;
        if (pixel != NONE) {
            for (uint n = 0u; n < frames; n++) state = state * lag + coming(ordered(n), pixel);
        }
        states[i] = state * settled;
    }
}

void drive(uint frame, uvec2 origin) {
    for (uint i = gl_LocalInvocationID.x; i < COUNT; i += TILE_THREADS) {
        uint pixel = pixel_of(i, origin);
        precise float value = pixel != NONE ? coming(frame, pixel) : 0.0;
        if (LAGS == 1u) {
            value = (1.0 - lag) * value + lag * states[i];
            states[i] = value;
        }
        drives[i] = value;
    }
}

float along_y(uint row, uint column) {
    float sum = 0.0;
    for (uint j = 0u; j <= 2u * REACH_Y; j++) sum += weight_y(j) * blurred[(row + j) * TILE + column];
    return sum;
}

void blur(uint frame, uvec2 origin) {
    for (uint i = gl_LocalInvocationID.x; i < TILE * (TILE + 2u * REACH_Y); i += TILE_THREADS) {
        uint at = i / TILE * WIDE + i % TILE;
        float sum = 0.0;
        for (uint j = 0u; j <= 2u * REACH_X; j++) sum += weight_x(j) * drives[at + j];
        blurred[i] = sum;
    }
    barrier();
    for (uint i = gl_LocalInvocationID.x; i < TILE * TILE / 2u; i += TILE_THREADS) {
        uint row = i / (TILE / 2u), column = 2u * (i % (TILE / 2u));
        uint y = origin.y + row, x = origin.x + column, pixel = y * width + x;
        if (y >= height || x >= width) continue;
        vec2 sums = vec2(along_y(row, column), along_y(row, column + 1u));
        if (x + 1u < width && (pixel & 1u) == 0u) {
            put_both(frame, pixel, sums);
        } else {
            put(frame, pixel, sums.x);
            if (x + 1u < width) put(frame, pixel + 1u, sums.y);
        }
    }
}

void main() {
    uvec2 origin = TILE * (gl_WorkGroupID.xy + uvec2(0u, first));
    if (LAGS == 1u) settle(origin);
    for (uint n = 0u; n < frames; n++) {
        uint frame = ordered(n);
        // An invocation reads only states that it wrote. All sums of the previous sub-frame have been read here.
        barrier();
        drive(frame, origin);
        barrier();
        blur(frame, origin);
    }
}
