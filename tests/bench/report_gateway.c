/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The method of the project report, to be measured beside ours: an interrogation is answered by reading the device
 * inside the interrogation handler (figure 4.21), one Modbus request a point (figure 5.4), and there are no
 * events. Plain libmodbus, and the least controlled station that serves one controlling station.
 */
#include <errno.h>
#include <modbus.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#define STATIONS_MAX 8
#define POINTS_MAX   20 /* of one table: both kinds of ASDU hold twice as many objects */
#define TABLES       4
#define UNIT_OF_CA   1000 /* CA = 1000 * port + unit */
#define RESPONSE_S   10

#define START       0x68
#define APCI_SIZE   4 /* the control field */
#define APDU_MAX    253
#define ASDU_MAX    (APDU_MAX - APCI_SIZE)
#define ASDU_HEAD   6 /* type, number, cause (2), common address (2) */
#define STARTDT_ACT 0x07
#define STOPDT_ACT  0x13
#define TESTFR_ACT  0x43
#define ACT_TO_CON  2 /* a U frame's confirmation is one bit to the left */

#define M_SP_NA_1    1
#define M_ME_NB_1    11
#define C_IC_NA_1    100
#define C_IC_SIZE    (ASDU_HEAD + 4) /* IOA, qualifier of interrogation */
#define QOI_STATION  20
#define COT_ACT_CON  7
#define COT_ACT_TERM 10
#define COT_INTROGEN 20
#define COT_NEGATIVE 0x40

/* In the order of the report's configuration file, and of figure 5.4. */
enum table { COILS, DISCRETE_INPUTS, INPUT_REGISTERS, HOLDING_REGISTERS };

static const unsigned first_ioa[TABLES] = {1, 10001, 30001, 40001};

struct station {
	uint16_t ca;
	uint8_t count[TABLES]; /* points, at Modbus addresses from 0 */
};

/* What interrogate_slave of figure 4.21 collects before anything is sent. */
struct response {
	uint8_t bits[2][POINTS_MAX];
	uint16_t registers[2][POINTS_MAX];
};

struct gateway {
	modbus_t *line;
	struct station stations[STATIONS_MAX];
	size_t station_count;
};

struct connection {
	int fd;
	uint16_t sent; /* N(S), N(R) */
	uint16_t received;
};

struct asdu {
	uint8_t bytes[ASDU_MAX];
	size_t size;
};

/* ---- the line ---------------------------------------------------------------------------- */

typedef int read_bits(modbus_t *line, int address, int count, uint8_t *values);
typedef int read_registers(modbus_t *line, int address, int count, uint16_t *values);

static bool read_each_bit(modbus_t *line, read_bits *read_one, uint8_t count, uint8_t *values)
{
	for (int address = 0; address < count; address++)
		if (read_one(line, address, 1, &values[address]) != 1)
			return false;
	return true;
}

static bool read_each_register(modbus_t *line, read_registers *read_one, uint8_t count, uint16_t *values)
{
	for (int address = 0; address < count; address++)
		if (read_one(line, address, 1, &values[address]) != 1)
			return false;
	return true;
}

static bool interrogate_slave(modbus_t *line, const struct station *station, struct response *response)
{
	const uint8_t *count = station->count;

	modbus_set_slave(line, station->ca % UNIT_OF_CA);
	return read_each_bit(line, modbus_read_bits, count[COILS], response->bits[0]) &&
	       read_each_bit(line, modbus_read_input_bits, count[DISCRETE_INPUTS], response->bits[1]) &&
	       read_each_register(line, modbus_read_input_registers, count[INPUT_REGISTERS],
				  response->registers[0]) &&
	       read_each_register(line, modbus_read_registers, count[HOLDING_REGISTERS],
				  response->registers[1]);
}

/* ---- the controlled station -------------------------------------------------------------- */

static bool send_all(int fd, const uint8_t *bytes, size_t size)
{
	return send(fd, bytes, size, MSG_NOSIGNAL) == (ssize_t)size;
}

static bool send_i(struct connection *connection, const struct asdu *asdu)
{
	uint8_t apdu[2 + APDU_MAX] = {
	    START,
	    (uint8_t)(APCI_SIZE + asdu->size),
	    (uint8_t)(connection->sent << 1),
	    (uint8_t)(connection->sent >> 7),
	    (uint8_t)(connection->received << 1),
	    (uint8_t)(connection->received >> 7),
	};

	connection->sent = (connection->sent + 1) & 0x7fff;
	memcpy(apdu + 2 + APCI_SIZE, asdu->bytes, asdu->size);
	return send_all(connection->fd, apdu, 2 + APCI_SIZE + asdu->size);
}

