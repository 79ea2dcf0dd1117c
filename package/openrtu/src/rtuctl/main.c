/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <ctype.h>
#include <fcntl.h>
#include <getopt.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>

#include "config/near.h"
#include "iec104/counters.h"
#include "modbus/stats.h"
#include "rtuctl/rtuctl.h"

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))

enum {
	TAKES_COUNT = 1,
	TAKES_SELECT = 2,
	TAKES_PULSE = 4,
	TAKES_HISTOGRAM = 8,
	TAKES_SUGGEST = 16,
	TAKES_ONCE = 32,
	TAKES_DRY_RUN = 64,
	TAKES_SVG = 128,
	TAKES_DURATION = 256,
	TAKES_PCAPNG = 512, /* and follows */
};

struct command {
	const char *name;
	const char *arguments; /* as in the help */
	size_t least, most;    /* arguments */
	unsigned takes;
	const char *module; /* to attach as; NULL: an observer */
	const char *summary;
	const char *details;
	rtuctl_command *run;
};

static const struct command commands[] = {
    {"points", "[PATTERN]", 0, 1, 0, NULL, "points with address, value, quality and age",
     "PATTERN selects points by name: \"p3.67.*\", \"feeder7/*\". AGE is the time since the device was "
     "read.\n",
     rtuctl_points},
    {"top", "[PATTERN] [--once]", 0, 1, TAKES_ONCE, NULL, "modules, lines and points, refreshed each second",
     "PATTERN selects points by name. HEARTBEAT is the age of a module's last sign of life, CPU its share of "
     "one\n"
     "core, DEVICES the number of a line's devices that answer. Keys: q quits, i hides good points, arrows "
     "and\n"
     "page keys move. With --once, or without a terminal, it prints the table once, after a second. It uses "
     "no\n"
     "colours if NO_COLOR is in the environment.\n",
     rtuctl_top},
    {"show", "NAME", 1, 1, 0, NULL, "all about one point",
     "For a measured value it also shows the parameters in force, and those that a controlling station has\n"
     "loaded; for a counter, the last frozen reading.\n",
     rtuctl_show},
    {"watch", "[PATTERN] [--count N]", 0, 1, TAKES_COUNT, NULL, "changes as they happen, until Ctrl-C",
     "Prints each change of a matching point, modules going down and up, and the warnings of the log, which\n"
     "say why. Ends after N changes with --count.\n",
     rtuctl_watch},
    {"commands", "[PATTERN]", 0, 1, 0, NULL, "points that can be commanded, with the state of their command",
     "STATE is the state of the command: selection or execution. RESULT is the device's answer.\n",
     rtuctl_commands},
    {"modules", "[--histogram]", 0, 0, TAKES_HISTOGRAM, NULL, "the processes around the map",
     "RESTARTS counts restarts after a failure. On a board the last line says whether /data is in the "
     "flash.\n"
     "--histogram shows how late modules that scan woke at the beginning of a period, how long their scans\n"
     "took, and how many periods passed without one.\n",
     rtuctl_modules},
    {"module", "MODULE stop|start|restart", 2, 2, 0, "rtuctl", "stop, start or restart a module's process",
     "A module that was stopped stays so until it is started, or rtud is; its points are invalid meanwhile. "
     "The exit\n"
     "code is 0 only when it came about.\n",
     rtuctl_module},
    {"reload", "[FILE] [--dry-run]", 0, 1, TAKES_DRY_RUN, "rtuctl",
     "change the configuration while the gateway runs",
     "Without FILE, rtud reads its own file again. The next start of rtud reads that one, whatever FILE was. "
     "With "
     "--dry-run\n"
     "it only says what would change. What did not change does not notice; what breaks goes back by "
     "itself.\n",
     rtuctl_reload},
    {"counters", "[MODULE]", 0, 1, 0, NULL, "the counters of the modules, by name",
     "MODULE is a name as \"rtuctl modules\" has it. Counters count since the gateway started and wrap at "
     "2^32.\n",
     rtuctl_counters},
    {"clock", "", 0, 0, 0, NULL, "the gateway's clock, and where its time is from",
     "VALID says whether time tags are valid. ERROR is the largest possible error while the system's clock\n"
     "is synchronised. LEFT is how long time tags stay valid after it no longer is.\n",
     rtuctl_clock},
    {"lines", "[--histogram | --suggest]", 0, 0, TAKES_HISTOGRAM | TAKES_SUGGEST, NULL,
     "lines and their devices, with counters",
     "Counters count since the module started and wrap at 2^32. The second table shows what went wrong on "
     "the\n"
     "lines. The fourth one shows what the gateway has learned of the devices: how fast they answer, the "
     "longest\n"
     "reads they give, and what they refuse. A last one shows what devices say that they are, and where the\n"
     "configuration expects something else.\n"
     "--histogram shows how late the lines' process woke, how long transactions took, which priority and "
     "memory\n"
     "the kernel has given that process, and a verdict.\n"
     "--suggest prints what it has learned as keys for the configuration, with the reasons.\n",
     rtuctl_lines},
    {"frames", "[PORT] [--follow] [--count N] [--pcapng FILE]", 0, 1, TAKES_COUNT | TAKES_PCAPNG, NULL,
     "what went over the lines last, in both directions",
     "PORT is the number of one line. > is what the gateway has sent, < what it has received; + that there "
     "are more\n"
     "octets, which --json prints. Some 8 KiB of each line are kept. --follow goes on with what comes, until "
     "Ctrl-C;\n"
     "--count ends it after N frames, or prints the newest N. --pcapng writes into FILE for Wireshark, which "
     "decodes it\n"
     "without settings; FILE - is the standard output: rtuctl frames --follow --pcapng - | wireshark -k -i "
     "-\n",
     rtuctl_frames},
    {"iec104", "[TABLE]", 0, 1, 0, NULL, "controlling stations: connections, event queues, counters",
     "TABLE is connections, queues or counters; without it, all of them. A queue's name is that of its\n"
     "redundancy group, or an address. WAITING events are not acknowledged; UNACKED is how many of them were "
     "sent.\n"
     "Counters count since the gateway started and wrap at 2^32.\n",
     rtuctl_iec104},
    {"iec61850", "[TABLE]", 0, 1, 0, NULL,
     "IEC 61850: clients, their report control blocks, what waits, GOOSE",
     "TABLE is associations, blocks, queues, published or subscribed; without it, all of them. Blocks\n"
     "are those that clients have reserved; SQNUM is the number of the next report. Queues are buffered\n"
     "blocks that a client has used, whether one has them now or not. WAITING counts the changes, of all\n"
     "points, behind the last one told, OLDEST is the age of the first; BUFOVFL says that some are lost,\n"
     "which is not told yet. KEPT of LIMIT places are in use of the buffer that all queues share.\n"
     "STNUM counts states: of a subscription those that were taken since the module started. HOLDS says\n"
     "whether what was received is still believed.\n",
     rtuctl_iec61850},
    {"gps", "[RECEIVER]", 0, 1, 0, NULL, "receivers of positions, with the sky above one of them",
     "With RECEIVER it also draws the satellites of the last burst: north is up, the rim is the horizon, and "
     "* "
     "stands\n"
     "beside a satellite that is used. Counters count since the module started.\n",
     rtuctl_gps},
    {"logic", "[PROGRAM]", 0, 1, 0, NULL, "programs of Structured Text: scans, faults, variables",
     "FILE is the CRC-32 of the compiled program. LATE counts periods without a scan. Counters count since "
     "the gateway\n"
     "started. With PROGRAM, --json has its variables as well, for openrtu logic watch.\n",
     rtuctl_logic},
    {"synch", "[TABLE] [--svg FILE]", 0, 1, TAKES_SVG, NULL, "the net: its marking, and who waits for what",
     "TABLE is modules, places or transitions; without it, all of them. SINCE is how long a module has "
     "waited\n"
     "for its transition. DEATHS counts those in a scan, STOOD IN scans that were fired for a dead module, "
     "LEFT\n"
     "OUT ends of a line's scans that could not fire, LOST tokens for which a place had no room.\n"
     "--svg draws the net into FILE: green transitions can fire, a yellow module waits, a red one is dead.\n",
     rtuctl_synch},
    {"events", "[--count N]", 0, 0, TAKES_COUNT, NULL, "the events that are still kept, oldest first",
     "With --count only the newest N.\n", rtuctl_events},
    {"log", "[--count N]", 0, 0, TAKES_COUNT, NULL, "the modules' log lines that are still kept",
     "With --count only the newest N.\n", rtuctl_log},
    {"set", "NAME VALUE [--select] [--pulse LENGTH]", 2, 2, TAKES_SELECT | TAKES_PULSE, "rtuctl",
     "command a point and wait for the device's answer",
     "VALUE is on or off for single and double points, a number otherwise (a fraction of 1 for normalized "
     "ones).\n"
     "--select selects before it executes; --pulse short or --pulse long switches off again after the "
     "point's\n"
     "short or long pulse. The exit code is 0 only when the device has done it.\n",
     rtuctl_set},
    {"step", "NAME higher|lower [--select]", 2, 2, TAKES_SELECT, "rtuctl", "move a point's value by its step",
     "For points with a step in the configuration. --select selects before it executes.\n", rtuctl_step},
    {"force", "NAME VALUE [--for TIME]", 2, 2, TAKES_DURATION, "rtuctl",
     "let a point show a value, whatever its owner says",
     "All who read the point see VALUE as substituted (SB), and its owner goes on below. It commands no "
     "device. It\n"
     "ends after TIME (90s, 10m, 2h; without --for after 10 minutes), with unforce, or with rtud. The\n"
     "configuration has to allow it: force_max_s.\n",
     rtuctl_force},
    {"unforce", "NAME", 1, 1, 0, "rtuctl", "let a point show again what its owner says",
     "\"rtuctl forces\" lists what is forced.\n", rtuctl_unforce},
    {"forces", "", 0, 0, 0, NULL, "the points that are forced, and what is below",
     "BELOW is what the point's owner says meanwhile, with its QUALITY; LEFT is when the force ends by "
     "itself.\n",
     rtuctl_forces},
};

