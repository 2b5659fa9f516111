/* Datagrams of vve_sumo, version 1: the virtual radar to a control computer (kind 1), its setpoint back (kind 2).
 *
 * Little endian; every field lies at a multiple of its size, so these structs need no packing. The last four bytes of a
 * datagram are the CRC-32 (of Ethernet and zlib) of all before. docs/brains.md gives each field's meaning.
 *
 * Where the rig names a key, VVE_TAG bytes follow, the first of the HMAC-SHA-256 of all before: take them off with
 * vve_without_tag before a datagram is read, and add them with vve_sign to one that is written.
 */
#ifndef VVE_WIRE_H
#define VVE_WIRE_H

#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

enum { VVE_VERSION = 1, VVE_RADAR = 1, VVE_SETPOINT = 2, VVE_VALID = 1, VVE_EMERGENCY = 1, VVE_MAX_TARGETS = 64 };

typedef struct {
    char magic[4];        /* "VVES" */
    uint8_t version;      /* VVE_VERSION */
    uint8_t kind;         /* VVE_RADAR or VVE_SETPOINT */
    uint16_t flags;       /* radar: VVE_VALID; setpoint: VVE_EMERGENCY */
    uint32_t sequence;    /* radar: counts ticks up, with gaps for skipped ones; setpoint: counts up */
    uint32_t lifetime_us; /* not to be acted on for longer: radar: after its time_s; setpoint: after its arrival */
} vve_head;

typedef struct {
    float range_m;         /* from the middle of the front bumper */
    float azimuth_rad;     /* left positive */
    float range_rate_mps;  /* opening positive */
    uint16_t number;       /* of the object, the same from scan to scan */
    uint8_t mode;          /* 0 long range, 1 medium range */
    uint8_t reserved;
} vve_target;

typedef struct {
    vve_head head;
    double time_s;          /* GNSS time of validity, since 1980-01-06, no leap seconds */
    double measured_s;      /* GNSS time at which the scan was measured */
    float speed_mps;        /* of the rear axle, forward positive */
    float yaw_rate_radps;   /* left positive */
    uint32_t targets;       /* that follow; then the CRC */
    uint32_t reserved;
    vve_target target[VVE_MAX_TARGETS];
} vve_radar;

typedef struct {
    vve_head head;
    double time_s;            /* of the radar datagram that it answers */
    float steering_rad;       /* road-wheel angle, left positive */
    float acceleration_mps2;  /* braking negative */
    uint32_t answers;         /* sequence of the radar datagram that it answers */
    uint32_t reserved;
} vve_setpoint;

#define VVE_MAX_SCAN_AGE 0.3 /* [s]; an older scan is not to be acted on */

enum { VVE_RADAR_HEAD = 48, VVE_SETPOINT_LENGTH = 44, VVE_KEY = 32, VVE_TAG = 16 };

/* Return whether a radar datagram may be acted on: it says so, and its scan is not older than 0.3 s. Its own lifetime
 * is the caller's to check, who knows the time: at a GNSS time later than time_s + lifetime_us it has ended. */
static inline int vve_fresh(const vve_radar *radar) {
    const double age = radar->time_s - radar->measured_s;
    return (radar->head.flags & VVE_VALID) && age > -0.001 && age <= VVE_MAX_SCAN_AGE;
}

static inline uint32_t vve_crc32(const uint8_t *data, size_t length) {
    uint32_t crc = 0xFFFFFFFFu;
    while (length--) {
        crc ^= *data++;
        for (int bit = 0; bit < 8; bit++) crc = crc >> 1 ^ (0xEDB88320u & -(crc & 1u));
    }
    return ~crc;
}

static inline int vve_finite(const vve_radar *radar) {
    int finite = isfinite(radar->time_s) && isfinite(radar->measured_s);
    finite = finite && isfinite(radar->speed_mps) && isfinite(radar->yaw_rate_radps);
    for (uint32_t n = 0; n < radar->targets; n++) {
        const vve_target *seen = &radar->target[n];
        finite = finite && isfinite(seen->range_m) && isfinite(seen->azimuth_rad) && isfinite(seen->range_rate_mps);
    }
    return finite;
}

