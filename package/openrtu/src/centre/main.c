/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <errno.h>
#include <getopt.h>
#include <inttypes.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <unistd.h>

#include "centre/consumer.h"
#include "centre/loop.h"
#include "centre/shards.h"
#include "centre/stations.h"
#include "config/schema.h"

#define FILES_BESIDE 16 /* open files beside the connections */

static const char usage[] =
    "usage: rtu-centre [OPTION]... FILE\n"
    "  or:  rtu-centre --check FILE\n"
#if OPENRTU_SCHEMA
    "  or:  rtu-centre --schema\n"
#endif
    "\n"
    "Polls the stations of IEC 60870-5-104 that FILE names, and hands what they say to one consumer on a "
    "Unix\n"
    "socket. --check reports every error in FILE instead, or what the stations take.\n"
#if OPENRTU_SCHEMA
    "--schema prints the JSON Schema of such a FILE.\n"
#endif
    "\n"
    "  --socket PATH    the socket, in the place of the one that FILE names; with several shards PATH.0, "
    "PATH.1 ...\n"
    "  --help           this text\n"
    "  --version        the version\n"
    "\n"
    "It stays in the foreground, logs to stderr, stops at SIGTERM or SIGINT and ignores SIGHUP. It needs no\n"
    "privileges.\n"
    "Exit code: 0 good, 1 errors were found or it could not start, 2 wrong usage, or FILE is not readable "
    "as\n"
    "JSON.\n";

struct arguments {
	const char *file, *socket;
	bool check, schema, help, version;
};

static bool parse(int argc, char **argv, struct arguments *arguments)
{
	static const struct option options[] = {
	    {"check", no_argument, NULL, 'c'},        {"schema", no_argument, NULL, 'S'},
	    {"socket", required_argument, NULL, 's'}, {"help", no_argument, NULL, 'h'},
	    {"version", no_argument, NULL, 'V'},      {NULL, 0, NULL, 0},
	};
	int option;

	while ((option = getopt_long(argc, argv, "", options, NULL)) != -1) {
		switch (option) {
		case 'c':
			arguments->check = true;
			break;
		case 's':
			arguments->socket = optarg;
			break;
		case 'S':
			arguments->schema = true;
			return true;
		case 'h':
			arguments->help = true;
			return true;
		case 'V':
			arguments->version = true;
			return true;
		default:
			return false;
		}
	}
	arguments->file = argv[optind];
	return optind + 1 == argc;
}

static int check(const struct centre_config *config)
{
	size_t octets = centre_octets_of_station(config);

	printf("stations: %" PRIu32 "; polls of them: %" PRIu32
	       "; memory: %zu octets a connection and %zu for %" PRIu32 " records",
	       config->station_count, config->poll_count, octets,
	       (size_t)config->batches * config->batch_records * sizeof(struct centre_record),
	       config->batches * config->batch_records);
	if (config->shards > 1)
		printf(" of each of %" PRIu32 " shards", config->shards);
	puts("");
	return 0;
}

/* A connection each. False: there may not be so many files. */
static bool allow_files(uint32_t links)
{
	struct rlimit limit;
	rlim_t needed = (rlim_t)links + FILES_BESIDE;

	if (getrlimit(RLIMIT_NOFILE, &limit) < 0 || limit.rlim_cur >= needed)
		return true;
	if (limit.rlim_max < needed) {
		fprintf(stderr,
			"rtu-centre: %" PRIu32
			" connections need %ju open files, %ju are allowed: raise the limit "
			"(ulimit -n, LimitNOFILE= of systemd)\n",
			links, (uintmax_t)needed, (uintmax_t)limit.rlim_max);
		return false;
	}
	limit.rlim_cur = needed;
	return setrlimit(RLIMIT_NOFILE, &limit) == 0;
}

static void say(enum map_log_level level, const char *peer, const char *text)
{
	(void)level;
	fprintf(stderr, "rtu-centre: %s%s%s\n", peer != NULL ? peer : "", peer != NULL ? ": " : "", text);
}

/* What the shards begin with. */
struct start {
	struct centre_config *config;
	char paths[CENTRE_SHARDS_MAX][CENTRE_SOCKET_SIZE];
	int listeners[CENTRE_SHARDS_MAX]; /* -1: none */
};

