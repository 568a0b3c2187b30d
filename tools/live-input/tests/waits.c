/* Tests the waits of eyebox_live.h while the other side sends bytes every 10 ms without news. Each must end in time. */
#include "eyebox_live.h"
#include <sys/types.h>
#include <sys/wait.h>

int main(void) {
    int ends[2], status;
    eyebox_live live;
    eyebox_live_memory memory;
    memset(&live, 0, sizeof live);
    if (socketpair(AF_UNIX, SOCK_STREAM, 0, ends)) return 10;
    live.socket = ends[0], live.newest = live.writing = -1, live.slots = 3, live.length = 8192;
    live.region = (uint8_t *)calloc(1, (size_t)live.length);
    if (!live.region) return 11;
    /* The display offers memory of a device, and gives none. */
    *eyebox_live_word(&live, 104) = 1;
    pid_t other = fork();
    if (other == 0) {
        for (int i = 0; i < 3000; i++) {
            send(ends[1], "", 1, MSG_DONTWAIT | MSG_NOSIGNAL);
            poll(NULL, 0, 10);
        }
        _exit(0);
    }
    int64_t begun = eyebox_live_now_ms();
    if (eyebox_live_wait(&live, 300) != 0) return 12;
    if (eyebox_live_now_ms() - begun < 300) return 13;
    if (waitpid(other, &status, WNOHANG) != 0) return 14;
    if (eyebox_live_wait(&live, 0) != 0) return 15;
    if (eyebox_live_share(&live, &memory, 300) != -1) return 16;
    if (waitpid(other, &status, WNOHANG) != 0) return 17;
    /* News ends the wait immediately. */
    *eyebox_live_word(&live, 200) = 7, *eyebox_live_word(&live, 192) = 2;
    if (eyebox_live_wait(&live, -1) != 1) return 18;
    close(ends[0]);
    close(ends[1]);
    return 0;
}
