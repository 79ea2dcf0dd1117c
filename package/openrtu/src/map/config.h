/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The configuration as the map carries it: flat tables of fixed-size records, filled by rtud from
 * the JSON file and read by every module. A module never sees the file.
 *
 * The tables refer to each other by index. Points are sorted by device, devices by line, so that a
 * device's points and a line's devices are contiguous.
 */
#ifndef OPENRTU_MAP_CONFIG_H
#define OPENRTU_MAP_CONFIG_H

#include <stdbool.h>
#include <stdint.h>

#define MAP_KNOTS_MAX         UINT16_MAX /* of all scaling tables */
#define MAP_NAME_SIZE         40         /* names of points, devices and modules, terminator included */
#define MAP_PATH_SIZE         64         /* a serial device's path */
#define MAP_CLOCK_MASTERS_MAX 8          /* addresses in "clock_masters" */
#define MAP_ADDRESS_SIZE      46         /* INET6_ADDRSTRLEN */
#define MAP_MASTERS_MAX       32         /* addresses in "masters" */
#define MAP_GROUPS_MAX        8          /* redundancy groups */
#define MAP_GROUP_MASTERS_MAX 8          /* addresses of one */

/* Of "tls": a file's path, the list "masters", and a SHA-256 fingerprint as openssl prints it. */
#define MAP_FILE_SIZE       128
#define MAP_TLS_MASTERS_MAX 16
#define MAP_TLS_MASTER_SIZE 96

/* The information types of the project report's tables 4.1 and 4.2. */
enum map_type {
	MAP_SINGLE,     /* value.u 0, 1 */
	MAP_DOUBLE,     /* value.u 0 intermediate, 1 off, 2 on, 3 indeterminate */
	MAP_STEP,       /* value.i -64..63, detail bit 0: transient */
	MAP_BITSTRING,  /* value.u, 32 bits */
	MAP_NORMALIZED, /* value.i -32768..32767, the wire's NVA: value / 32768 */
	MAP_SCALED,     /* value.i -32768..32767 */
	MAP_FLOAT,      /* value.f */
	MAP_COUNTER,    /* value.i, 32 bits */
};

#define MAP_TYPES (MAP_COUNTER + 1)

/* The four Modbus tables; the order is that of the report's configuration file. */
enum map_table {
	MAP_COILS,             /* FC 1, 5, 15 */
	MAP_DISCRETE_INPUTS,   /* FC 2 */
	MAP_INPUT_REGISTERS,   /* FC 4 */
	MAP_HOLDING_REGISTERS, /* FC 3, 6, 16 */
};

enum map_parity { MAP_PARITY_NONE, MAP_PARITY_ODD, MAP_PARITY_EVEN }; /* the report's 0, 1, 2 */

/* What a point's registers hold; a point of bits has MAP_FORMAT_BIT, in a register the bit number `bit`. */
enum map_format {
	MAP_FORMAT_BIT,
	MAP_FORMAT_VTI, /* the low octet of a register */
	MAP_FORMAT_INT16,
	MAP_FORMAT_UINT16,
	MAP_FORMAT_INT32,
	MAP_FORMAT_UINT32,
	MAP_FORMAT_INT64,
	MAP_FORMAT_UINT64,
	MAP_FORMAT_FLOAT32, /* IEEE 754 */
	MAP_FORMAT_FLOAT64,
};

enum map_point_flag {
	MAP_POINT_INVERTED = 1u << 0,      /* of bits: each means the opposite */
	MAP_POINT_WORDS_SWAPPED = 1u << 1, /* low word first */
	MAP_POINT_BYTES_SWAPPED = 1u << 2, /* low byte first in each word */
	MAP_POINT_BITS_SWAPPED = 1u << 3,  /* double point: first bit ON, second OFF */
	MAP_POINT_SELECT = 1u << 4,        /* a command needs a selection first */
	MAP_POINT_COMMAND = 1u << 5,       /* coil or holding register: may be commanded */
	MAP_POINT_NO_QUALITY = 1u << 6,    /* normalized: sent without quality, and so only while good */
	MAP_POINT_NO_READ_BACK = 1u << 7, /* what was written is not read ahead of its turn, nor waited for */
	MAP_POINT_UNIMPLEMENTED = 1u << 8,  /* an integer's extreme value says that there is none (SunSpec) */
	MAP_POINT_SCALE_REGISTER = 1u << 9, /* another register holds the power of ten of its raw value */
};

