/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What all processes of a plant share, and the baton: who holds it runs, all others wait for it. */
#ifndef PLANT_SHARED_H
#define PLANT_SHARED_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define PLANT_PROCESSES 64
#define PLANT_FAULTS    4096
#define PLANT_LOSSES    256
#define PLANT_DELAYS    8
#define PLANT_HOSTS     8
#define PLANT_TAPS      16
#define PLANT_NO_TAP    UINT32_MAX
#define PLANT_CABLE     1 /* the port that stands for the Ethernet, where something is cut */
#define PLANT_STEPS     256
#define PLANT_FLIGHTS   1024
#define PLANT_NAMES     64
#define PLANT_ACCOUNTS  1024
#define PLANT_DYING     PLANT_PROCESSES
#define PLANT_NAME_SIZE 24
#define PLANT_TRACE     (64u << 10)
#define PLANT_LINE      256
#define PLANT_PATH      512
#define PLANT_NEVER     INT64_MAX
#define PLANT_RUNNER    UINT32_MAX /* in the place of a process: the runner */
#define PLANT_NS        INT64_C(1000000000)
#define PLANT_BEGIN_NS  (1000 * PLANT_NS) /* a clock of 0 is one that never ran, to some */

#define PLANT_SHARED_VARIABLE   "PLANT_SHARED"
#define PLANT_PROCESS_VARIABLE  "PLANT_PROCESS"
#define PLANT_TUNABLES_VARIABLE "GLIBC_TUNABLES"

struct plant_process {
	_Atomic uint32_t has_baton; /* a futex */
	_Atomic uint32_t attached;
	bool alive;
	bool ends_with_parent;
	bool wants_room; /* waits until something can be written */
	int32_t pid;
	uint32_t parent;
	uint32_t life;       /* how many of its name there were, with it */
	uint64_t asked;      /* the last change that it knew when it was not ready */
	int64_t deadline_ns; /* when it is ready at the latest */
	int64_t stopped_ns;  /* not before this time */
	int64_t account_ns;  /* when it looks at what it holds; 0: never */
	int64_t refused_ns;  /* until then it gets no memory */
	uint64_t calls;
	char name[PLANT_NAME_SIZE];
};

enum plant_fault_kind {
	PLANT_KILL,
	PLANT_STOP,
	PLANT_MEMORY, /* is refused for for_ns */
	PLANT_POWER, /* all that the same start has brought die with it, and the disk loses what it had not written */
	PLANT_CUT,
	PLANT_STARVES, /* a process of that name that begins gets no memory */
	PLANT_FULL,    /* the disk: */
	PLANT_REFUSES, /* errors of half of what would change it */
	PLANT_WORN,    /* of half of what reads it */
};

/*
 * From from_ns on: a process dies, or stops for for_ns, at its call number calls, if it makes it before to_ns, or before its store
 * number stores behind that; or no octet passes a TCP port, or the disk has that until to_ns.
 */
struct plant_fault {
	enum plant_fault_kind kind;
	bool done;
	bool counts; /* first_call is set */
	char name[PLANT_NAME_SIZE];
	uint16_t port;
	uint32_t stores; /* 0: at the call */
	bool rare;       /* of stores: those into what is not written often */
	uint64_t calls;
	uint64_t first_call;
	int64_t from_ns;
	int64_t to_ns;
	int64_t for_ns;
};

/* Nothing of a connection of this port that was made before arrives any more, its end neither: each side has to find out. */
struct plant_loss {
	uint16_t port;
	int64_t at_ns;
};

/* Somebody sets the calendar clock, or the kernel does so for a leap second. */
struct plant_step {
	int64_t at_ns;
	int64_t by_ns;
	bool leap;
	bool done;
};

/* How long what is sent over a TCP port is on its way. */
struct plant_delay {
	uint16_t port;
	int64_t least_ns;
	int64_t most_ns;
};

/* A process of this name connects from an address of its own. */
struct plant_host {
	char name[PLANT_NAME_SIZE];
	uint32_t address;
};

/* What was sent at once, from port to port. size 0: a connection, or its end. */
struct plant_flight {
	uint16_t from, to;
	uint32_t size;
	int64_t due_ns;
};

/* What a life of a process held, from some time after its begin on. */
struct plant_account {
	char name[PLANT_NAME_SIZE];
	uint32_t life;
	uint32_t first_descriptors, most_descriptors;
	uint32_t first_kib, last_kib; /* of memory */
};

struct plant_name {
	char name[PLANT_NAME_SIZE];
	uint32_t lives;
};

