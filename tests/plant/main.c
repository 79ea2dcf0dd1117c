/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The runner: starts the processes of a plant, writes its trace, ends it. Itself it is not in it. */
#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/personality.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "real.h"
#include "shared.h"

#define BEGIN_NS PLANT_BEGIN_NS
#define WALL_S   INT64_C(1767225600) /* 2026-01-01 */
#define LOOK_NS  (PLANT_NS / 5)
#define STUCK_S                                                                                              \
	300 /* of the host, without a turn: whoever has the baton waits for what is not in the plant */
#define JOIN_MS        60000 /* of the host, from the start of a program */
#define CALL_WITHIN_NS (10 * PLANT_NS)
#define LINE_SIZE      4096
#define WORDS_MAX      64

enum exit_code { DONE, FAILED, WRONG_USAGE };

static const char help[] =
    "usage: plant --seed N --trace FILE WORLD\n"
    "\n"
    "Runs the processes of the file WORLD under one clock of their own, one at a time.\n"
    "Its lines are words with tabs between them; times are in seconds of the plant:\n"
    "\n"
    "  end      TIME\n"
    "  start    NAME TIME STDOUT STDERR PROGRAM [ARGUMENT]...\n"
    "  kill     NAME TIME CALLS [STORES [rare]]\n"
    "           at its call number CALLS from TIME on, if it makes it within 10 s,\n"
    "           or before its store number STORES behind that into memory that others see;\n"
    "           rare: after a second, and into what is not written often\n"
    "  power    NAME TIME CALLS\n"
    "           the same, with all others that what started it has brought;\n"
    "           the disk loses what was not synchronised\n"
    "  disk     FOLDER            is a disk: FOLDER.log says what changes it\n"
    "  full     TIME TO           the disk is full\n"
    "  refuses  TIME TO           half of what would change it fails\n"
    "  worn     TIME TO           half of what reads it fails\n"
    "  memory   NAME TIME CALLS FOR\n"
    "           it gets none for that long\n"
    "  starve   NAME TIME TO      it gets none until then when it begins\n"
    "  stop     NAME TIME CALLS FOR [STORES [rare]]\n"
    "           as kill: it does not run for that long\n"
    "  cut      PORT TIME TO      no octet passes the TCP port\n"
    "  lose     PORT TIME         nothing of its connections arrives any more; new ones can be made\n"
    "  delay    PORT LEAST MOST   what is sent over the TCP port is on its way so long,\n"
    "                             and longer if it is lost\n"
    "  host     NAME ADDRESS      it connects from this IPv4 address, and not from 127.0.0.1\n"
    "  drift    PPM               the calendar clock goes faster by that, or slower if it is below 0\n"
    "  leap     TIME BY           as step, as the kernel does it for a leap second: BY is -1 or 1\n"
    "  step     TIME BY           the calendar clock goes forward by that, or back if it is below 0\n"
    "\n"
    "Exit codes: 0 the end came, 1 a process ended by a fault of its own, or all are stuck,\n"
    "2 wrong usage or file.\n";

struct start {
	char *words[WORDS_MAX];
};

static struct plant *plant;
static struct start starts[PLANT_PROCESSES];
static char library[PATH_MAX], shared_path[PATH_MAX], link_path[PATH_MAX + 4];
static FILE *trace;

__attribute__((noreturn)) static void give_up(enum exit_code code, const char *what, const char *why)
{
	fprintf(stderr, "plant: %s: %s\n", what, why);
	unlink(shared_path);
	unlink(link_path);
	exit(code);
}

/* ---- the world --------------------------------------------------------------------------- */

static int64_t ns_of(const char *word)
{
	char *end;
	const double time_s = word ? strtod(word, &end) : -1;

	if (!word || *end || time_s < 0 || time_s > 1e9)
		give_up(WRONG_USAGE, word ? word : "a line", "expected a time in seconds");
	return (int64_t)(time_s * 1e9);
}

static uint64_t number_of(const char *word)
{
	char *end;
	const unsigned long long number = word ? strtoull(word, &end, 10) : 0;

	if (!word || !*word || *end)
		give_up(WRONG_USAGE, word ? word : "a line", "expected a number");
	return number;
}