/* What a status bit of the device, while it is ON, makes of a point's quality. */
enum map_status {
	MAP_BLOCKED_BY,
	MAP_SUBSTITUTED_BY,
	MAP_NOT_TOPICAL_BY,
	MAP_STATUS_BITS,
};

/* How a port's driver drives an RS-485 transceiver that has a direction pin. */
enum map_rs485 {
	MAP_RS485_NONE, /* the transceiver finds the direction itself, or somebody else has told the driver */
	MAP_RS485_HIGH, /* RTS is active while sending */
	MAP_RS485_LOW,
};

/* One RS-485 line, or one Modbus TCP connection with the units behind it. */
struct map_line {
	uint16_t port;    /* the file's "value": 1..6 on this board */
	uint16_t process; /* lines with one number share one rtu-modbus process */
	uint16_t module;  /* index of that process in the module table; set by map_create */
	uint16_t first_device;
	uint16_t device_count;
	uint8_t stop_bits;           /* 1, 2 */
	uint8_t parity;              /* enum map_parity */
	uint32_t baud;               /* bit/s */
	uint8_t rs485;               /* enum map_rs485 */
	uint8_t before_ms, after_ms; /* that mode's delays around a frame, 0..100 */
	uint8_t reserved;
	uint16_t tcp_port; /* of a TCP connection, which has nothing of a serial line; else 0 */
	uint16_t reserved2;
	char device[MAP_PATH_SIZE]; /* the serial device's path; the IP address of a TCP connection */
};

/* One Modbus slave and one set of points; devices with one common address are one IEC 104 station. */
struct map_device {
	uint16_t line;
	uint16_t ca;     /* common address; 1000 * port + unit where the file says nothing */
	uint8_t unit;    /* Modbus address 1..247, 255 on TCP; 0: broadcast, written and never read */
	uint8_t retries; /* repeated reads before the device counts as dead; writes are never repeated */
	uint16_t response_timeout_ms;     /* end of request to first byte of the answer */
	uint16_t response_timeout_min_ms; /* the least that is waited, however fast it has been */
	uint16_t max_bits, max_registers; /* that one request may read, 0: as the protocol has it */
	uint8_t no_holes;                 /* a request reads only addresses that points have */
	uint8_t probe_max_s;  /* longest pause between two probes of it while dead, 0: see modbus/line.h */
	uint32_t reaction_us; /* from the silence behind a request to its answer's first byte, 0: not known */
	uint32_t first_point;
	uint32_t point_count;
	char name[MAP_NAME_SIZE]; /* the file's "description" */
};

/* A point of a scaling table: from one to the next, values lie on a line. */
struct map_knot {
	double raw; /* greater than that of the knot before */
	double value;
};

/* One object of a device, seen by every protocol. */
struct map_point {
	uint32_t name; /* place among the configuration's names, 0: of its addresses */
	uint16_t device;
	uint16_t address;          /* Modbus address, from 0 */
	uint8_t table;             /* enum map_table */
	uint8_t type;              /* enum map_type */
	uint8_t width : 4;         /* bits or registers it covers: 1, 2, 4 */
	uint8_t format : 4;        /* enum map_format */
	uint8_t group;             /* interrogation group 1..16, 0: none */
	uint16_t flags;            /* enum map_point_flag */
	uint16_t second_address;   /* Modbus address of the second of two bits, or of the scale register */
	uint16_t first_knot;       /* of its scaling table, place among the configuration's knots */
	uint8_t knot_count;        /* of that, 0: scale and offset hold */
	uint8_t counter_group : 4; /* 1..4, 0: none */
	uint8_t bit : 4;           /* of a bit in a register: its number from 0, the least significant */
	uint32_t ioa;              /* information object address, 1..16777215 */
	uint32_t send_period_ms;   /* of cyclic transmission or background scan, 0: none */
	uint32_t freeze_s;         /* a counter's period of local freezes, 0: none */
	uint16_t short_pulse_ms;   /* of a coil: duration of QU 1, 0: none */
	uint16_t long_pulse_ms;    /* of QU 2 */
	float deadband;            /* in the unit of the value sent; 0: every change is an event */
	double scale;              /* engineering = raw * scale + offset; 1, 0 where the file says nothing */
	double offset;
	float
	    step; /* of a regulating step command, in the unit of the value sent; 0: none, min and max mean nothing */
	float min, max;   /* within which the point is commanded, in that unit */
	uint32_t slot;    /* place among its owner's points; set by map_create */
	uint32_t command; /* place among its owner's commands; set by map_create */
	uint32_t
	    extra; /* place among its owner's totals, of a counter, or parameters, of a measured value; set by map_create */
	/* By enum map_status: 1 + place of the status bit among the device's points, 0: none. */
	uint16_t status[MAP_STATUS_BITS];
	uint16_t scan_period_ms; /* between two reads of the device, 0: it is read in turn */
};

