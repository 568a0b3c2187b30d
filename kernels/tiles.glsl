// Lag over the sub-frames of a set that repeats and crosstalk along both axes, of one sub-pixel, a tile of pixels at a time: what
// lies around the tile comes with it, and no plane between the two is stored. A shader has the arguments below, and says what
// comes in (`coming`) and what becomes of a pixel (`put`, `put_both`). With BACK transposed: lag commutes with crosstalk, so that
// it stands first here, too.

layout(local_size_x = TILE_THREADS) in;
// Pixels that crosstalk reaches, whether there is any, and whether there is lag.
layout(constant_id = 1) const uint REACH_Y = 0;
layout(constant_id = 2) const uint REACH_X = 0;
layout(constant_id = 3) const uint BLURS = 0;
layout(constant_id = 4) const uint LAGS = 0;
const uint WIDE = TILE + 2u * REACH_X;
const uint COUNT = WIDE * (TILE + 2u * REACH_Y);

// Of the tile and what is around it: this sub-frame's, what lag keeps from one to the next, and sums along rows.
shared float drives[COUNT];
shared float states[LAGS * (COUNT - 1u) + 1u];
shared float blurred[TILE * (TILE + 2u * REACH_Y)];

// Along y, then along x, from the pixel `reach` before its own to that behind it; anything where nothing is blurred.
layout(std430, binding = 0) readonly buffer Crosstalk { float weights[]; };
layout(push_constant) uniform Args {
    uint height, width, grid_height, grid_width, top, left;
    float bend_sin, bend_cos, lag;
    // (1 - h) / (1 - h^frames)
    float settled;
    // Values from one sub-frame to the next, of phases and of drives; the first row of tiles.
    uint frames, phases_stride, wave_stride, first;
    MORE
};

// What a pixel of a sub-frame is driven with.
float coming(uint frame, uint pixel);
// Its drive, blurred; and the next one's, which lies in the same word.
void put(uint frame, uint pixel, float drive);
void put_both(uint frame, uint pixel, vec2 drive);

const uint NONE = 0xffffffffu;

// The pixel at a place of the tile and its surroundings; what is beyond the grid's edge is on its other side, and around the SLM
// there is none.
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
        // Each invocation reads what it wrote of the states; the sums of the sub-frame before have been read.
        barrier();
        drive(frame, origin);
        barrier();
        blur(frame, origin);
    }
}