static void add_start(char *words[], size_t count)
{
	const uint32_t process = plant_add(plant, PLANT_RUNNER);

	if (count < 6 || process == PLANT_RUNNER)
		give_up(WRONG_USAGE, "start", "expected a name, a time, two files and a program");
	for (size_t i = 0; i < count; i++)
		starts[process].words[i] = words[i] ? strdup(words[i]) : NULL;
	plant->processes[process].stopped_ns = BEGIN_NS + ns_of(words[2]);
	plant_name(plant, process, words[1]);
}

static void add_stores(struct plant_fault *fault, char *words[])
{
	if (!words[0])
		return;
	fault->stores = (uint32_t)number_of(words[0]);
	if (words[1] && strcmp(words[1], "rare") != 0)
		give_up(WRONG_USAGE, words[1], "expected nothing behind the stores, or rare");
	fault->rare = words[1];
}

static void add_fault(enum plant_fault_kind kind, char *words[], size_t count)
{
	struct plant_fault *fault = &plant->faults[plant->fault_count];

	if (plant->fault_count == PLANT_FAULTS)
		give_up(WRONG_USAGE, words[0], "too many faults");
	*fault = (struct plant_fault){.kind = kind, .from_ns = BEGIN_NS + ns_of(words[2])};
	if (kind == PLANT_CUT) {
		fault->port = (uint16_t)number_of(words[1]);
		fault->to_ns = BEGIN_NS + ns_of(words[3]);
	} else if (kind == PLANT_STARVES) {
		snprintf(fault->name, sizeof(fault->name), "%s", words[1]);
		fault->to_ns = BEGIN_NS + ns_of(words[3]);
	} else {
		snprintf(fault->name, sizeof(fault->name), "%s", words[1]);
		fault->calls = number_of(words[3]);
		fault->to_ns = fault->from_ns + CALL_WITHIN_NS;
	}
	if (kind == PLANT_STOP || kind == PLANT_MEMORY)
		fault->for_ns = ns_of(count > 4 ? words[4] : NULL);
	if (kind == PLANT_KILL)
		add_stores(fault, words + 4);
	if (kind == PLANT_STOP)
		add_stores(fault, words + 5);
	plant->fault_count++;
}

static void add_disk_fault(enum plant_fault_kind kind, char *words[])
{
	if (plant->fault_count == PLANT_FAULTS)
		give_up(WRONG_USAGE, words[0], "too many faults");
	plant->faults[plant->fault_count++] = (struct plant_fault){
	    .kind = kind, .from_ns = BEGIN_NS + ns_of(words[1]), .to_ns = BEGIN_NS + ns_of(words[2])};
}

static void set_disk(const char *path)
{
	if (!path || path[0] != '/' || strlen(path) >= sizeof(plant->disk))
		give_up(WRONG_USAGE, "disk", "expected a folder's whole path");
	strcpy(plant->disk, path);
}

static void add_loss(char *words[])
{
	if (plant->loss_count == PLANT_LOSSES)
		give_up(WRONG_USAGE, words[0], "too many losses");
	plant->losses[plant->loss_count++] =
	    (struct plant_loss){.port = (uint16_t)number_of(words[1]), .at_ns = BEGIN_NS + ns_of(words[2])};
}

static void add_delay(char *words[])
{
	const struct plant_delay delay = {(uint16_t)number_of(words[1]), ns_of(words[2]), ns_of(words[3])};

	if (plant->delay_count == PLANT_DELAYS || delay.most_ns < delay.least_ns || delay.most_ns == 0)
		give_up(WRONG_USAGE, words[0],
			"expected a port, and two times of which the second is longer");
	plant->delays[plant->delay_count++] = delay;
}

static void add_host(char *words[])
{
	struct plant_host *host = &plant->hosts[plant->host_count];
	struct in_addr address;

	if (plant->host_count == PLANT_HOSTS || !words[1] || !words[2] ||
	    inet_pton(AF_INET, words[2], &address) != 1)
		give_up(WRONG_USAGE, words[0], "expected a name and an IPv4 address");
	snprintf(host->name, sizeof(host->name), "%s", words[1]);
	host->address = ntohl(address.s_addr);
	plant->host_count++;
}