/* When summer time begins or ends: the n-th weekday of a month, in the local time until then (POSIX TZ, Mm.w.d/time). */
struct map_zone_rule {
	uint8_t month;   /* 1..12; 0: there is no summer time */
	uint8_t week;    /* 1..5, 5 the last */
	uint8_t weekday; /* 0 Sunday .. 6 */
	uint8_t reserved;
	int32_t time_s; /* after midnight, may be negative or of a later day */
};

/* A time zone; all 0 is UTC. */
struct map_zone {
	int32_t offset_s; /* ahead of UTC */
	int32_t summer_s; /* the same in summer time */
	struct map_zone_rule begin, end;
};

/* Whom the clock is from (rtud/clock.h). */
enum map_clock_mode {
	MAP_CLOCK_GATEWAY, /* the system's clock while that is synchronised, else a controlling station */
	MAP_CLOCK_MASTERS, /* a controlling station */
	MAP_CLOCK_SYSTEM, /* the system's clock, which a controlling station sets unless it is synchronised */
};

/* Controlling stations, or connections of one, of which one at a time is sent the events. */
struct map_group {
	char name[MAP_NAME_SIZE];
	uint32_t queue; /* events that may wait for it, less than event_ring */
	uint32_t master_count;
	char masters[MAP_GROUP_MASTERS_MAX][MAP_ADDRESS_SIZE];
};

enum map_tls_version { MAP_TLS_1_2 = 1u << 0, MAP_TLS_1_3 = 1u << 1 };

/* How rtu-iec104-tls proves who it is and asks who its masters are. IEC 62351-3. The files hold PEM. */
struct map_tls {
	char certificate[MAP_FILE_SIZE]; /* and what leads from it to its CA; empty: no TLS */
	char key[MAP_FILE_SIZE];
	char ca[MAP_FILE_SIZE];  /* whose certificates the masters have */
	char crl[MAP_FILE_SIZE]; /* of each of these CAs; empty: nothing is revoked */
	uint32_t resumption_s;   /* how long a session may be resumed, 0: never */
	uint32_t renewal_s;      /* how old a connection's keys become */
	uint8_t versions;        /* enum map_tls_version */
	uint8_t master_count;    /* 0: whoever has a certificate from the CA */
	uint8_t reserved[2];
	char masters[MAP_TLS_MASTERS_MAX][MAP_TLS_MASTER_SIZE]; /* common names and fingerprints */
};

/* What rtu-journal writes, so that events outlive a power cut. */
struct map_journal {
	char path[MAP_FILE_SIZE]; /* its folder; empty: no journal */
	uint32_t size_kb;         /* of its file, at most; a record has a quarter of it at most */
	uint32_t interval_s;      /* between two records, at least */
	uint32_t volume_mb;       /* MiB of the flash that the file system spreads its writing over */
	uint32_t cycles;          /* how often a block of it may be erased */
};

