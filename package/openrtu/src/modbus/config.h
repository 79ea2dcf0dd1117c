/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What only Modbus knows of the configuration: its sections of it. The slaves are the first sets, so that a slave's number is
 * that of its set, and so are their points.
 */
#ifndef OPENRTU_MODBUS_CONFIG_H
#define OPENRTU_MODBUS_CONFIG_H

#include "map/config.h"
#include "modbus/format.h"
#include "modbus/frame.h"
#include "modbus/identity.h"

#define MODBUS_PATH_SIZE 64 /* a serial device's path */

#define MODBUS_SETTINGS MAP_SECTION_ID('M', 'B', 'S', 'E')
#define MODBUS_PORTS    MAP_SECTION_ID('M', 'B', 'P', 'O')
#define MODBUS_SLAVES   MAP_SECTION_ID('M', 'B', 'S', 'L')
#define MODBUS_POINTS   MAP_SECTION_ID('M', 'B', 'P', 'T')
#define MODBUS_KNOTS    MAP_SECTION_ID('M', 'B', 'K', 'N')
#define MODBUS_EXTRAS   MAP_SECTION_ID('M', 'B', 'E', 'X')
#define MODBUS_KEEPS    MAP_SECTION_ID('M', 'B', 'K', 'P')
#define MODBUS_EXPECTED MAP_SECTION_ID('M', 'B', 'I', 'D')
#define MODBUS_PASSES   MAP_SECTION_ID('M', 'B', 'P', 'A')

#define MODBUS_KNOTS_MAX UINT16_MAX /* of all scaling tables */
#define MODBUS_TEXT_MAX  32         /* registers of a text */

struct modbus_settings {
	uint8_t priority;            /* SCHED_FIFO 1..99, 0: none */
	uint16_t heartbeat_limit_ms; /* of a line process; 0: MAP_HEARTBEAT_LIMIT_MS */
};

/* The four Modbus tables; the order is that of the report's configuration file. */
enum modbus_table {
	MODBUS_COILS,             /* FC 1, 5, 15 */
	MODBUS_DISCRETE_INPUTS,   /* FC 2 */
	MODBUS_INPUT_REGISTERS,   /* FC 4 */
	MODBUS_HOLDING_REGISTERS, /* FC 3, 6, 16 */
};

enum modbus_parity { MODBUS_PARITY_NONE, MODBUS_PARITY_ODD, MODBUS_PARITY_EVEN }; /* the report's 0, 1, 2 */

/* How a port's driver drives an RS-485 transceiver that has a direction pin. */
enum modbus_rs485 {
	MODBUS_RS485_NONE, /* the transceiver finds the direction itself, or somebody else has told the driver */
	MODBUS_RS485_HIGH, /* RTS is active while sending */
	MODBUS_RS485_LOW,
};

/* What carries frames to a host. */
enum modbus_transport { MODBUS_OVER_TCP, MODBUS_OVER_UDP };

/* One RS-485 line, or one Modbus TCP connection with the units behind it. */
struct modbus_port {
	uint16_t port;         /* the file's "value": 1..6 on this board */
	uint16_t process;      /* lines with one number share one rtu-modbus process */
	uint16_t module;       /* number of that process; planned by its kind */
	uint16_t first_device; /* place among the slaves */
	uint16_t device_count;
	uint8_t data_bits;           /* 8, of ASCII also 7 */
	uint8_t stop_bits;           /* 1, 2 */
	uint8_t parity;              /* enum modbus_parity */
	uint32_t baud;               /* bit/s */
	uint8_t rs485;               /* enum modbus_rs485 */
	uint8_t before_ms, after_ms; /* that mode's delays around a frame, 0..100 */
	uint8_t framing;             /* enum modbus_framing */
	uint16_t tcp_port;  /* of a TCP connection or of UDP, which have nothing of a serial line; else 0 */
	uint8_t transport;  /* enum modbus_transport, of these */
	uint16_t settle_ms; /* from a connection to the first request on it */
	char device[MODBUS_PATH_SIZE]; /* the serial device's path; the IP address of a TCP connection */
};