/* Below 0, too. */
static int64_t signed_ns_of(const char *word)
{
	const bool back = word && word[0] == '-';
	const int64_t by_ns = ns_of(word ? word + back : NULL);

	return back ? -by_ns : by_ns;
}

static void add_step(char *words[], bool leap)
{
	if (plant->step_count == PLANT_STEPS)
		give_up(WRONG_USAGE, words[0], "too many steps");
	plant->steps[plant->step_count++] = (struct plant_step){
	    .at_ns = BEGIN_NS + ns_of(words[1]), .by_ns = signed_ns_of(words[2]), .leap = leap};
}

static int by_time(const void *one, const void *other)
{
	const int64_t from_ns = ((const struct plant_fault *)one)->from_ns;
	const int64_t other_ns = ((const struct plant_fault *)other)->from_ns;

	return (from_ns > other_ns) - (from_ns < other_ns);
}

static void take_line(char *line)
{
	char *words[WORDS_MAX] = {NULL}, *rest = line;
	size_t count = 0;

	line[strcspn(line, "\n")] = '\0';
	for (char *word = strsep(&rest, "\t"); word && count < WORDS_MAX - 1; word = strsep(&rest, "\t"))
		words[count++] = word;
	if (strcmp(words[0], "end") == 0)
		plant->end_ns = BEGIN_NS + ns_of(words[1]);
	else if (strcmp(words[0], "start") == 0)
		add_start(words, count);
	else if (strcmp(words[0], "kill") == 0)
		add_fault(PLANT_KILL, words, count);
	else if (strcmp(words[0], "stop") == 0)
		add_fault(PLANT_STOP, words, count);
	else if (strcmp(words[0], "memory") == 0)
		add_fault(PLANT_MEMORY, words, count);
	else if (strcmp(words[0], "starve") == 0)
		add_fault(PLANT_STARVES, words, count);
	else if (strcmp(words[0], "power") == 0)
		add_fault(PLANT_POWER, words, count);
	else if (strcmp(words[0], "disk") == 0)
		set_disk(words[1]);
	else if (strcmp(words[0], "full") == 0)
		add_disk_fault(PLANT_FULL, words);
	else if (strcmp(words[0], "refuses") == 0)
		add_disk_fault(PLANT_REFUSES, words);
	else if (strcmp(words[0], "worn") == 0)
		add_disk_fault(PLANT_WORN, words);
	else if (strcmp(words[0], "cut") == 0)
		add_fault(PLANT_CUT, words, count);
	else if (strcmp(words[0], "lose") == 0)
		add_loss(words);
	else if (strcmp(words[0], "delay") == 0)
		add_delay(words);
	else if (strcmp(words[0], "host") == 0)
		add_host(words);
	else if (strcmp(words[0], "step") == 0)
		add_step(words, false);
	else if (strcmp(words[0], "leap") == 0)
		add_step(words, true);
	else if (strcmp(words[0], "drift") == 0)
		plant->drift_ppm = signed_ns_of(words[1]) / PLANT_NS;
	else
		give_up(WRONG_USAGE, words[0], "unknown word");
}

static void read_world(const char *path)
{
	FILE *file = fopen(path, "re");
	char line[LINE_SIZE];

	if (!file)
		give_up(WRONG_USAGE, path, strerror(errno));
	while (fgets(line, sizeof(line), file))
		take_line(line);
	fclose(file);
	qsort(plant->faults, plant->fault_count, sizeof(plant->faults[0]), by_time);
	if (plant->end_ns <= BEGIN_NS || plant->process_count == 0)
		give_up(WRONG_USAGE, path, "expected an end and a process");
}

/* ---- its processes ----------------------------------------------------------------------- */

