/* Datagrams of vve_sumo, version 1: the virtual radar to a control computer (kind 1), its setpoint back (kind 2).
 *
 * Little endian; every field lies at a multiple of its size, so these structs need no packing. The last four bytes of a
 * datagram are the CRC-32 (of Ethernet and zlib) of all before. docs/brains.md gives each field's meaning.
 */
#ifndef VVE_WIRE_H
#define VVE_WIRE_H

#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

enum { VVE_VERSION = 1, VVE_RADAR = 1, VVE_SETPOINT = 2, VVE_VALID = 1, VVE_EMERGENCY = 1, VVE_MAX_TARGETS = 64 };

typedef struct {
    char magic[4];        /* "VVES" */
    uint8_t version;      /* VVE_VERSION */
    uint8_t kind;         /* VVE_RADAR or VVE_SETPOINT */
    uint16_t flags;       /* radar: VVE_VALID; setpoint: VVE_EMERGENCY */
    uint32_t sequence;    /* radar: counts ticks up, with gaps for skipped ones; setpoint: counts up */
    uint32_t lifetime_us; /* from its arrival on; not to be acted on for longer */
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

enum { VVE_RADAR_HEAD = 48, VVE_SETPOINT_LENGTH = 44 };

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

#endif