struct line {
	struct rtuctl_request request;
	const struct command *command;
	size_t argument_count;
	bool help, version, completion, counted;
};

/* ---- help -------------------------------------------------------------------------------- */

static void print_help(void)
{
	puts("usage: rtuctl [--map DIR] [--json] COMMAND [ARGUMENT]...\n");
	for (size_t i = 0; i < COUNT(commands); i++)
		printf("  %-9s %-46s %s\n", commands[i].name, commands[i].arguments, commands[i].summary);
	puts("\n"
	     "  --map DIR   folder of the point map [$OPENRTU_MAP, else /run/openrtu]\n"
	     "  --json      for scripts: one array; one object a line for watch, events, frames, log, set "
	     "and step\n"
	     "  --help      this text, or after a command that command's\n"
	     "  --version   the version\n"
	     "  --completion  the completion of bash, for its folder of completions\n"
	     "\n"
	     "Exit code: 0 done, 1 nothing found or refused, 2 wrong usage or no map.");
}

static void print_command_help(const struct command *command)
{
	printf("usage: rtuctl [--map DIR] [--json] %s %s\n\n%c%s.\n\n%s\n", command->name, command->arguments,
	       toupper((unsigned char)command->summary[0]), command->summary + 1, command->details);
}

/* ---- completion -------------------------------------------------------------------------- */

