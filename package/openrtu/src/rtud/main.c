/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <fcntl.h>
#include <getopt.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "rtud/config.h"
#include "rtud/plan.h"
#include "rtud/schema.h"
#include "rtud/scl.h"
#include "rtud/supervise.h"

#define UID_BASE 61200 /* systemd's range of users that need no account, 61184..65519 */

/* What meson's options of these names say. */
static const struct config_modules modules = {.iec104 = OPENRTU_IEC104,
					      .iec61850 = OPENRTU_IEC61850,
					      .web = OPENRTU_WEB,
					      .modbus = OPENRTU_MODBUS,
					      .snmp = OPENRTU_SNMP,
					      .tls = OPENRTU_TLS};

static const char usage[] =
    "usage: rtud [OPTION]... FILE\n"
    "  or:  rtud --check FILE\n"
    "  or:  rtud --plan FILE\n"
    "  or:  rtud --points FILE\n"
    "  or:  rtud --scl FILE\n"
#if OPENRTU_SCHEMA
    "  or:  rtud --schema\n"
#endif
    "\n"
    "Runs the gateway that the configuration FILE describes. --check reports every error in FILE instead,\n"
    "or each line's shortest scan; --plan the same, with the requests to each device; --points lists every\n"
    "point, by common address and IOA; --scl describes the server of IEC 61850 for an engineer's tools.\n"
#if OPENRTU_SCHEMA
    "--schema prints the JSON Schema of such a FILE, for an editor.\n"
#endif
    "\n"
    "  --csv            list as CSV, from which openrtu points makes a configuration   [the default]\n"
    "  --markdown       list as a table for an interoperability sheet\n"
    "  --cid            with --scl: a CID, with the IED's name and addresses; without it an ICD\n"
    "  --iid            the same as --cid, for a system tool: an IID\n"
    "  --edition E      with --scl: of IEC 61850-6, 2 or 2.1    [2.1]\n"
    "  --map DIR        folder of the point map, on a tmpfs     [/run/openrtu]\n"
    "  --dev DIR        folder of the serial devices            [/dev]\n"
    "  --modules DIR    folder of the module programs           [" OPENRTU_MODULES "]\n"
    "  --kept FILE      where the page keeps a configuration, which takes FILE's place  [FILE itself]\n"
    "  --uid-base N     as root: modules run as users N + 1 and on, group N; 0: as root  [61200]\n"
    "  --watchdog DEV   feed this watchdog while rtud is healthy; an orderly end stops it       [none]\n"
    "  --help           this text\n"
    "  --version        the version\n"
    "\n"
    "It stays in the foreground, logs to stderr, stops at SIGTERM or SIGINT, and reads FILE again at\n"
    "SIGHUP.\n"
    "Exit code: 0 good, 1 errors were found or it could not start, 2 wrong usage, FILE is not readable as\n"
    "JSON or needs a module that is not in this build.\n";

struct arguments {
	struct supervise_options supervise;
	const char *file;
	bool check;
	bool plan;
	bool points;
	bool scl, cid, edition_2;
	bool schema;
	enum config_list list;
	bool help;
	bool version;
};

static bool parse_uid(const char *text, uint32_t *uid)
{
	char *end;
	unsigned long number = strtoul(text, &end, 10);

	*uid = (uint32_t)number;
	return *text && !*end && number <= 4000000000ul;
}

static bool parse_edition(const char *text, bool *edition_2)
{
	*edition_2 = strcmp(text, "2") == 0;
	if (*edition_2 || strcmp(text, "2.1") == 0)
		return true;
	fprintf(stderr, "rtud: --edition %s: expected 2 or 2.1\n", text);
	return false;
}

static bool take_kept(const char *path, struct supervise_options *options)
{
	options->kept = path;
	if (path[0] == '/')
		return true;
	fprintf(stderr, "rtud: --kept %s: expected a whole path, as /data/site/config.json\n", path);
	return false;
}

static bool take_file(int argc, char **argv, struct arguments *arguments)
{
	arguments->file = argv[optind];
	if (optind == argc)
		fputs("rtud: the configuration FILE is missing\n", stderr);
	else if (optind + 1 < argc)
		fprintf(stderr, "rtud: one argument too many: %s\n", argv[optind + 1]);
	return optind + 1 == argc;
}

static const struct option known[] = {
    {"check", no_argument, NULL, 'c'},
    {"plan", no_argument, NULL, 'l'},
    {"points", no_argument, NULL, 't'},
    {"scl", no_argument, NULL, 's'},
    {"schema", no_argument, NULL, 'S'},
    {"cid", no_argument, NULL, 'i'},
    {"iid", no_argument, NULL, 'i'},
    {"edition", required_argument, NULL, 'e'},
    {"csv", no_argument, NULL, 'v'},
    {"markdown", no_argument, NULL, 'k'},
    {"map", required_argument, NULL, 'm'},
    {"dev", required_argument, NULL, 'd'},
    {"modules", required_argument, NULL, 'p'},
    {"kept", required_argument, NULL, 'K'},
    {"uid-base", required_argument, NULL, 'u'},
    {"watchdog", required_argument, NULL, 'w'},
    {"help", no_argument, NULL, 'h'},
    {"version", no_argument, NULL, 'V'},
    {NULL, 0, NULL, 0},
};