/* One path is taken as it is, of several each has its number. False: said on stderr. */
static bool name_sockets(struct start *start, const char *path)
{
	for (uint32_t i = 0; i < start->config->shards; i++) {
		char number[16] = "";
		int size;

		if (start->config->shards > 1)
			snprintf(number, sizeof(number), ".%" PRIu32, i);
		size = snprintf(start->paths[i], CENTRE_SOCKET_SIZE, "%s%s", path, number);
		if (size >= CENTRE_SOCKET_SIZE) {
			fprintf(stderr, "rtu-centre: %s%s: longer than %d characters\n", path, number,
				CENTRE_SOCKET_SIZE - 1);
			return false;
		}
	}
	return true;
}

/*
 * The sockets outlive the shards: a consumer may connect to one that is about to begin again. False: said on stderr.
 */
static bool listen_on_all(struct start *start)
{
	for (uint32_t i = 0; i < start->config->shards; i++) {
		start->listeners[i] = centre_consumer_listen(start->paths[i]);
		if (start->listeners[i] < 0)
			return false;
	}
	return true;
}

static void close_all(const struct start *start, bool unlinks)
{
	for (uint32_t i = 0; i < start->config->shards; i++) {
		if (start->listeners[i] < 0)
			continue;
		close(start->listeners[i]);
		if (unlinks)
			unlink(start->paths[i]);
	}
}

/* In its process, where the configuration becomes its own. */
static int run_shard(void *context, uint32_t shard, atomic_uint *turns)
{
	static struct channel_owner owner = {.controlling = true, .message = iec104_apdu_size, .say = say};
	static struct centre centre;
	struct start *start = context;
	struct centre_config *config = start->config;
	int listener = start->listeners[shard], code = 1;

	start->listeners[shard] = -1;
	if (config->shards > 1) {
		close_all(start, false);
		centre_config_take_shard(config, shard);
	}
	if (!allow_files(config->link_count))
		return 1;
	owner.tls = &config->tls;
	if (config->secure && !channel_start(&owner))
		return 1;
	if (centre_stations_init(&centre, config)) {
		code = centre_loop(&centre, listener, start->paths[shard], turns);
	} else {
		fprintf(stderr, "rtu-centre: no memory for %" PRIu32 " stations: %s\n", config->station_count,
			strerror(errno));
	}
	centre_stations_free(&centre);
	start->listeners[shard] = listener;
	return code;
}

static int run(struct centre_config *config, const char *path)
{
	static struct start start;
	atomic_uint turns = 0; /* that nobody watches: one process has no keeper */
	int code = 1;

	start.config = config;
	memset(start.listeners, -1, sizeof(start.listeners));
	if (path[0] == '\0') {
		fprintf(stderr, "rtu-centre: there is no socket: give \"socket\" in the file, or --socket\n");
		return 2;
	}
	if (!name_sockets(&start, path))
		return 2;
	prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0);
	if (listen_on_all(&start))
		code = config->shards > 1 ? centre_shards_keep(config->shards, run_shard, &start)
					  : run_shard(&start, 0, &turns);
	close_all(&start, true);
	return code;
}

static int print_schema(void)
{
#if OPENRTU_SCHEMA
	return config_print_schema(&centre_file_table, stdout) ? 0 : 1;
#else
	fputs("rtu-centre: --schema needs -Dschema=true\n", stderr);
	return 2;
#endif
}

int main(int argc, char **argv)
{
	struct arguments arguments = {.file = NULL};
	struct centre_config config;
	int code;

	if (!parse(argc, argv, &arguments)) {
		fputs(usage, stderr);
		return 2;
	}
	if (arguments.help || arguments.version) {
		fputs(arguments.help ? usage : "rtu-centre (OpenRTU) " OPENRTU_VERSION "\n", stdout);
		return 0;
	}
	if (arguments.schema)
		return print_schema();
	code = (int)centre_config_load(arguments.file, &config, stderr);
	if (code == CENTRE_CONFIG_GOOD)
		code = arguments.check
			   ? check(&config)
			   : run(&config, arguments.socket != NULL ? arguments.socket : config.socket);
	centre_config_free(&config);
	return code;
}
