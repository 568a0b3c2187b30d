// Shows a hologram on a display of the program, with one video frame per tick, and refines it for the tracked pupil.
// Build and run it with this command.
//     cc session.c $(pkg-config --cflags --libs eyebox) -lm -o session && ./session 256 60
#define _POSIX_C_SOURCE 199309L
#include "eyebox.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#define DO(call)                                                                                                       \
    do {                                                                                                               \
        if ((call) != EYEBOX_STATUS_OK) {                                                                              \
            fprintf(stderr, "session: %s\n", eyebox_last_error());                                                     \
            exit(2);                                                                                                   \
        }                                                                                                              \
    } while (0)

int main(int argc, char **argv) {
    size_t size = argc > 1 ? (size_t)atoi(argv[1]) : 256;
    char settings[64];
    snprintf(settings, sizeof settings, "frames = 8\nsteps = %s", argc > 2 ? argv[2] : "60");
    const double rate_hz = 60.0;

    EyeboxDisplay *preset, *display;
    EyeboxEngine *engine;
    EyeboxScene *scene;
    EyeboxHologram *hologram;
    EyeboxSession *session;
    DO(eyebox_display_load("planes8", &preset));
    DO(eyebox_display_resized(preset, size, size, &display));
    DO(eyebox_engine_open("cpu", &engine));
    DO(eyebox_scene_load("builtin:still-life", display, EYEBOX_GREEN, 0, &scene));
    DO(eyebox_solve(scene, display, settings, engine, NULL, NULL, &hologram));
    DO(eyebox_session_follow(hologram, scene, display, NULL, engine, rate_hz, &session));

    EyeboxVideo video;
    DO(eyebox_session_video(session, &video));
    void *picture = malloc(video.bytes);
    if (!picture) return 2;
    EyeboxFrame frame;
    EyeboxAccount account;
    int ticks = 0;
    do { // The simulated eye moves in a circle. The loop ends after ten refined sets, or after 30 s.
        EyeboxSample sample = {3e-3 * cos(ticks * 0.05), 3e-3 * sin(ticks * 0.05), 4e-3, 0.0};
        DO(eyebox_session_look(session, &sample));
        DO(eyebox_session_tick(session, 1.0 / rate_hz, picture, video.bytes, &frame));
        if (!frame.shown) break;
        // A real program gives the picture to its display here. This one waits for the next video frame.
        struct timespec period = {0, (long)(1e9 / rate_hz)};
        nanosleep(&period, NULL);
        DO(eyebox_session_account(session, &account));
    } while (account.sets_new < 10 && ++ticks < 30 * rate_hz);
    printf("%zu x %zu x %zu bytes per video frame; %llu sets refined\n", video.rows, video.columns, video.channels,
           (unsigned long long)(frame.set >= 0 ? account.sets_new : 0));

    free(picture);
    eyebox_session_free(session);
    eyebox_hologram_free(hologram);
    eyebox_scene_free(scene);
    eyebox_engine_free(engine);
    eyebox_display_free(display);
    eyebox_display_free(preset);
    return 0;
}