struct plant {
	_Atomic uint32_t runner; /* a futex: the runner has something to do */
	_Atomic uint32_t holder;
	_Atomic uint64_t turns;
	bool ended;
	uint32_t id; /* of the runner's process; its TCP ports are its own */
	uint64_t random;
	uint64_t changes; /* grows with all that may make somebody ready */
	uint64_t spins;   /* calls since the clock moved */
	int64_t now_ns;
	int64_t end_ns;
	int64_t
	    wall_ns; /* what the calendar clock was ahead of the other in the beginning, and of its steps */
	int64_t drift_ppm; /* it goes faster by that */
	uint16_t next_port;
	uint32_t process_count;
	struct plant_process processes[PLANT_PROCESSES];
	uint32_t fault_count;
	uint32_t fault_first; /* those before it, by time, are over */
	struct plant_fault faults[PLANT_FAULTS];
	uint32_t loss_count;
	struct plant_loss losses[PLANT_LOSSES];
	uint32_t step_count;
	struct plant_step steps[PLANT_STEPS];
	uint32_t delay_count;
	struct plant_delay delays[PLANT_DELAYS];
	uint32_t host_count;
	struct plant_host hosts[PLANT_HOSTS];
	uint32_t tap_next;  /* the last packet socket that was made */
	uint32_t tap_count; /* of those that frames come to */
	uint32_t taps[PLANT_TAPS];
	uint32_t flight_count;
	struct plant_flight flights[PLANT_FLIGHTS];
	struct plant_name names[PLANT_NAMES];
	char disk[PLANT_PATH]; /* a folder; empty: there is none */
	uint32_t account_count;
	struct plant_account accounts[PLANT_ACCOUNTS];
	uint32_t dying_count;
	int32_t dying[PLANT_DYING]; /* have left the baton, and may still have descriptors */
	uint32_t trace_size;
	char trace[PLANT_TRACE];
};

/* baton.c; all but plant_take() are for who has the baton. */

uint64_t plant_random(struct plant *plant);

/* Waits for the baton, and then until nobody is dying any more. */
void plant_take(struct plant *plant, uint32_t self);

/*
 * Gives the baton to who is next, and moves the clock if all wait. Returns when the caller has it again; for one that is not
 * alive any more, at once.
 */
void plant_pass(struct plant *plant, uint32_t self);

/* The process, and those that the kernel kills with it, are part of the plant no more. */
void plant_bury(struct plant *plant, uint32_t process);

/* All others that what started the process has brought: those of its machine. Returns how many are to be killed, parents last. */
size_t plant_bury_machine(struct plant *plant, uint32_t process, int32_t pids[PLANT_PROCESSES]);

/* Until those that left the baton as they ended have no descriptor any more, and their parents know. */
void plant_await_the_dying(struct plant *plant);

/* A new process, not yet run. PLANT_RUNNER: there is no room. */
uint32_t plant_add(struct plant *plant, uint32_t parent);

void plant_name(struct plant *plant, uint32_t process, const char *name);

__attribute__((format(printf, 3, 4))) void plant_tell(struct plant *plant, uint32_t process,
						      const char *format, ...);

/* No octet passes this port now. */
bool plant_is_cut(const struct plant *plant, uint16_t port);

/* Until when who begins now gets no memory. */
int64_t plant_starves_until_ns(const struct plant *plant, const char *name);

/* What the calendar clock is ahead of the other now. */
int64_t plant_ahead_ns(const struct plant *plant);

/* The disk has such a fault now. */
bool plant_disk_is(const struct plant *plant, enum plant_fault_kind kind);

/* What was connected to this port then is lost by now. */
bool plant_is_lost(const struct plant *plant, uint16_t port, int64_t since_ns);

/* flights.c: links with delay. */

bool plant_is_delayed(const struct plant *plant, uint16_t one, uint16_t other);

/* Returns when it is there. size 0: then a connection is known there that is made or has ended. */
int64_t plant_send(struct plant *plant, uint16_t from, uint16_t to, size_t size, int64_t sent_ns);

/* So many octets may be taken, and something comes later. */
size_t plant_arrived(const struct plant *plant, uint16_t from, uint16_t to);
bool plant_is_on_its_way(const struct plant *plant, uint16_t from, uint16_t to);
void plant_took(struct plant *plant, uint16_t from, uint16_t to, size_t size);
void plant_forget_flights(struct plant *plant, uint16_t from, uint16_t to);
int64_t plant_next_arrival_ns(const struct plant *plant);

/* What the process' call is: dies or stops there, if a fault says so. */
const struct plant_fault *plant_fault_at(struct plant *plant, uint32_t process);

/* False: nobody woke it, and the time is over. */
bool plant_futex_wait(_Atomic uint32_t *word, uint32_t value, int64_t most_ns);
void plant_futex_wake(_Atomic uint32_t *word);

#endif