static bool send_confirmation(struct connection *connection, uint8_t request)
{
	const uint8_t apdu[] = {START, APCI_SIZE, (uint8_t)(0x03 | (request & 0xfc) * ACT_TO_CON), 0, 0, 0};

	return send_all(connection->fd, apdu, sizeof apdu);
}

/* The request comes back with another cause. */
static bool send_mirrored(struct connection *connection, const struct asdu *request, uint8_t cause)
{
	struct asdu answer = *request;

	answer.bytes[2] = cause;
	return send_i(connection, &answer);
}

static struct asdu new_asdu(uint8_t type, uint16_t ca)
{
	return (struct asdu){
	    .bytes = {type, 0, COT_INTROGEN, 0, (uint8_t)ca, (uint8_t)(ca >> 8)},
	    .size = ASDU_HEAD,
	};
}

static void add_object(struct asdu *asdu, unsigned ioa, const uint8_t *element, size_t size)
{
	uint8_t *object = asdu->bytes + asdu->size;

	object[0] = (uint8_t)ioa;
	object[1] = (uint8_t)(ioa >> 8);
	object[2] = (uint8_t)(ioa >> 16);
	memcpy(object + 3, element, size);
	asdu->size += 3 + size;
	asdu->bytes[1]++;
}

static bool send_single_points(struct connection *connection, const struct station *station,
			       const struct response *response)
{
	struct asdu asdu = new_asdu(M_SP_NA_1, station->ca);

	for (unsigned table = COILS; table <= DISCRETE_INPUTS; table++)
		for (unsigned i = 0; i < station->count[table]; i++)
			add_object(&asdu, first_ioa[table] + i, &response->bits[table][i], 1);
	return send_i(connection, &asdu);
}

static bool send_scaled_values(struct connection *connection, const struct station *station,
			       const struct response *response)
{
	struct asdu asdu = new_asdu(M_ME_NB_1, station->ca);

	for (unsigned table = INPUT_REGISTERS; table <= HOLDING_REGISTERS; table++) {
		for (unsigned i = 0; i < station->count[table]; i++) {
			const uint16_t value = response->registers[table - INPUT_REGISTERS][i];
			const uint8_t element[] = {(uint8_t)value, (uint8_t)(value >> 8), 0};

			add_object(&asdu, first_ioa[table] + i, element, sizeof element);
		}
	}
	return send_i(connection, &asdu);
}

static const struct station *find_station(const struct gateway *gateway, unsigned ca)
{
	for (size_t i = 0; i < gateway->station_count; i++)
		if (gateway->stations[i].ca == ca)
			return &gateway->stations[i];
	return NULL;
}

/* Figure 4.21: first the device is read, point after point, then all is sent. */
static bool answer_interrogation(const struct gateway *gateway, struct connection *connection,
				 const struct asdu *request)
{
	const unsigned ca = request->bytes[4] | (unsigned)request->bytes[5] << 8;
	const struct station *station = find_station(gateway, ca);
	struct response response = {0};

	if (!station || request->bytes[C_IC_SIZE - 1] != QOI_STATION)
		return send_mirrored(connection, request, COT_ACT_CON | COT_NEGATIVE);
	if (!interrogate_slave(gateway->line, station, &response)) {
		fprintf(stderr, "CA %u: %s\n", ca, modbus_strerror(errno));
		return send_mirrored(connection, request, COT_ACT_CON | COT_NEGATIVE);
	}
	return send_mirrored(connection, request, COT_ACT_CON) &&
	       send_single_points(connection, station, &response) &&
	       send_scaled_values(connection, station, &response) &&
	       send_mirrored(connection, request, COT_ACT_TERM);
}

static bool receive_all(int fd, uint8_t *bytes, size_t size)
{
	return recv(fd, bytes, size, MSG_WAITALL) == (ssize_t)size;
}