/* What belongs to no line. Times of IEC 60870-5-104, 9.6. */
struct map_settings {
	char address[MAP_ADDRESS_SIZE]; /* where rtu-iec104 listens */
	uint16_t port;
	uint16_t k, w; /* 1..32767, w <= k */
	uint16_t t1_s, t2_s;
	uint32_t t3_s; /* up to 48 h */
	uint16_t max_connections;
	uint16_t connections_per_address;
	uint16_t select_timeout_s;   /* a selection that is not executed ends */
	uint16_t command_timeout_s;  /* oldest acceptable time tag, longest wait for the device */
	uint16_t own_ca;             /* common address of the gateway's own station, 0: there is none */
	uint8_t clock;               /* enum map_clock_mode */
	uint8_t clock_master_count;  /* 0: every master may set the clock */
	uint8_t modbus_priority;     /* SCHED_FIFO 1..99, 0: none */
	uint16_t heartbeat_limit_ms; /* of a line process; 0: MAP_HEARTBEAT_LIMIT_MS */
	bool command_without_clock;  /* takes a time tag whose age nobody knows */
	struct map_zone zone;        /* of the time tags on the wire */
	uint32_t event_ring;         /* each module keeps one event less; a power of two */
	char clock_masters[MAP_CLOCK_MASTERS_MAX][MAP_ADDRESS_SIZE];
	uint32_t master_count; /* 0: everybody may connect */
	uint32_t lone_masters; /* of them, those in no group */
	char masters[MAP_MASTERS_MAX][MAP_ADDRESS_SIZE];
	uint32_t group_count;
	struct map_group groups[MAP_GROUPS_MAX];
	uint32_t originators_refused[8]; /* a bit for each originator address that may not command */
	struct map_tls tls;
	struct map_journal journal;
};

/* rtu-iec104-tls is the module's program. */
static inline bool map_tls_used(const struct map_settings *settings)
{
	return settings->tls.certificate[0] != '\0';
}

static inline bool map_journal_used(const struct map_settings *settings)
{
	return settings->journal.path[0] != '\0';
}

/*
 * The whole configuration. The arrays belong to whoever filled it, or lie in the map.
 *
 * With own_ca, the last line is none, and its only device is the gateway's own station: points of rtu-iec104 about its
 * event queues. First one for each redundancy group and one for all others that says whether events were lost and not
 * made up for, then as many that count them.
 */
struct map_config {
	struct map_settings settings;
	uint32_t line_count, device_count, point_count;
	struct map_line *lines;
	struct map_device *devices;
	struct map_point *points;
	char *names; /* given to points, each with its terminator; the first begins at 1 */
	uint32_t names_size;
	struct map_knot *knots; /* of all scaling tables */
	uint32_t knot_count;
};

/* A point's name: what the file gave it, or else "p1.5.i30" of port, Modbus address, table and address, with ".7" of a bit. */
void map_point_name(const struct map_config *config, const struct map_point *point, char out[MAP_NAME_SIZE]);

/* A bit, or two neighbours, of a register. */
static inline bool map_point_is_register_bit(const struct map_point *point)
{
	return point->table >= MAP_INPUT_REGISTERS &&
	       (point->type == MAP_SINGLE || point->type == MAP_DOUBLE);
}

/* Modbus address of its bit or register number i, below width. */
static inline uint32_t map_point_address(const struct map_point *point, uint32_t i)
{
	return point->type == MAP_DOUBLE && i == 1 ? point->second_address : point->address + i;
}

static inline bool map_point_has_scale_register(const struct map_point *point)
{
	return (point->flags & MAP_POINT_SCALE_REGISTER) != 0;
}

/* The Modbus addresses from first to last that one answer must hold, so that what it says belongs together. */
struct map_extent {
	uint32_t first, last;
};

static inline struct map_extent map_point_extent(const struct map_point *point)
{
	struct map_extent extent = {point->address, point->address + point->width - 1u};

	if (point->type == MAP_DOUBLE && point->width == 2)
		extent.last = point->second_address;
	else if (map_point_has_scale_register(point) && point->second_address > extent.last)
		extent.last = point->second_address;
	else if (map_point_has_scale_register(point))
		extent.first = point->second_address;
	if (extent.last < extent.first)
		extent = (struct map_extent){extent.last, extent.first};
	return extent;
}

static inline bool map_line_is_tcp(const struct map_line *line)
{
	return line->tcp_port != 0;
}

/* All lines but the one of the gateway's own station. */
static inline uint32_t map_modbus_lines(const struct map_config *config)
{
	return config->line_count - (config->settings.own_ca != 0);
}

/* The Modbus devices. */
static inline uint32_t map_slaves(const struct map_config *config)
{
	return config->device_count - (config->settings.own_ca != 0);
}

#endif