/* The command whose first column has what a placeholder of the help stands for. */
static const char *lister_of(const struct command *command, const char *word, size_t size)
{
	static const struct {
		const char *word, *lister;
	} placeholders[] = {{"PATTERN", "points"}, {"NAME", "points"},  {"MODULE", "modules"},
			    {"PORT", "lines"},     {"RECEIVER", "gps"}, {"PROGRAM", "logic"}};
	const char *lister = NULL;

	for (size_t i = 0; i < COUNT(placeholders); i++)
		if (strlen(placeholders[i].word) == size && strncmp(placeholders[i].word, word, size) == 0)
			lister = placeholders[i].lister;
	/* Who sends commands names a point that takes them. */
	if (command->module != NULL && lister != NULL && strcmp(lister, "points") == 0)
		lister = "commands";
	return lister;
}

/* What is no placeholder is to be typed as it stands there. */
static void print_words(const struct command *command)
{
	static const char brackets[] = "[] |";
	const char *word = command->arguments;

	printf("\t%s) words=\"--help", command->name);
	while (*(word += strspn(word, brackets)) != '\0') {
		size_t size = strcspn(word, brackets);
		const char *lister = lister_of(command, word, size);

		if (lister != NULL)
			printf(" $(_rtuctl_names %s)", lister);
		else if (!isupper((unsigned char)word[0]))
			printf(" %.*s", (int)size, word);
		word += size;
	}
	puts("\" ;;");
}