static bool take_i(const struct gateway *gateway, struct connection *connection, const uint8_t *apdu,
		   size_t size)
{
	struct asdu asdu = {.size = size - APCI_SIZE};

	memcpy(asdu.bytes, apdu + APCI_SIZE, asdu.size);
	connection->received = (connection->received + 1) & 0x7fff;
	if (asdu.size != C_IC_SIZE || asdu.bytes[0] != C_IC_NA_1)
		return false;
	return answer_interrogation(gateway, connection, &asdu);
}

/* One APDU. False ends the connection. */
static bool serve_apdu(const struct gateway *gateway, struct connection *connection)
{
	uint8_t head[2], apdu[APDU_MAX];

	if (!receive_all(connection->fd, head, sizeof head))
		return false;
	if (head[0] != START || head[1] < APCI_SIZE || head[1] > APDU_MAX)
		return false;
	if (!receive_all(connection->fd, apdu, head[1]))
		return false;
	if (!(apdu[0] & 0x01))
		return take_i(gateway, connection, apdu, head[1]);
	if (apdu[0] == STARTDT_ACT || apdu[0] == STOPDT_ACT || apdu[0] == TESTFR_ACT)
		return send_confirmation(connection, apdu[0]);
	return true; /* an S frame, a confirmation */
}

static int listen_on(uint16_t port)
{
	const struct sockaddr_in address = {
	    .sin_family = AF_INET,
	    .sin_port = htons(port),
	    .sin_addr.s_addr = htonl(INADDR_LOOPBACK),
	};
	const int on = 1;
	const int fd = socket(AF_INET, SOCK_STREAM, 0);

	if (fd < 0 || setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on))
		return -1;
	if (bind(fd, (const struct sockaddr *)&address, sizeof address) || listen(fd, 1))
		return -1;
	return fd;
}

static void serve(const struct gateway *gateway, int listener)
{
	const int on = 1;

	for (;;) {
		struct connection connection = {.fd = accept(listener, NULL, NULL)};

		if (connection.fd < 0)
			return;
		setsockopt(connection.fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
		while (serve_apdu(gateway, &connection))
			;
		close(connection.fd);
	}
}

/* ---- start ------------------------------------------------------------------------------- */

static bool parse_station(const char *text, struct station *station)
{
	uint8_t *count = station->count;
	int end = 0;

	if (sscanf(text, "%hu:%hhu:%hhu:%hhu:%hhu%n", &station->ca, &count[COILS], &count[DISCRETE_INPUTS],
		   &count[INPUT_REGISTERS], &count[HOLDING_REGISTERS], &end) != 5)
		return false;
	for (int table = 0; table < TABLES; table++)
		if (count[table] > POINTS_MAX)
			return false;
	return text[end] == '\0';
}

static bool parse_stations(struct gateway *gateway, char **texts, int count)
{
	if (count < 1 || count > STATIONS_MAX)
		return false;
	for (int i = 0; i < count; i++)
		if (!parse_station(texts[i], &gateway->stations[i]))
			return false;
	gateway->station_count = (size_t)count;
	return true;
}

static modbus_t *open_line(const char *device, int baud, int stop_bits)
{
	modbus_t *line = modbus_new_rtu(device, baud, 'N', 8, stop_bits);

	/* libmodbus' half a second is no time for a device on a busy host; one that answers does not take longer for it. */
	if (line)
		modbus_set_response_timeout(line, RESPONSE_S, 0);

	return line && modbus_connect(line) == 0 ? line : NULL;
}

int main(int argc, char **argv)
{
	struct gateway gateway;

	if (argc < 6 || !parse_stations(&gateway, argv + 5, argc - 5)) {
		fprintf(stderr,
			"usage: report_gateway DEVICE BAUD STOP_BITS TCP_PORT CA:C:DI:IR:HR...\n"
			"C, DI, IR, HR: how many coils, discrete inputs, input and holding registers\n");
		return 2;
	}
	gateway.line = open_line(argv[1], atoi(argv[2]), atoi(argv[3]));
	if (!gateway.line) {
		fprintf(stderr, "%s: %s\n", argv[1], modbus_strerror(errno));
		return 1;
	}

	const int listener = listen_on((uint16_t)atoi(argv[4]));

	if (listener < 0) {
		fprintf(stderr, "TCP port %s: %s\n", argv[4], strerror(errno));
		return 1;
	}
	puts("ready");
	fflush(stdout);
	serve(&gateway, listener);
	perror("accept");
	return 1;
}
