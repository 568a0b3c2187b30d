/* Sends the gaze of a Varjo headset to eyebox, with the focus that the headset measures.
 *
 *   Windows, with Varjo's native SDK:  cl varjo.c /I SDK\include SDK\lib\VarjoLib.lib ws2_32.lib
 *   Without a headset, anywhere:       cc -DSIMULATE varjo.c -lm -o varjo && ./varjo 127.0.0.1 9123 100
 *
 * The arguments are host, port and the number of samples (0 to run until stopped). The program follows the SDK's
 * documentation and is not yet tested on a headset. docs/trackers.md defines the keys. Angles are in degrees to the
 * right and down, diameters in millimeters, and the focus in dioptres. */

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#ifdef _WIN32
#include <winsock2.h>
#include <windows.h>
#define wait_ms(ms) Sleep(ms)
#else
#include <arpa/inet.h>
#include <sys/socket.h>
#include <time.h>
static void wait_ms(long ms) { struct timespec t = {0, ms * 1000000L}; nanosleep(&t, NULL); }
#endif

struct eye { double right, up, forward; int valid; };
struct sample { double seconds, focus_d; struct eye left, right; };

#ifdef SIMULATE
static int begin(void) { return 0; }
static int take(struct sample *s) {
    static int i;
    double x = 0.1 * sin(i * 0.01), half = 0.063 / 2;
    struct eye left = {x + half, 0, 1, 1}, right = {x - half, 0, 1, 1};
    s->seconds = i++ * 0.01, s->focus_d = 1, s->left = left, s->right = right;
    return 1;
}
#else
#include <Varjo.h>
#include <Varjo_gaze.h>
static struct varjo_Session *session;
static int begin(void) {
    if (!varjo_IsAvailable()) return fprintf(stderr, "varjo: its software is not running\n"), 1;
    session = varjo_SessionInit();
    if (!session) return fprintf(stderr, "varjo: no session\n"), 1;
    varjo_GazeInit(session);
    return 0;
}
static struct eye of(struct varjo_Ray ray, int valid) {
    /* The axes are right, up, forward. */
    struct eye eye = {ray.forward[0], ray.forward[1], ray.forward[2], valid};
    return eye;
}
static int take(struct sample *s) {
    static varjo_Nanoseconds last;
    struct varjo_Gaze gaze = varjo_GetGaze(session);
    if (gaze.captureTime == last) return 0;
    last = gaze.captureTime;
    s->seconds = gaze.captureTime * 1e-9;
    s->focus_d = gaze.status == varjo_GazeStatus_Valid && gaze.focusDistance > 0 ? 1 / gaze.focusDistance : NAN;
    s->left = of(gaze.leftEye, gaze.leftStatus >= varjo_GazeEyeStatus_Compensated);
    s->right = of(gaze.rightEye, gaze.rightStatus >= varjo_GazeEyeStatus_Compensated);
    return 1;
}
#endif

static int write_eye(char *to, size_t size, const char *name, struct eye e) {
    double degrees = 180 / acos(-1);
    if (!e.valid || e.forward <= 0) return snprintf(to, size, ", \"%s\": {\"valid\": false}", name);
    return snprintf(to, size, ", \"%s\": {\"what\": \"gaze\", \"unit\": \"deg\", \"x\": %.4f, \"y\": %.4f}", name,
                    atan2(e.right, e.forward) * degrees, atan2(-e.up, e.forward) * degrees);
}

int main(int count, char **arguments) {
    struct sockaddr_in to;
    long left = count > 3 ? atol(arguments[3]) : 0;
    int forever = left == 0;
#ifdef _WIN32
    WSADATA started;
    if (WSAStartup(MAKEWORD(2, 2), &started)) return 1;
#endif
    memset(&to, 0, sizeof to);
    to.sin_family = AF_INET;
    to.sin_addr.s_addr = inet_addr(count > 1 ? arguments[1] : "127.0.0.1");
    to.sin_port = htons((unsigned short)(count > 2 ? atoi(arguments[2]) : 9123));
    if (begin()) return 1;
    int out = (int)socket(AF_INET, SOCK_DGRAM, 0);
    while (forever || left > 0) {
        struct sample s;
        wait_ms(5);
        if (!take(&s)) continue;
        char line[512];
        int n = snprintf(line, sizeof line, "{\"t\": %.6f", s.seconds);
        if (isfinite(s.focus_d)) n += snprintf(line + n, sizeof line - n, ", \"focus_d\": %.3f", s.focus_d);
        n += write_eye(line + n, sizeof line - n, "left", s.left);
        n += write_eye(line + n, sizeof line - n, "right", s.right);
        n += snprintf(line + n, sizeof line - n, "}");
        sendto(out, line, n, 0, (struct sockaddr *)&to, sizeof to);
        left -= 1;
    }
    return 0;
}