static void make_shared(uint64_t seed)
{
	const int fd = open(shared_path, O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);

	if (fd < 0 || ftruncate(fd, sizeof(struct plant)) < 0 || fchmod(fd, 0666) < 0)
		give_up(FAILED, shared_path, strerror(errno));
	plant = mmap(NULL, sizeof(struct plant), PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
	if (plant == MAP_FAILED)
		give_up(FAILED, shared_path, strerror(errno));
	close(fd);
	plant->id = (uint32_t)getpid();
	plant->random = seed;
	plant->changes = 1;
	plant->now_ns = BEGIN_NS;
	plant->wall_ns = WALL_S * PLANT_NS - BEGIN_NS;
	plant->holder = PLANT_RUNNER;
}

static void redirect(const char *path, int fd, int flags)
{
	const int opened = open(path, flags, 0644);

	if (opened < 0 || dup2(opened, fd) < 0)
		give_up(FAILED, path, strerror(errno));
	close(opened);
}

/* The same addresses each time; of the environment nothing but what the plant says. */
__attribute__((noreturn)) static void execute(uint32_t process)
{
	char preload[PATH_MAX + 20], shared[PATH_MAX + 16], number[32];
	/* The C library copies memory by the same stores on each host. */
	static const char tunables[] = PLANT_TUNABLES_VARIABLE
	    "=glibc.cpu.hwcaps=-AVX2,-AVX512F,-AVX512VL,-ERMS,-FSRM,-AVX_Fast_Unaligned_Load";
	const char *const environment[] = {preload,
					   tunables,
					   shared,
					   number,
					   "PATH=/usr/bin:/bin",
					   "TZ=UTC",
					   "LC_ALL=C.UTF-8",
					   "PYTHONHASHSEED=0",
					   "PYTHONDONTWRITEBYTECODE=1",
					   NULL};
	char **words = starts[process].words;

	snprintf(preload, sizeof(preload), "LD_PRELOAD=%s", link_path);
	snprintf(shared, sizeof(shared), PLANT_SHARED_VARIABLE "=%s", shared_path);
	snprintf(number, sizeof(number), PLANT_PROCESS_VARIABLE "=%u", process);
	redirect("/dev/null", STDIN_FILENO, O_RDONLY);
	redirect(words[3], STDOUT_FILENO, O_WRONLY | O_CREAT | O_TRUNC);
	redirect(words[4], STDERR_FILENO, O_WRONLY | O_CREAT | O_TRUNC);
	real_syscall(SYS_close_range, 3, (long)UINT_MAX, 0, 0, 0, 0);
	prctl(PR_SET_PDEATHSIG, SIGKILL);
	personality(ADDR_NO_RANDOMIZE);
	execve(words[5], words + 5, (char *const *)environment);
	give_up(FAILED, words[5], strerror(errno));
}

static void wait_attached(uint32_t process)
{
	struct plant_process *started = &plant->processes[process];

	for (unsigned ms = 0; !atomic_load(&started->attached); ms++) {
		if (waitpid(started->pid, NULL, WNOHANG) > 0)
			give_up(FAILED, starts[process].words[5], "it ended before it was in the plant");
		if (ms == JOIN_MS)
			give_up(FAILED, starts[process].words[5], "it does not take the plant's library");
		nanosleep(&(struct timespec){.tv_nsec = 1000000}, NULL);
	}
}

/* The loader takes a blank or a colon of a path for the end of a name. */
static void link_library(void)
{
	snprintf(link_path, sizeof(link_path), "%s.so", shared_path);
	if (symlink(library, link_path) != 0)
		give_up(FAILED, link_path, strerror(errno));
}

static void start_all(void)
{
	for (uint32_t i = 0; i < plant->process_count; i++) {
		const pid_t pid = fork();

		if (pid == 0)
			execute(i);
		if (pid < 0)
			give_up(FAILED, "fork", strerror(errno));
		plant->processes[i].pid = pid;
		wait_attached(i);
	}
}

static void kill_all(void)
{
	for (uint32_t i = 0; i < plant->process_count; i++)
		if (plant->processes[i].alive && plant->processes[i].pid > 0)
			kill(plant->processes[i].pid, SIGKILL);
	while (waitpid(-1, NULL, 0) > 0)
		continue;
}

/* ---- while it runs ----------------------------------------------------------------------- */

static void write_trace(void)
{
	fwrite(plant->trace, 1, plant->trace_size, trace);
	plant->trace_size = 0;
}

/* Beside the world: of each life of a process its name, its number, descriptors and KiB at first, and in the end. */
static void write_accounts(const char *world)
{
	char path[PATH_MAX];
	FILE *file;

	snprintf(path, sizeof(path), "%s.accounts", world);
	file = fopen(path, "we");
	if (!file)
		give_up(FAILED, path, strerror(errno));
	for (uint32_t i = 0; i < plant->account_count; i++) {
		const struct plant_account *account = &plant->accounts[i];

		fprintf(file, "%s %u %u %u %u %u\n", account->name, account->life, account->first_descriptors,
			account->most_descriptors, account->first_kib, account->last_kib);
	}
	fclose(file);
}

/* Only a fault of its own ends a process while it has the baton. */
static bool holder_crashed(void)
{
	const uint32_t holder = atomic_load(&plant->holder);
	char path[64], state = 'X';
	FILE *file;

	if (holder == PLANT_RUNNER)
		return false;
	snprintf(path, sizeof(path), "/proc/%d/stat", plant->processes[holder].pid);
	file = fopen(path, "re");
	if (file && fscanf(file, "%*d (%*[^)]) %c", &state) != 1)
		state = '?';
	if (file)
		fclose(file);
	return (state == 'X' || state == 'Z') && holder == atomic_load(&plant->holder) &&
	       plant->processes[holder].alive;
}

static bool take_from_crashed(void)
{
	const uint32_t holder = atomic_load(&plant->holder);

	if (!holder_crashed())
		return false;
	fprintf(stderr, "plant: %s crashes\n", plant->processes[holder].name);
	plant_tell(plant, holder, "crashes");
	plant_bury(plant, holder);
	plant_pass(plant, PLANT_RUNNER);
	return true;
}

static enum exit_code watch(void)
{
	enum exit_code code = DONE;
	uint64_t turns = 0;
	int64_t still_ns = 0;

	while (!plant->ended) {
		plant_futex_wait(&plant->runner, 0, LOOK_NS);
		if (atomic_load(&plant->runner)) {
			write_trace();
			atomic_store(&plant->runner, 0);
			plant_futex_wake(&plant->runner);
			continue;
		}
		while (waitpid(-1, NULL, WNOHANG) > 0) /* also those whose parent has ended */
			continue;
		if (take_from_crashed())
			code = FAILED;
		still_ns = turns == atomic_load(&plant->turns) ? still_ns + LOOK_NS : 0;
		turns = atomic_load(&plant->turns);
		if (still_ns > STUCK_S * PLANT_NS) {
			fprintf(stderr, "plant: stuck at %s\n",
				plant->processes[atomic_load(&plant->holder)].name);
			return FAILED;
		}
	}
	return code;
}

static enum exit_code run(const char *world, const char *trace_path, uint64_t seed)
{
	enum exit_code code;

	trace = fopen(trace_path, "we");
	if (!trace)
		give_up(WRONG_USAGE, trace_path, strerror(errno));
	snprintf(shared_path, sizeof(shared_path), "%s.shared", world); /* it goes with the world's folder */
	make_shared(seed);
	read_world(world);
	prctl(PR_SET_CHILD_SUBREAPER, 1);
	link_library();
	start_all();
	plant_pass(plant, PLANT_RUNNER);
	code = watch();
	kill_all();
	write_trace();
	write_accounts(world);
	fclose(trace);
	unlink(shared_path);
	unlink(link_path);
	return code;
}

/* Beside this program. */
static bool find_library(void)
{
	const ssize_t size = readlink("/proc/self/exe", library, sizeof(library) - sizeof("libplant.so"));
	char *slash;

	if (size <= 0)
		return false;
	library[size] = '\0';
	slash = strrchr(library, '/');
	if (!slash)
		return false;
	memcpy(slash + 1, "libplant.so", sizeof("libplant.so"));
	return access(library, R_OK) == 0;
}

int main(int count, char **words)
{
	if (count == 2 && strcmp(words[1], "--help") == 0) {
		fputs(help, stdout);
		return DONE;
	}
	if (count != 6 || strcmp(words[1], "--seed") != 0 || strcmp(words[3], "--trace") != 0) {
		fputs(help, stderr);
		return WRONG_USAGE;
	}
	real_find();
	if (!find_library())
		give_up(FAILED, library, "no such file");
	return (int)run(words[5], words[4], number_of(words[2]));
}