/* One Modbus slave; its points are the set of the same number. */
struct modbus_slave {
	uint16_t port;   /* place among the ports */
	uint8_t unit;    /* Modbus address 1..247, 255 on TCP; 0: broadcast, written and never read */
	uint8_t retries; /* repeated reads before the device counts as dead; writes are never repeated */
	uint16_t response_timeout_ms;     /* end of request to first byte of the answer */
	uint16_t response_timeout_min_ms; /* the least that is waited, however fast it has been */
	uint16_t max_bits, max_registers; /* that one request may read, 0: as the protocol has it */
	uint8_t no_holes;                 /* a request reads only addresses that points have */
	uint8_t probe_max_s;  /* longest pause between two probes of it while dead, 0: see modbus/line.h */
	uint32_t reaction_us; /* from the silence behind a request to its answer's first byte, 0: not known */
	uint16_t pause_ms;    /* the least between its answer and the next request to it */
	uint8_t writes_multiple; /* one coil or register is written with function 15 or 16 at first */
	uint8_t not_asked;       /* what it is: function 43 */
	uint16_t page_address;   /* of the register that chooses a page, where points are on one */
	uint16_t reserved;
};

enum modbus_point_flag {
	MODBUS_INVERTED = 1u << 0,       /* of bits: each means the opposite */
	MODBUS_WORDS_SWAPPED = 1u << 1,  /* low word first */
	MODBUS_BYTES_SWAPPED = 1u << 2,  /* low byte first in each word */
	MODBUS_BITS_SWAPPED = 1u << 3,   /* double point: first bit ON, second OFF */
	MODBUS_NO_READ_BACK = 1u << 4,   /* what was written is not read ahead of its turn, nor waited for */
	MODBUS_UNIMPLEMENTED = 1u << 5,  /* an integer's extreme value says that there is none (SunSpec) */
	MODBUS_SCALE_REGISTER = 1u << 6, /* another register holds the power of ten of its raw value */
	MODBUS_WRITTEN_ELSEWHERE = 1u << 7, /* commands go to another address than the one that is read */
};

/* What a status bit of the device, while it is ON, makes of a point's quality. */
enum modbus_status {
	MODBUS_BLOCKED_BY,
	MODBUS_SUBSTITUTED_BY,
	MODBUS_NOT_TOPICAL_BY,
	MODBUS_STATUS_BITS,
};

/* Other points of its device that a point names: those, and what its scale is. */
enum modbus_link {
	MODBUS_SCALE_BY = MODBUS_STATUS_BITS, /* the power of ten of its raw value */
	MODBUS_FACTOR_BY,                     /* what that is multiplied by */
	MODBUS_LINKS,
};

/* A point of a scaling table: from one to the next, values lie on a line. */
struct modbus_knot {
	double raw; /* greater than that of the knot before */
	double value;
};

/* What few points have. */
struct modbus_extra {
	/* By enum modbus_status and enum modbus_link: 1 + place among the slave's points, 0: none. */
	uint16_t links[MODBUS_LINKS];
	uint16_t write_address; /* MODBUS_WRITTEN_ELSEWHERE */
	uint16_t page;          /* that it is on, */
	uint16_t is_paged;      /* if it is on one */
};

/* What the gateway itself writes to a point's place: a record for each value in turn; in the order of the points. */
struct modbus_keep {
	uint32_t point;
	uint32_t period_ms; /* 0: when the device is back alone */
	double value;
	uint32_t has_value; /* else it is what was commanded last */
	uint32_t reserved;
};

/* What a device shall say that it is: an object of its identification; in the order of the slaves. */
struct modbus_expected {
	uint32_t slave;
	uint8_t object;
	char text[MODBUS_IDENTITY_TEXT + 1]; /* Latin-1, as the device sends it */
};

#define MODBUS_PASS_CONNECTIONS_MAX 8

/* Where a tool may connect that has its requests passed on to a line, and which. In the order of the ports. */
struct modbus_pass {
	uint32_t port; /* place among the ports */
	uint16_t tcp_port;
	uint8_t connections; /* at a time */
	uint8_t share;       /* percent of the line's time */
	char address[MAP_ADDRESS_SIZE];
	uint8_t units[32];                          /* a bit each */
	uint8_t functions[16], write_functions[16]; /* the same */
};