/* Read a radar datagram; return 1, or 0 for bytes that are none of this version or not whole, or hold a number that is
 * not finite. */
static inline int vve_read_radar(const uint8_t *data, size_t length, vve_radar *radar) {
    uint32_t crc;
    if (length < VVE_RADAR_HEAD + 4 || length > sizeof *radar + 4) return 0;
    memcpy(&crc, data + length - 4, 4);
    if (crc != vve_crc32(data, length - 4)) return 0;
    memcpy(radar, data, length - 4);
    return memcmp(radar->head.magic, "VVES", 4) == 0 && radar->head.version == VVE_VERSION &&
           radar->head.kind == VVE_RADAR && radar->targets <= VVE_MAX_TARGETS &&
           length == VVE_RADAR_HEAD + radar->targets * sizeof(vve_target) + 4 && vve_finite(radar);
}

/* Write a setpoint into VVE_SETPOINT_LENGTH bytes; return 1, or 0, and nothing written, for a number that is not finite. */
static inline int vve_write_setpoint(uint8_t *data, const vve_setpoint *setpoint) {
    const uint32_t reserved = 0;
    if (!isfinite(setpoint->time_s) || !isfinite(setpoint->steering_rad) || !isfinite(setpoint->acceleration_mps2)) return 0;
    memcpy(data, setpoint, 36);
    memcpy(data, "VVES", 4);
    data[4] = VVE_VERSION;
    data[5] = VVE_SETPOINT;
    memcpy(data + 36, &reserved, 4);
    const uint32_t crc = vve_crc32(data, 40);
    memcpy(data + 40, &crc, 4);
    return 1;
}

static inline uint32_t vve_turned(uint32_t word, int bits) { return word >> bits | word << (32 - bits); }

/* One block of SHA-256 (FIPS 180-4). The constants are the fractions of the cube roots of the first 64 primes. */
static inline void vve_sha256_block(uint32_t state[8], const uint8_t *block) {
    static const uint32_t constant[64] = {
        0x428a2f98, 0x71374491, 0xb5c0fbcf, 0xe9b5dba5, 0x3956c25b, 0x59f111f1, 0x923f82a4, 0xab1c5ed5,
        0xd807aa98, 0x12835b01, 0x243185be, 0x550c7dc3, 0x72be5d74, 0x80deb1fe, 0x9bdc06a7, 0xc19bf174,
        0xe49b69c1, 0xefbe4786, 0x0fc19dc6, 0x240ca1cc, 0x2de92c6f, 0x4a7484aa, 0x5cb0a9dc, 0x76f988da,
        0x983e5152, 0xa831c66d, 0xb00327c8, 0xbf597fc7, 0xc6e00bf3, 0xd5a79147, 0x06ca6351, 0x14292967,
        0x27b70a85, 0x2e1b2138, 0x4d2c6dfc, 0x53380d13, 0x650a7354, 0x766a0abb, 0x81c2c92e, 0x92722c85,
        0xa2bfe8a1, 0xa81a664b, 0xc24b8b70, 0xc76c51a3, 0xd192e819, 0xd6990624, 0xf40e3585, 0x106aa070,
        0x19a4c116, 0x1e376c08, 0x2748774c, 0x34b0bcb5, 0x391c0cb3, 0x4ed8aa4a, 0x5b9cca4f, 0x682e6ff3,
        0x748f82ee, 0x78a5636f, 0x84c87814, 0x8cc70208, 0x90befffa, 0xa4506ceb, 0xbef9a3f7, 0xc67178f2};
    uint32_t w[64], s[8];
    for (int n = 0; n < 16; n++)
        w[n] = (uint32_t)block[4 * n] << 24 | (uint32_t)block[4 * n + 1] << 16 | (uint32_t)block[4 * n + 2] << 8 |
               block[4 * n + 3];
    for (int n = 16; n < 64; n++)
        w[n] = w[n - 16] + w[n - 7] + (vve_turned(w[n - 15], 7) ^ vve_turned(w[n - 15], 18) ^ w[n - 15] >> 3) +
               (vve_turned(w[n - 2], 17) ^ vve_turned(w[n - 2], 19) ^ w[n - 2] >> 10);
    memcpy(s, state, sizeof s);
    for (int n = 0; n < 64; n++) {
        const uint32_t one = s[7] + (vve_turned(s[4], 6) ^ vve_turned(s[4], 11) ^ vve_turned(s[4], 25)) +
                             ((s[4] & s[5]) ^ (~s[4] & s[6])) + constant[n] + w[n];
        const uint32_t two = (vve_turned(s[0], 2) ^ vve_turned(s[0], 13) ^ vve_turned(s[0], 22)) +
                             ((s[0] & s[1]) ^ (s[0] & s[2]) ^ (s[1] & s[2]));
        memmove(s + 1, s, 7 * sizeof *s);
        s[4] += one;
        s[0] = one + two;
    }
    for (int n = 0; n < 8; n++) state[n] += s[n];
}