static void print_completion(void)
{
	puts("# Completion of rtuctl in bash, made by rtuctl --completion.\n"
	     "_rtuctl_names()\n{\n"
	     "\trtuctl \"${folder[@]}\" \"$1\" 2>/dev/null | awk 'NR == 1 { next } !NF { exit } { print $1 "
	     "}'\n"
	     "}\n\n"
	     "_rtuctl()\n{\n"
	     "\tlocal word=${COMP_WORDS[COMP_CWORD]} command='' words='' folder=() i\n\n"
	     "\tcase ${COMP_WORDS[COMP_CWORD - 1]} in\n"
	     "\t--map) mapfile -t COMPREPLY < <(compgen -d -- \"$word\"); return ;;\n"
	     "\t--pulse) mapfile -t COMPREPLY < <(compgen -W 'short long' -- \"$word\"); return ;;\n"
	     "\t--count | --for) return ;;\n"
	     "\tesac\n"
	     "\tfor ((i = 1; i < COMP_CWORD; i++)); do\n"
	     "\t\tcase ${COMP_WORDS[i]} in\n"
	     "\t\t--map) folder=(--map \"${COMP_WORDS[++i]}\") ;;\n"
	     "\t\t-*) ;;\n"
	     "\t\t*) command=${command:-${COMP_WORDS[i]}} ;;\n"
	     "\t\tesac\n"
	     "\tdone\n"
	     "\tcase $command in");
	for (size_t i = 0; i < COUNT(commands); i++)
		print_words(&commands[i]);
	fputs("\t'') words=\"--map --json --help --version", stdout);
	for (size_t i = 0; i < COUNT(commands); i++)
		printf(" %s", commands[i].name);
	puts("\" ;;\n"
	     "\tesac\n"
	     "\tCOMPREPLY=()\n" /* not by compgen -W, which would run a name like $(reboot) */
	     "\tfor i in $words; do\n"
	     "\t\tif [[ $i == \"$word\"* ]]; then COMPREPLY+=(\"$i\"); fi\n"
	     "\tdone\n"
	     "}\n\n"
	     "complete -F _rtuctl rtuctl");
}

/* ---- wrong usage ------------------------------------------------------------------------- */

static int wrong_usage(const struct command *command, const char *what, const char *which)
{
	fprintf(stderr, "rtuctl: %s%s: try \"rtuctl %s%s--help\"\n", what, which,
		command ? command->name : "", command ? " " : "");
	return RTUCTL_USAGE;
}

static int not_for(const struct command *command, const char *option)
{
	fprintf(stderr, "rtuctl: %s takes no %s: try \"rtuctl %s --help\"\n", command->name, option,
		command->name);
	return RTUCTL_USAGE;
}

static int unknown_command(const char *word)
{
	struct near best = {.word = NULL};

	for (size_t i = 0; i < COUNT(commands); i++)
		near_consider(&best, word, commands[i].name);
	fprintf(stderr, "rtuctl: unknown command %s", word);
	if (near_enough(&best))
		fprintf(stderr, ", did you mean %s?\n", best.word);
	for (size_t i = 0; i < COUNT(commands) && !near_enough(&best); i++)
		fprintf(stderr, "%s%s", i == 0 ? ", expected one of " : ", ", commands[i].name);
	fputs(near_enough(&best) ? "" : ": try \"rtuctl --help\"\n", stderr);
	return RTUCTL_USAGE;
}

/* ---- the command line -------------------------------------------------------------------- */

static const struct command *find_command(const char *name)
{
	for (size_t i = 0; i < COUNT(commands); i++)
		if (strcmp(commands[i].name, name) == 0)
			return &commands[i];
	return NULL;
}

/* A negative number is a value, not an option. */
static bool is_option(const char *word)
{
	return word[0] == '-' && !isdigit((unsigned char)word[1]) && word[1] != '.';
}

