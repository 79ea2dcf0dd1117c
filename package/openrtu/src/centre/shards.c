/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "centre/shards.h"

#include <errno.h>
#include <inttypes.h>
#include <signal.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "map/time_ns.h"

#define AGAIN_NS NS_PER_S /* between two starts of a shard */
#define LOOK_NS  NS_PER_S /* between two looks at the turns of all */

struct shard {
	pid_t pid; /* 0: it does not run */
	int64_t begun_ns;
	unsigned turns_seen;
	unsigned looks; /* without a turn: not seconds, which pass on a starved host, too */
};

struct shards {
	struct shard each[CENTRE_SHARDS_MAX];
	atomic_uint *turns; /* of each; shared with its process */
	uint32_t count;
	centre_shard *run;
	void *context;
	int64_t look_ns; /* the next */
	sigset_t signals, before;
	bool stop;
	int code;
};

static int64_t now_ns(void)
{
	struct timespec time;

	clock_gettime(CLOCK_MONOTONIC, &time);
	return time.tv_sec * NS_PER_S + time.tv_nsec;
}

/* In the shard's process: it ends with its parent. */
static int be(const struct shards *shards, uint32_t shard, pid_t parent)
{
	prctl(PR_SET_PDEATHSIG, SIGTERM);
	sigprocmask(SIG_SETMASK, &shards->before, NULL);
	if (getppid() != parent)
		return 1; /* which was gone before the line above */
	return shards->run(shards->context, shard, &shards->turns[shard]);
}

static void start(struct shards *shards, uint32_t shard)
{
	const pid_t parent = getpid();
	pid_t pid;

	shards->each[shard].begun_ns = now_ns();
	shards->each[shard].looks = 0;
	pid = fork();
	if (pid == 0)
		_exit(be(shards, shard, parent));
	if (pid < 0)
		fprintf(stderr, "rtu-centre: shard %" PRIu32 " cannot be started: %s; it is tried again\n",
			shard, strerror(errno));
	else
		shards->each[shard].pid = pid;
}

/* Starts what does not run and may; when the next one may, INT64_MAX: all run. */
static int64_t start_due(struct shards *shards)
{
	int64_t next_ns = INT64_MAX;

	for (uint32_t i = 0; i < shards->count; i++) {
		int64_t due_ns = shards->each[i].begun_ns + AGAIN_NS;

		if (shards->each[i].pid != 0)
			continue;
		if (shards->each[i].begun_ns == 0 || now_ns() >= due_ns)
			start(shards, i);
		if (shards->each[i].pid == 0)
			next_ns = earlier(next_ns, shards->each[i].begun_ns + AGAIN_NS);
	}
	return next_ns;
}

static void look_at(struct shards *shards, uint32_t shard)
{
	struct shard *each = &shards->each[shard];
	unsigned turns = atomic_load_explicit(&shards->turns[shard], memory_order_relaxed);

	each->looks = turns == each->turns_seen ? each->looks + 1 : 0;
	each->turns_seen = turns;
	if (each->pid == 0 || each->looks < CENTRE_SHARD_LOOKS)
		return;
	fprintf(stderr, "rtu-centre: shard %" PRIu32 " has made no turn for %d s and is killed\n", shard,
		CENTRE_SHARD_LOOKS);
	each->looks = 0;
	kill(each->pid, SIGKILL);
}

/* When the next look is due. */
static int64_t look_due(struct shards *shards)
{
	if (now_ns() >= shards->look_ns) {
		for (uint32_t i = 0; i < shards->count; i++)
			look_at(shards, i);
		shards->look_ns = now_ns() + LOOK_NS;
	}
	return shards->look_ns;
}

static void note_end(struct shards *shards, uint32_t shard, int status)
{
	shards->each[shard].pid = 0;
	if (shards->stop)
		return;
	if (WIFSIGNALED(status)) {
		fprintf(stderr,
			"rtu-centre: shard %" PRIu32
			" was ended by signal %d; its stations are without a centre "
			"until it has begun again\n",
			shard, WTERMSIG(status));
		return;
	}
	shards->stop = true;
	shards->code = WEXITSTATUS(status);
}

static void reap(struct shards *shards)
{
	int status;
	pid_t pid;

	while ((pid = waitpid(-1, &status, WNOHANG)) > 0)
		for (uint32_t i = 0; i < shards->count; i++)
			if (shards->each[i].pid == pid)
				note_end(shards, i, status);
}

static void wait_until(struct shards *shards, int64_t due_ns)
{
	const int64_t left_ns = later(0, due_ns - now_ns());
	const struct timespec time = {left_ns / NS_PER_S, (long)(left_ns % NS_PER_S)};
	int signal = sigtimedwait(&shards->signals, NULL, &time);

	if (signal == SIGTERM || signal == SIGINT)
		shards->stop = true;
	reap(shards);
}

static bool any_runs(const struct shards *shards)
{
	for (uint32_t i = 0; i < shards->count; i++)
		if (shards->each[i].pid != 0)
			return true;
	return false;
}

static void stop_all(struct shards *shards)
{
	for (uint32_t i = 0; i < shards->count; i++)
		if (shards->each[i].pid != 0)
			kill(shards->each[i].pid, SIGTERM);
	while (any_runs(shards))
		wait_until(shards, look_due(shards));
}

int centre_shards_keep(uint32_t count, centre_shard *run, void *context)
{
	struct shards shards = {.count = count, .run = run, .context = context};

	shards.turns = mmap(NULL, count * sizeof(*shards.turns), PROT_READ | PROT_WRITE,
			    MAP_SHARED | MAP_ANONYMOUS, -1, 0);
	if (shards.turns == MAP_FAILED) {
		fprintf(stderr, "rtu-centre: no memory for its shards: %s\n", strerror(errno));
		return 1;
	}
	sigemptyset(&shards.signals);
	sigaddset(&shards.signals, SIGTERM);
	sigaddset(&shards.signals, SIGINT);
	sigaddset(&shards.signals, SIGCHLD);
	sigprocmask(SIG_BLOCK, &shards.signals, &shards.before);
	signal(SIGHUP, SIG_IGN);
	while (!shards.stop) {
		int64_t due_ns = start_due(&shards);

		wait_until(&shards, earlier(due_ns, look_due(&shards)));
	}
	stop_all(&shards);
	return shards.code;
}