static bool parse(int argc, char **argv, struct arguments *arguments)
{
	int option;

	while ((option = getopt_long(argc, argv, "", known, NULL)) != -1) {
		switch (option) {
		case 'c':
			arguments->check = true;
			break;
		case 'l':
			arguments->check = arguments->plan = true;
			break;
		case 't':
			arguments->points = true;
			break;
		case 's':
			arguments->scl = true;
			break;
		case 'i':
			arguments->cid = true;
			break;
		case 'e':
			if (!parse_edition(optarg, &arguments->edition_2))
				return false;
			break;
		case 'v':
			arguments->list = CONFIG_CSV;
			break;
		case 'k':
			arguments->list = CONFIG_MARKDOWN;
			break;
		case 'm':
			arguments->supervise.map = optarg;
			break;
		case 'd':
			arguments->supervise.dev = optarg;
			break;
		case 'p':
			arguments->supervise.modules = optarg;
			break;
		case 'K':
			if (!take_kept(optarg, &arguments->supervise))
				return false;
			break;
		case 'u':
			if (!parse_uid(optarg, &arguments->supervise.uid_base))
				return false;
			break;
		case 'w':
			arguments->supervise.watchdog = optarg;
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
	return take_file(argc, argv, arguments);
}

/* Whoever starts rtud without them: no segment or serial port may get the number that messages are written to. */
static void open_standard_streams(void)
{
	int fd;

	do
		fd = open("/dev/null", O_RDWR);
	while (fd >= 0 && fd <= STDERR_FILENO);
	close(fd);
}

/* A kept one that is wrong, whoever wrote it, is no reason for a gateway that does not start. */
static enum config_result load(const struct arguments *arguments, struct map_config *config)
{
	const char *kept = arguments->supervise.kept;

	if (kept != NULL && access(kept, F_OK) == 0) {
		fprintf(stderr, "rtud: %s is read in place of %s (--kept)\n", kept, arguments->file);
		if (config_load(arguments->file, kept, modules, config, stderr) == CONFIG_GOOD)
			return CONFIG_GOOD;
		config_free(config);
		fprintf(stderr, "rtud: %s is not used, %s itself is\n", kept, arguments->file);
	}
	return config_load(arguments->file, NULL, modules, config, stderr);
}

static int run(const struct arguments *arguments)
{
	struct supervise_options options = arguments->supervise;
	struct map_config config;
	enum config_result result = load(arguments, &config);
	int code;

	if (result != CONFIG_GOOD)
		return result;
	options.file = arguments->file;
	options.build = modules;
	code = supervise(&config, &options);
	config_free(&config);
	return code;
}

/* What a start would decide before it begins a process. */
static int check(const struct arguments *arguments)
{
	struct map_config config;
	int result = config_load(arguments->file, NULL, modules, &config, stderr);

	if (result == CONFIG_GOOD && !plan_modules(&config, arguments->supervise.map, stderr))
		result = CONFIG_WRONG;
	if (result == CONFIG_GOOD)
		plan_note_programs(&config, arguments->supervise.modules, stderr);
	if (result == CONFIG_GOOD)
		result = config_print(arguments->file, &config, arguments->plan);
	config_free(&config);
	return result;
}

static int print_scl(const struct arguments *arguments)
{
#if OPENRTU_IEC61850
	const struct cid_form form = {.configured = arguments->cid, .edition_2 = arguments->edition_2};

	return scl_print(arguments->file, modules, form);
#else
	(void)arguments;
	fputs("rtud: --scl needs rtu-iec61850: build with -Diec61850=true\n", stderr);
	return CONFIG_UNUSABLE;
#endif
}

static int print_schema(void)
{
#if OPENRTU_SCHEMA
	return schema_print(stdout) ? CONFIG_GOOD : CONFIG_WRONG;
#else
	fputs("rtud: --schema needs -Dschema=true, which no board has\n", stderr);
	return CONFIG_UNUSABLE;
#endif
}

int main(int argc, char **argv)
{
	struct arguments arguments = {
	    .supervise = {.map = "/run/openrtu",
			  .dev = "/dev",
			  .modules = OPENRTU_MODULES,
			  .uid_base = geteuid() == 0 ? UID_BASE : 0},
	};

	open_standard_streams();
	if (!parse(argc, argv, &arguments)) {
		fputs("rtud: try \"rtud --help\"\n", stderr);
		return CONFIG_UNUSABLE;
	}
	if (arguments.help) {
		fputs(usage, stdout);
		return 0;
	}
	if (arguments.version) {
		puts("rtud (OpenRTU) " OPENRTU_VERSION);
		return 0;
	}
	if (arguments.schema)
		return print_schema();
	if (arguments.scl)
		return print_scl(&arguments);
	if (arguments.points)
		return config_points(arguments.file, modules, arguments.list);
	return arguments.check ? check(&arguments) : run(&arguments);
}