static bool parse_count(const char *text, struct line *line)
{
	char *end;

	line->request.count = strtoul(text, &end, 10);
	line->counted = true;
	return isdigit((unsigned char)text[0]) && *end == '\0' && line->request.count > 0;
}

static const struct option options[] = {
    {"map", required_argument, NULL, 'm'},
    {"json", no_argument, NULL, 'j'},
    {"count", required_argument, NULL, 'c'},
    {"select", no_argument, NULL, 's'},
    {"pulse", required_argument, NULL, 'p'},
    {"histogram", no_argument, NULL, 'g'},
    {"suggest", no_argument, NULL, 'u'},
    {"once", no_argument, NULL, 'o'},
    {"svg", required_argument, NULL, 'v'},
    {"dry-run", no_argument, NULL, 'd'},
    {"follow", no_argument, NULL, 'w'},
    {"pcapng", required_argument, NULL, 'P'},
    {"for", required_argument, NULL, 'f'},
    {"help", no_argument, NULL, 'h'},
    {"version", no_argument, NULL, 'V'},
    {"completion", no_argument, NULL, 'C'},
    {NULL, 0, NULL, 0},
};

static int take_option(struct line *line, int argc, char **argv)
{
	switch (getopt_long(argc, argv, "+", options, NULL)) {
	case 'm':
		line->request.dir = optarg;
		return RTUCTL_DONE;
	case 'j':
		line->request.json = true;
		return RTUCTL_DONE;
	case 'c':
		return parse_count(optarg, line)
			   ? RTUCTL_DONE
			   : wrong_usage(line->command, "--count needs a number from 1 on, not ", optarg);
	case 's':
		line->request.select = true;
		return RTUCTL_DONE;
	case 'p':
		line->request.pulse = optarg;
		return RTUCTL_DONE;
	case 'g':
		line->request.histogram = true;
		return RTUCTL_DONE;
	case 'u':
		line->request.suggest = true;
		return RTUCTL_DONE;
	case 'o':
		line->request.once = true;
		return RTUCTL_DONE;
	case 'v':
		line->request.svg = optarg;
		return RTUCTL_DONE;
	case 'd':
		line->request.dry_run = true;
		return RTUCTL_DONE;
	case 'w':
		line->request.follow = true;
		return RTUCTL_DONE;
	case 'P':
		line->request.pcapng = optarg;
		return RTUCTL_DONE;
	case 'f':
		line->request.duration = optarg;
		return RTUCTL_DONE;
	case 'h':
		line->help = true;
		return RTUCTL_DONE;
	case 'V':
		line->version = true;
		return RTUCTL_DONE;
	case 'C':
		line->completion = true;
		return RTUCTL_DONE;
	default:
		return wrong_usage(line->command, "unknown option or missing value: ", argv[optind - 1]);
	}
}

static int take_word(struct line *line, const char *word)
{
	if (line->command == NULL) {
		line->command = find_command(word);
		return line->command != NULL ? RTUCTL_DONE : unknown_command(word);
	}
	if (line->argument_count == line->command->most)
		return wrong_usage(line->command, "one argument too many: ", word);
	line->request.arguments[line->argument_count++] = word;
	return RTUCTL_DONE;
}

