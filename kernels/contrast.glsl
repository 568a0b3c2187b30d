// What `contrast_rows` and `compare_contrast` share: their arguments, and the difference of contrast.

layout(push_constant) uniform Args {
    uint rows, columns, reach_y, reach_x, mode;
    float exposure, weight, low, limit, dark, gaze_y, gaze_x, falloff_y, falloff_x;
};

float difference(float seen, float wanted) { return (exposure * seen - wanted) / (wanted + dark); }

// What it counts by in pixel (y, x).
float counts(uint y, uint x) {
    if (falloff_y == 0.0 && falloff_x == 0.0) return 1.0;
    vec2 away = vec2((float(y) - gaze_y) * falloff_y, (float(x) - gaze_x) * falloff_x);
    return exp(-length(away));
}
