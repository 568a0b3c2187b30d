// What `contrast_rows` and `compare_contrast` share: their arguments, and the difference of contrast.

layout(push_constant) uniform Args {
    uint rows, columns, reach_y, reach_x, mode;
    float exposure, weight, low, limit, dark;
    uint first_y, first_x;
    float gaze_y, gaze_x, away_y, away_x, middle, coarse;
};

float difference(float seen, float wanted) { return (exposure * seen - wanted) / (wanted + dark); }

// How much of its square counts unfiltered in pixel (y, x).
float sharp(uint y, uint x) {
    vec2 place = vec2(float((y + first_y) % rows), float((x + first_x) % columns));
    vec2 away = (place - vec2(gaze_y, gaze_x)) * vec2(away_y, away_x);
    return clamp((1.0 / (middle + length(away)) - coarse) / (1.0 - coarse), 0.0, 1.0);
}

bool has_gaze() { return away_y != 0.0 || away_x != 0.0; }