static int check_line(const struct line *line)
{
	if (line->help || line->version || line->completion)
		return RTUCTL_DONE;
	if (line->command == NULL)
		return wrong_usage(NULL, "a command is missing", "");
	if (line->argument_count < line->command->least)
		return wrong_usage(line->command, "an argument is missing, expected ",
				   line->command->arguments);
	if (line->counted && !(line->command->takes & TAKES_COUNT))
		return not_for(line->command, "--count");
	if (line->request.select && !(line->command->takes & TAKES_SELECT))
		return not_for(line->command, "--select");
	if (line->request.histogram && !(line->command->takes & TAKES_HISTOGRAM))
		return not_for(line->command, "--histogram");
	if (line->request.suggest && !(line->command->takes & TAKES_SUGGEST))
		return not_for(line->command, "--suggest");
	if (line->request.once && !(line->command->takes & TAKES_ONCE))
		return not_for(line->command, "--once");
	if (line->request.svg != NULL && !(line->command->takes & TAKES_SVG))
		return not_for(line->command, "--svg");
	if (line->request.follow && !(line->command->takes & TAKES_PCAPNG))
		return not_for(line->command, "--follow");
	if (line->request.pcapng != NULL && !(line->command->takes & TAKES_PCAPNG))
		return not_for(line->command, "--pcapng");
	if (line->request.pcapng != NULL && line->request.json)
		return wrong_usage(line->command, "frames takes --pcapng or --json, not both", "");
	if (line->request.dry_run && !(line->command->takes & TAKES_DRY_RUN))
		return not_for(line->command, "--dry-run");
	if (line->request.json && line->command->takes & TAKES_ONCE)
		return wrong_usage(line->command, "top prints no JSON, but points, lines and modules do", "");
	if (line->request.suggest && line->request.histogram)
		return wrong_usage(line->command, "lines takes --histogram or --suggest, not both", "");
	if (line->request.pulse != NULL && !(line->command->takes & TAKES_PULSE))
		return not_for(line->command, "--pulse");
	if (line->request.duration != NULL && !(line->command->takes & TAKES_DURATION))
		return not_for(line->command, "--for");
	return RTUCTL_DONE;
}

static int parse(struct line *line, int argc, char **argv)
{
	int result = RTUCTL_DONE;

	opterr = 0;
	while (result == RTUCTL_DONE && optind < argc) {
		if (is_option(argv[optind]))
			result = take_option(line, argc, argv);
		else
			result = take_word(line, argv[optind++]);
	}
	return result == RTUCTL_DONE ? check_line(line) : result;
}

/* ---- running ----------------------------------------------------------------------------- */

/*
 * Two requesters at once would take each other's answers from the one segment. The lock ends with the process; a folder
 * without a map is map_attach's to complain about.
 */
static bool lock_requester(const char *dir, const char *module)
{
	char path[PATH_MAX];
	int fd;

	snprintf(path, sizeof(path), "%s/%s.seg", dir, module);
	fd = open(path, O_RDONLY | O_CLOEXEC);
	return fd < 0 || flock(fd, LOCK_EX | LOCK_NB) == 0;
}

static int report_no_map(const struct line *line, const char *error)
{
	char ignored[MAP_ERROR_SIZE];
	struct map *map;

	fprintf(stderr, "rtuctl: %s\n", error);
	if (line->command->module != NULL && map_attach(&map, line->request.dir, NULL, ignored) == 0) {
		fputs("You may read the map. To command, be root or the user that runs rtud.\n", stderr);
		map_detach(map);
	} else {
		fputs("Start the gateway with \"rtud FILE\", or name its map's folder with --map DIR or "
		      "OPENRTU_MAP.\n",
		      stderr);
	}
	return RTUCTL_USAGE;
}

static int run(const struct line *line)
{
	const char *dir = line->request.dir, *module = line->command->module;
	char error[MAP_ERROR_SIZE];
	struct map *map;
	int result;

	if (module != NULL && !lock_requester(dir, module)) {
		fputs("rtuctl: another rtuctl is waiting for the answer to its command: try again when it "
		      "has ended\n",
		      stderr);
		return RTUCTL_FAILED;
	}
	if (map_attach(&map, dir, module, error) < 0)
		return report_no_map(line, error);
	if (!modbus_is_known(map) || !iec104_is_known(map)) {
		fputs("rtuctl: the map has records of other sizes: use the rtuctl of rtud's version\n",
		      stderr);
		map_detach(map);
		return RTUCTL_USAGE;
	}
	if (!map_alive(map, MAP_RTUD))
		fputs("rtuctl: rtud does not run: this is what it left\n", stderr);
	result = line->command->run(map, &line->request);
	map_detach(map);
	return result;
}

int main(int argc, char **argv)
{
	const char *dir = getenv("OPENRTU_MAP");
	struct line line = {.request.dir = dir != NULL ? dir : "/run/openrtu"};
	int result = parse(&line, argc, argv);

	if (result != RTUCTL_DONE)
		return result;
	if (line.version)
		puts("rtuctl (OpenRTU) " OPENRTU_VERSION);
	else if (line.completion)
		print_completion();
	else if (line.help && line.command != NULL)
		print_command_help(line.command);
	else if (line.help)
		print_help();
	else
		return run(&line);
	return RTUCTL_DONE;
}
