/* Sends a bright ball that moves, as color and depth: cc -O2 -I.. ball.c -o ball && ./ball NAME [FRAMES] */
#include "eyebox_live.h"

int main(int count, char **words) {
    eyebox_live live;
    eyebox_live_request_t asked;
    uint64_t depth, left = count > 2 ? strtoull(words[2], NULL, 10) : UINT64_MAX;
    if (count < 2 || eyebox_live_connect(&live, words[1])) return fprintf(stderr, "ball: %s\n", count < 2 ? "the name is missing" : live.error), 2;
    while (left) {
        int news = eyebox_live_wait(&live, 1000);
        if (news < 0) return fprintf(stderr, "ball: %s\n", live.error), 3;
        if (!news || !eyebox_live_request(&live, &asked)) continue;
        eyebox_live_frame frame = {.kind = EYEBOX_LIVE_COLOR_AND_DEPTH, .sample = EYEBOX_LIVE_U8, .transfer = EYEBOX_LIVE_SRGB};
        frame.request = asked.number, frame.content_time_ns = asked.lit_ns;
        uint8_t *samples = eyebox_live_begin(&live, &frame);
        if (!samples) return fprintf(stderr, "ball: %s\n", live.error), 2;
        eyebox_live_bytes(&live, &frame, &depth);
        float *dioptres = (float *)(void *)(samples + depth), radius = live.rows / 4.0f;
        /* The ball moves by 4 pixels against the background between the two sides of the eyebox. */
        float near = (float)(4 * live.pixel_angle / (live.eyebox_width_mm * 1e-3));
        float x = (float)(asked.lit_ns / 1000000 % 2000) / 2000 * live.columns, y = live.rows / 2.0f;
        for (uint32_t i = 0; i < live.rows * live.columns; i++) {
            float dx = i % live.columns - x, dy = i / live.columns - y;
            int ball = dx * dx + dy * dy < radius * radius;
            memset(samples + i * live.channels, ball ? 255 : 32, live.channels);
            dioptres[i] = ball ? near : 0.0f;
        }
        eyebox_live_publish(&live);
        left--;
    }
    return eyebox_live_close(&live), 0;
}