#define MODBUS_PERIOD_MAX_MS 0x7FFFFFFu /* that a point has room for; a day is less */

/* Where a point's value is in its slave, and how it stands there; at the number of the point. */
struct modbus_point {
	uint16_t address;        /* from 0 */
	uint16_t second_address; /* of the second of two bits, of the scale register, of a text's last one */
	uint32_t scan_period_ms : 27; /* between two reads of the device, 0: it is read in turn */
	uint32_t type : 5;            /* enum map_type, as the point has it */
	uint32_t flags : 8;           /* enum modbus_point_flag */
	uint32_t knot_count : 6;      /* of its scaling table, 0: scale and offset hold */
	uint32_t format : 5;          /* enum modbus_format */
	uint32_t width : 3;           /* bits or registers it covers: 1 to 4; 0: of a text, modbus_width_of */
	uint32_t table : 2;           /* enum modbus_table */
	uint32_t bit : 4;    /* of bits of a register: the number of the first, 0 is the least significant */
	uint32_t field : 4;  /* of a number in some bits of a register: how many, 0: it has whole registers */
	uint16_t first_knot; /* of that table, place among the configuration's knots */
	uint16_t extra;      /* 1 + place among the configuration's extras, 0: it has none */
	double scale;        /* engineering = raw * scale + offset; 1, 0 where the file says nothing */
	double offset;
};

static inline struct modbus_point *modbus_points(const struct map_config *config)
{
	return map_records(config, MODBUS_POINTS, sizeof(struct modbus_point));
}

/* NULL: it has none. */
static inline const struct modbus_extra *modbus_extra_of(const struct map_config *config,
							 const struct modbus_point *point)
{
	const struct modbus_extra *extras;

	if (point->extra == 0)
		return NULL;
	extras = map_records(config, MODBUS_EXTRAS, sizeof(*extras));
	return &extras[point->extra - 1];
}

/* The table that is written where commands go elsewhere: that of the same size. */
static inline enum modbus_table modbus_written_table(enum modbus_table table)
{
	return table <= MODBUS_DISCRETE_INPUTS ? MODBUS_COILS : MODBUS_HOLDING_REGISTERS;
}

/* The point as its commands have it: the same bits or registers, where they are written. */
static inline struct modbus_point modbus_written(const struct map_config *config,
						 const struct modbus_point *point)
{
	struct modbus_point written = *point;

	if (!(point->flags & MODBUS_WRITTEN_ELSEWHERE))
		return written;
	written.table = modbus_written_table((enum modbus_table)point->table) & 3u;
	written.address = modbus_extra_of(config, point)->write_address;
	written.second_address = (uint16_t)(written.address + 1);
	return written;
}

static inline struct modbus_knot *modbus_knots(const struct map_config *config)
{
	return map_records(config, MODBUS_KNOTS, sizeof(struct modbus_knot));
}

static inline struct modbus_keep *modbus_keeps(const struct map_config *config)
{
	return map_records(config, MODBUS_KEEPS, sizeof(struct modbus_keep));
}

/* How many records are the point's, the first of which is *first. */
static inline uint32_t modbus_keeps_of(const struct map_config *config, uint32_t point,
				       const struct modbus_keep **first)
{
	uint32_t count;

	*first = map_records_of(config, MODBUS_KEEPS, sizeof(**first), point, &count);
	return count;
}

static inline struct modbus_settings *modbus_settings(const struct map_config *config)
{
	return map_records(config, MODBUS_SETTINGS, sizeof(struct modbus_settings));
}

static inline struct modbus_port *modbus_ports(const struct map_config *config)
{
	return map_records(config, MODBUS_PORTS, sizeof(struct modbus_port));
}

static inline uint32_t modbus_port_count(const struct map_config *config)
{
	return map_record_count(config, MODBUS_PORTS);
}

static inline struct modbus_pass *modbus_passes(const struct map_config *config)
{
	return map_records(config, MODBUS_PASSES, sizeof(struct modbus_pass));
}

