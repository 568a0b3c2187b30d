/* Solves a built-in scene, renders it through a pupil, and encodes it for the SLM. Build and run it with this command.
       cc solve.c $(pkg-config --cflags --libs eyebox) -o solve && ./solve 256 60 */
#include "eyebox.h"
#include <stdio.h>
#include <stdlib.h>

static void check(EyeboxStatus status) {
    if (status != EYEBOX_STATUS_OK) {
        fprintf(stderr, "solve: %s\n", eyebox_last_error());
        exit(2);
    }
}

static int32_t tell(const EyeboxStep *step, void *user) {
    int *told = user;
    if (step->pilot_steps == 0) {
        printf("step %zu of %zu: loss %.2e\n", step->step, step->steps, step->loss);
        ++*told;
    }
    return 0; /* Any other value ends the solve with the best result until now. */
}

int main(int argc, char **argv) {
    size_t size = argc > 1 ? strtoul(argv[1], NULL, 10) : 256;
    char settings[64];
    snprintf(settings, sizeof settings, "frames = 8\nsteps = %s\nseed = 1", argc > 2 ? argv[2] : "60");
    if (eyebox_interface() != EYEBOX_INTERFACE) {
        fprintf(stderr, "solve: compiled for another eyebox\n");
        return 2;
    }

    EyeboxDisplay *preset, *display;
    check(eyebox_display_load("planes8", &preset));
    check(eyebox_display_resized(preset, size, size, &display));
    EyeboxEngine *engine;
    check(eyebox_engine_open("cpu", &engine));
    EyeboxScene *scene;
    check(eyebox_scene_load("builtin:still-life", display, EYEBOX_GREEN, 0, &scene));
    EyeboxHologram *hologram;
    int told = 0;
    check(eyebox_solve(scene, display, settings, engine, tell, &told, &hologram));

    EyeboxSize sizes;
    check(eyebox_hologram_size(hologram, &sizes));
    size_t count = sizes.colors * sizes.picture_rows * sizes.picture_columns;
    float *light = malloc(count * sizeof *light);
    EyeboxPupil pupil = {.x_m = 2e-3, .y_m = 0.0, .diameter_m = 4e-3, .depth_m = 1e-3};
    check(eyebox_view(hologram, &pupil, NULL, engine, light, count));
    double sum = 0.0;
    for (size_t i = 0; i < count; ++i)
        sum += light[i];
    EyeboxScore score;
    check(eyebox_score(hologram, scene, &pupil, 1, NULL, engine, &score));
    printf("mean light %.3f, %.1f dB after %d steps\n", sum / (double)count, score.psnr_db, told);

    EyeboxEncoder *encoder;
    EyeboxVideo video;
    check(eyebox_encoder_new(display, EYEBOX_GREEN, sizes.frames, &encoder));
    check(eyebox_encoder_video(encoder, &video));
    unsigned char *bytes = malloc(video.bytes);
    check(eyebox_encode(encoder, hologram, bytes, video.bytes));
    printf("%zu video frames of %zu x %zu x %zu bytes\n", video.frames, video.rows, video.columns, video.channels);

    free(bytes);
    free(light);
    eyebox_encoder_free(encoder);
    eyebox_hologram_free(hologram);
    eyebox_scene_free(scene);
    eyebox_engine_free(engine);
    eyebox_display_free(display);
    eyebox_display_free(preset);
    return 0;
}
