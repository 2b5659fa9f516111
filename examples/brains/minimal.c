/* The least that a brain is, in C: the radar datagram in, a setpoint out. The same as minimal.py beside it.
 *
 *     cc -o minimal minimal.c -lm && ./minimal [RADAR_PORT SETPOINT_PORT [KEY_FILE]]
 */
#include <arpa/inet.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/socket.h>

#include "vve_wire.h"

int main(int count, char **words) {
    struct sockaddr_in here = {.sin_family = AF_INET, .sin_port = htons(count > 2 ? atoi(words[1]) : 5002)};
    struct sockaddr_in there = {.sin_family = AF_INET, .sin_port = htons(count > 2 ? atoi(words[2]) : 5003)};
    here.sin_addr.s_addr = there.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    const int wire = socket(AF_INET, SOCK_DGRAM, 0);
    if (wire < 0 || bind(wire, (struct sockaddr *)&here, sizeof here) < 0) {
        perror("the radar's port");
        return 1;
    }
    uint8_t data[2048], key[VVE_KEY] = {0};
    const int has_key = count > 3;
    if (has_key && !vve_read_key(words[3], key)) {
        fprintf(stderr, "%s: expected 64 hexadecimal digits\n", words[3]);
        return 1;
    }
    vve_radar radar;
    uint32_t newest = 0;
    for (;;) {
        const ssize_t came = recv(wire, data, sizeof data, 0);
        if (came < 0) continue;
        const size_t length = has_key ? vve_without_tag(data, (size_t)came, key) : (size_t)came;
        if (!vve_read_radar(data, length, &radar)) continue;
        /* An invalid or an old datagram, or an old scan, has no answer, and the gateway stops the car. */
        if (!vve_fresh(&radar) || radar.head.sequence <= newest) continue;
        newest = radar.head.sequence;
        float ahead = INFINITY;
        for (uint32_t n = 0; n < radar.targets; n++) {
            const vve_target *seen = &radar.target[n];
            if (fabsf(seen->range_m * sinf(seen->azimuth_rad)) < 1.5f) ahead = fminf(ahead, seen->range_m);
        }
        const float wanted = ahead < 20.0f ? -3.0f : fmaxf(-1.0f, fminf(1.0f, 5.0f - radar.speed_mps));
        vve_setpoint answer = {.time_s = radar.time_s, .acceleration_mps2 = wanted, .answers = newest};
        answer.head.sequence = newest;
        answer.head.lifetime_us = 100000;
        if (!vve_write_setpoint(data, &answer)) continue;
        const size_t size = has_key ? vve_sign(data, VVE_SETPOINT_LENGTH, key) : VVE_SETPOINT_LENGTH;
        sendto(wire, data, size, 0, (struct sockaddr *)&there, sizeof there);
    }
}