/* That of a process, which has one at most; NULL: none. */
const struct modbus_pass *modbus_pass_of(const struct map_config *config, uint16_t process);

static inline struct modbus_slave *modbus_slaves(const struct map_config *config)
{
	return map_records(config, MODBUS_SLAVES, sizeof(struct modbus_slave));
}

static inline uint32_t modbus_slave_count(const struct map_config *config)
{
	return map_record_count(config, MODBUS_SLAVES);
}

static inline bool modbus_is_tcp(const struct modbus_port *port)
{
	return port->tcp_port != 0;
}

static inline bool modbus_is_udp(const struct modbus_port *port)
{
	return port->transport == MODBUS_OVER_UDP;
}

/* All devices of its line hear what it is told, and none answers. */
static inline bool modbus_is_broadcast(const struct map_config *config, uint32_t slave)
{
	const struct modbus_slave *is = &modbus_slaves(config)[slave];

	return is->unit == MODBUS_BROADCAST && modbus_ports(config)[is->port].framing != MODBUS_FRAMING_TCP;
}

/* What it is: function 43. */
static inline bool modbus_is_asked(const struct map_config *config, uint32_t slave)
{
	return !modbus_slaves(config)[slave].not_asked && !modbus_is_broadcast(config, slave);
}

/* Those of a slave, of which there are *count. */
static inline const struct modbus_expected *modbus_expected_of(const struct map_config *config,
							       uint32_t slave, uint32_t *count)
{
	return map_records_of(config, MODBUS_EXPECTED, sizeof(struct modbus_expected), slave, count);
}

/* A bit, or two neighbours, of a register. */
static inline bool modbus_is_register_bit(const struct modbus_point *point)
{
	return point->table >= MODBUS_INPUT_REGISTERS &&
	       (point->type == MAP_SINGLE || point->type == MAP_DOUBLE);
}

/* A number in some bits of a register. */
static inline bool modbus_is_field(const struct modbus_point *point)
{
	return point->field != 0;
}

/* It shares its register: a command leaves the other bits of it alone. */
static inline bool modbus_is_part_of_register(const struct modbus_point *point)
{
	return modbus_is_register_bit(point) || modbus_is_field(point);
}

/* The registers are a text: the point has MAP_POINT_TEXT. */
static inline bool modbus_is_text(const struct modbus_point *point)
{
	return modbus_is_string((enum modbus_format)point->format);
}

/* Bits or registers that it covers. */
static inline uint32_t modbus_width_of(const struct modbus_point *point)
{
	return modbus_is_text(point) ? point->second_address - point->address + 1u : point->width;
}

/* A counter of it goes round at 65 536, and the map counts on: MAP_UPDATE_NARROW. */
static inline bool modbus_counts_16_bits(const struct modbus_point *point)
{
	return point->width == 1 && modbus_is_binary((enum modbus_format)point->format);
}

/* Modbus address of its bit or register number i, below width. */
static inline uint32_t modbus_point_address(const struct modbus_point *point, uint32_t i)
{
	return point->type == MAP_DOUBLE && i == 1 ? point->second_address : point->address + i;
}

static inline bool modbus_has_scale_register(const struct modbus_point *point)
{
	return (point->flags & MODBUS_SCALE_REGISTER) != 0;
}

_Static_assert(MODBUS_FORMATS <= 32 && MAP_COUNTER < 32, "modbus_point has room for each");

/* The Modbus addresses from first to last that one answer must hold, so that what it says belongs together. */
struct modbus_extent {
	uint32_t first, last;
};

static inline struct modbus_extent modbus_extent_of(const struct modbus_point *point)
{
	struct modbus_extent extent = {point->address, point->address + modbus_width_of(point) - 1u};

	if (point->type == MAP_DOUBLE && point->width == 2)
		extent.last = point->second_address;
	else if (modbus_has_scale_register(point) && point->second_address > extent.last)
		extent.last = point->second_address;
	else if (modbus_has_scale_register(point))
		extent.first = point->second_address;
	if (extent.last < extent.first)
		extent = (struct modbus_extent){extent.last, extent.first};
	return extent;
}

#endif
