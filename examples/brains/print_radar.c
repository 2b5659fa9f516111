/* Prints what the virtual radar sees: a reader of vve_sumo's radar datagrams for a control computer.
 *
 *     cc -O2 -o print_radar print_radar.c -lm && ./print_radar 5005 [KEY_FILE]
 *
 * A datagram that is not valid, comes twice or too late, or is not signed with the key, is never used: lines say so instead.
 */
#include <arpa/inet.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <time.h>

#include "vve_wire.h"

int main(int count, char **arguments) {
    struct sockaddr_in here = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    struct timeval timeout = {.tv_usec = 100000};
    uint8_t data[2048], key[VVE_KEY] = {0};
    uint32_t last = 0;
    int known = 0, quiet = 0;
    vve_radar radar;

    if (count > 2 && !vve_read_key(arguments[2], key)) {
        fprintf(stderr, "%s: expected 64 hexadecimal digits\n", arguments[2]);
        return 1;
    }
    here.sin_port = htons(count > 1 ? (uint16_t)atoi(arguments[1]) : 5005);
    int end = socket(AF_INET, SOCK_DGRAM, 0);
    if (end < 0 || bind(end, (struct sockaddr *)&here, sizeof here) < 0) {
        perror("print_radar");
        return 1;
    }
    setsockopt(end, SOL_SOCKET, SO_RCVTIMEO, &timeout, sizeof timeout);
    setvbuf(stdout, NULL, _IOLBF, 0);
    for (;;) {
        ssize_t length = recv(end, data, sizeof data, 0);
        if (length < 0) {
            if (known && !quiet) puts("silent: no datagram for 100 ms");
            quiet = 1;
            continue;
        }
        quiet = 0;
        if (count > 2 && !(length = (ssize_t)vve_without_tag(data, (size_t)length, key))) {
            puts("refused: not signed with the key");
            continue;
        }
        if (!vve_read_radar(data, (size_t)length, &radar)) {
            puts("refused: not a radar datagram of this version, or not whole");
            continue;
        }
        if (known && (int32_t)(radar.head.sequence - last) <= 0) {
            puts("refused: not newer than the last");
            continue;
        }
        known = 1;
        last = radar.head.sequence;
        if (!(radar.head.flags & VVE_VALID)) {
            printf("%u invalid\n", last);
            continue;
        }
        printf("%u %.3f s, scan %.3f s old, %.2f m/s:", last, radar.time_s, radar.time_s - radar.measured_s,
               (double)radar.speed_mps);
        for (uint32_t n = 0; n < radar.targets; n++)
            printf(" [%u] %.1f m %.3f rad %.2f m/s", (unsigned)radar.target[n].number, (double)radar.target[n].range_m,
                   (double)radar.target[n].azimuth_rad, (double)radar.target[n].range_rate_mps);
        putchar('\n');
    }
}