/* SHA-256 of a block of 64 bytes and of what follows it: all that an HMAC needs. */
static inline void vve_sha256(const uint8_t first[64], const uint8_t *data, size_t length, uint8_t digest[32]) {
    uint32_t state[8] = {0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a, 0x510e527f, 0x9b05688c, 0x1f83d9ab, 0x5be0cd19};
    const uint64_t bits = 8 * (uint64_t)(64 + length);
    uint8_t last[128] = {0};
    vve_sha256_block(state, first);
    for (; length >= 64; data += 64, length -= 64) vve_sha256_block(state, data);
    memcpy(last, data, length);
    last[length] = 0x80;
    const size_t end = length < 56 ? 64 : 128;
    for (int n = 0; n < 8; n++) last[end - 1 - n] = (uint8_t)(bits >> 8 * n);
    for (size_t at = 0; at < end; at += 64) vve_sha256_block(state, last + at);
    for (int n = 0; n < 32; n++) digest[n] = (uint8_t)(state[n / 4] >> (24 - 8 * (n % 4)));
}

/* The tag that a key gives to a datagram: the first bytes of its HMAC-SHA-256 (RFC 2104). */
static inline void vve_tag(const uint8_t *data, size_t length, const uint8_t key[VVE_KEY], uint8_t tag[VVE_TAG]) {
    uint8_t inner[64], outer[64], digest[32];
    memset(inner, 0x36, sizeof inner);
    memset(outer, 0x5c, sizeof outer);
    for (int n = 0; n < VVE_KEY; n++) inner[n] ^= key[n], outer[n] ^= key[n];
    vve_sha256(inner, data, length, digest);
    vve_sha256(outer, digest, sizeof digest, digest);
    memcpy(tag, digest, VVE_TAG);
}

/* Return the length of a datagram without its tag, or 0 where it was not signed with the key. */
static inline size_t vve_without_tag(const uint8_t *data, size_t length, const uint8_t key[VVE_KEY]) {
    uint8_t tag[VVE_TAG], differs = 0;
    if (length < VVE_TAG) return 0;
    vve_tag(data, length - VVE_TAG, key, tag);
    for (int n = 0; n < VVE_TAG; n++) differs |= tag[n] ^ data[length - VVE_TAG + n];
    return differs ? 0 : length - VVE_TAG;
}

/* Write the tag behind a datagram, where VVE_TAG bytes must be free, and return the length of both. */
static inline size_t vve_sign(uint8_t *data, size_t length, const uint8_t key[VVE_KEY]) {
    vve_tag(data, length, key, data + length);
    return length + VVE_TAG;
}

/* Read the 64 hexadecimal digits of a key file; return 1, or 0 where it has none. */
static inline int vve_read_key(const char *path, uint8_t key[VVE_KEY]) {
    FILE *file = fopen(path, "r");
    int count = 0;
    unsigned byte;
    if (file == NULL) return 0;
    while (count < VVE_KEY && fscanf(file, "%2x", &byte) == 1) key[count++] = (uint8_t)byte;
    fclose(file);
    return count == VVE_KEY;
}

#endif
