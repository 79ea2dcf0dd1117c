/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * libopenrtu: a module of the gateway that others write. docs/writing-a-module.md has one from beginning to end.
 *
 * rtud starts the program with what openrtu_attach() wants to know. The program then scans as a PLC does:
 *
 *     while (openrtu_wait(rtu)) {          until the next period
 *             openrtu_scan_begin(rtu);     the inputs are frozen
 *             ... openrtu_read(), openrtu_write()
 *             openrtu_scan_end(rtu);       the outputs are published together
 *     }
 *
 * No call blocks but openrtu_wait(), and where the configuration has a net openrtu_scan_end() and openrtu_synch(); and none allocates memory but openrtu_attach(). A handle is for one thread at a time.
 * Calls that can fail return a negative number, a negative errno, unless they say otherwise.
 */
#ifndef OPENRTU_H
#define OPENRTU_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct openrtu; /* a module */

/* A sample's quality: bits, as IEC 60870-5-101, 7.2.6.3 has them. */
#define OPENRTU_GOOD        0x00u
#define OPENRTU_OVERFLOW    0x01u /* beyond what the point can hold */
#define OPENRTU_BLOCKED     0x10u /* held as it was before somebody blocked it */
#define OPENRTU_SUBSTITUTED 0x20u /* somebody entered it */
#define OPENRTU_NOT_TOPICAL 0x40u /* not read when it was due */
#define OPENRTU_INVALID     0x80u

/*
 * A value of a point: 0 and 1 of a single one; 0 intermediate, 1 off, 2 on, 3 indeterminate of a double one; the number of
 * any other. A double holds each of them exactly.
 */
struct openrtu_sample {
	double value;
	int64_t time_ns;  /* when it was acquired, CLOCK_MONOTONIC */
	uint32_t quality; /* 0: good */
	uint32_t reserved;
};

/* ---- begin and end ----------------------------------------------------------------------- */

/*
 * Attaches to the gateway under the module's name. argc, argv: what main() got from rtud; --map DIR and --module NAME are
 * looked for in it, and nothing else. From then on SIGTERM and SIGINT are blocked, and end openrtu_wait(). NULL: it could not;
 * openrtu_error() says why.
 */
struct openrtu *openrtu_attach(int argc, char *const *argv);
/* Why the last openrtu_attach() of this process failed. */
const char *openrtu_error(void);
void openrtu_detach(struct openrtu *rtu);

/* The module's name in the configuration. */
const char *openrtu_name(const struct openrtu *rtu);
/* The object "config" of the module in the configuration, as JSON. "{}": there is none. */
const char *openrtu_config(const struct openrtu *rtu);
/* "period_ms" of the module. */
uint32_t openrtu_period_ms(const struct openrtu *rtu);

/* ---- points ------------------------------------------------------------------------------ */

/*
 * A point by its name: one of the module's own, or one that its "reads" or "commands" name. Its number, 0 or greater, holds
 * until the module detaches. -ENOENT: there is no such point, or neither names it.
 */
int openrtu_point(const struct openrtu *rtu, const char *name);
/* How many points the module has to do with: their numbers go from 0 to one less. */
int openrtu_point_count(const struct openrtu *rtu);
/* A point's name, type as in the configuration, unit and description; "": it has none. NULL: no such number. */
const char *openrtu_point_name(const struct openrtu *rtu, int point);
const char *openrtu_point_type(const struct openrtu *rtu, int point);
const char *openrtu_point_unit(const struct openrtu *rtu, int point);
const char *openrtu_point_description(const struct openrtu *rtu, int point);
/* The module's own: it may write it. */
bool openrtu_point_is_own(const struct openrtu *rtu, int point);

/* ---- scans ------------------------------------------------------------------------------- */

/*
 * Sleeps until the next period begins; periods have absolute deadlines on CLOCK_MONOTONIC, and those that a long scan has
 * missed are left out. False: the module shall end, since it was asked to or rtud has given up waiting for it.
 */
bool openrtu_wait(struct openrtu *rtu);
/* Freezes the inputs: until the next scan, each has the value that it has now, and those of one device are of one moment. */
void openrtu_scan_begin(struct openrtu *rtu);
/* Publishes what was written since the scan began: all of it is seen at once. */
void openrtu_scan_end(struct openrtu *rtu);

/*
 * A point as it was when the scan began; one of the module's own as it was written last. What is not to be had is invalid:
 * out is filled in any case. -EINVAL: no such number; -EPERM: "commands" name it, "reads" do not.
 */
int openrtu_read(struct openrtu *rtu, int point, struct openrtu_sample *out);

/*
 * Writes one of the module's own points. It becomes as bad as the worst input that this scan has read so far: invalid if one
 * of them is, or is beyond its range. -EINVAL: no such number; -EPERM: another module's; -ERANGE: no value of this type of
 * point, which is then invalid and keeps its last one.
 */
int openrtu_write(struct openrtu *rtu, int point, double value);
/* The same with a quality of the caller's, whatever was read. */
int openrtu_write_quality(struct openrtu *rtu, int point, double value, uint32_t quality);
/* And with the time at which it was acquired, CLOCK_MONOTONIC, of what comes from elsewhere; the scan's if that is earlier. */
int openrtu_write_at(struct openrtu *rtu, int point, double value, uint32_t quality, int64_t time_ns);

/* ---- events ------------------------------------------------------------------------------ */

/* A change of a point that the module reads: what a controlling station is told of it. */
struct openrtu_event {
	int32_t point;
	uint32_t past; /* 1: the point is newer already, as when a station below had kept the event */
	struct openrtu_sample sample;
};

/*
 * The next event: those of one point in order, and what waits by its time; each comes once, from the start of the program on. It may be newer than the
 * inputs that the scan has frozen, or past: a state does not go back in time. When a module ends, each of its points has one that is invalid. False: there is none.
 */
bool openrtu_event_next(struct openrtu *rtu, struct openrtu_event *out);
/* How many events of the gateway were overwritten before this module has read on. rtuctl modules shows them. */
uint32_t openrtu_events_lost(const struct openrtu *rtu);

/* ---- commands ---------------------------------------------------------------------------- */

/* The ten states of a command; docs/glossary.md tells where they are from. */
enum openrtu_state {
	OPENRTU_INACTIVE,
	OPENRTU_SELECTION_REQUEST,
	OPENRTU_ACCEPTED_SELECTION,
	OPENRTU_REFUSED_SELECTION,
	OPENRTU_INTERRUPTION_REQUEST,
	OPENRTU_INTERRUPTED_SELECTION,
	OPENRTU_EXECUTION_REQUEST,
	OPENRTU_EXECUTING,
	OPENRTU_REFUSED_COMMAND,
	OPENRTU_EXECUTED_COMMAND
};

/* Why it is in this state. */
enum openrtu_result {
	OPENRTU_NONE,
	OPENRTU_DONE,            /* while executing: the device has confirmed it, and it goes on */
	OPENRTU_EXCEPTION,       /* the device refused */
	OPENRTU_TIMEOUT,         /* the device did not answer: it may or may not have acted */
	OPENRTU_TOO_OLD,         /* not begun in time */
	OPENRTU_NOT_SELECTED,    /* it needs a selection */
	OPENRTU_INTERLOCK,       /* another has the point, or its owner refuses it */
	OPENRTU_OUT_OF_RANGE,    /* the point cannot hold this value */
	OPENRTU_NOT_COMMANDABLE, /* or its owner does not run */
	OPENRTU_UNKNOWN_FATE,    /* the owner died: it may or may not have acted */
	OPENRTU_NO_SCALE,        /* the device's scale is not known */
	OPENRTU_SENT             /* to all, of whom none answers: a broadcast */
};

/*
 * A command of one of the module's own points, which has "command" in the configuration. A point of type step takes regulating
 * steps: value is then the position that it comes to, the last one if that is an end of its range.
 */
struct openrtu_request {
	int32_t point;
	uint32_t pulse_ms; /* the value for so long, then the other one; 0: it stays */
	double value;
	int64_t time_ns; /* when it was requested */
	uint32_t flags;  /* OPENRTU_LOCAL */
	int32_t step;    /* 1 higher, -1 lower; 0: it is no regulating step */
};

#define OPENRTU_LOCAL 0x01u /* by somebody on site, with rtuctl */

/*
 * The next command that the module has not seen, of those that had come when the scan began; it is the module's to carry out,
 * and to end by openrtu_request_end(), in this scan or a later one. One that is not ended within "command_timeout_s", or 40 s
 * more where it was confirmed, ends as a time-out. False: there is none.
 */
bool openrtu_request_next(struct openrtu *rtu, struct openrtu_request *out);
/* The command of this point has begun, and goes on: whoever requested it is told. -ENOENT: there is none. */
int openrtu_request_confirm(struct openrtu *rtu, int point);
/*
 * Ends the command of this point when the scan ends, after its outputs are out. With OPENRTU_DONE the point is sent as return
 * information, written in this scan or not; any other result refuses. -ENOENT: there is none; -EINVAL: no such result.
 */
int openrtu_request_end(struct openrtu *rtu, int point, enum openrtu_result result);
/* The next selection that has come. It is accepted when the scan ends, unless it is refused until then. False: there is none. */
bool openrtu_selection_next(struct openrtu *rtu, struct openrtu_request *out);
int openrtu_selection_refuse(struct openrtu *rtu, int point, enum openrtu_result result);

#define OPENRTU_SELECT 0x01u /* selects the point first, and executes when it is selected */
#define OPENRTU_ANYWAY 0x02u /* although this scan has read an input that is no good */

/* What has become of the module's command of a point. */
struct openrtu_command {
	uint32_t state;  /* enum openrtu_state */
	uint32_t result; /* enum openrtu_result */
	uint32_t detail; /* with OPENRTU_EXCEPTION, the device's code */
	uint32_t ended;  /* 1: nothing more comes */
};

/* "commands" of the module name this point, another module's. */
bool openrtu_point_takes_commands(const struct openrtu *rtu, int point);
/*
 * Commands another module's point. What becomes of it is seen at the beginning of each scan; it is never repeated. -EINVAL: no
 * such number; -EPERM: "commands" do not name it; -EBUSY: the module's last command of it has not ended; -ERANGE: no value
 * of this type; -ENODATA: this scan has read an input that is invalid, not topical or beyond its range.
 */
int openrtu_command(struct openrtu *rtu, int point, double value, uint32_t flags);
/* What had become of it when the scan began; inactive: there was none. -EINVAL, -EPERM as openrtu_command(). */
int openrtu_command_read(const struct openrtu *rtu, int point, struct openrtu_command *out);

/* ---- synchronisation --------------------------------------------------------------------- */

/*
 * Fires a synchronisation point of the module in the net of the configuration, within a scan. 1: it has fired. 0: it cannot fire
 * now; with blocking, it is waited for instead. -ENOENT: the net has no such point of this module. -EINTR: the module shall end.
 * -ECANCELED: the module was taken for dead, and the net has gone on without this scan.
 */
int openrtu_synch(struct openrtu *rtu, const char *point, bool blocking);

/* ---- log and time ------------------------------------------------------------------------ */

enum openrtu_log_level { OPENRTU_ERROR, OPENRTU_WARNING, OPENRTU_INFO, OPENRTU_DEBUG };

/* A line in the gateway's log; 111 octets of text are kept. */
void openrtu_log(struct openrtu *rtu, enum openrtu_log_level level, const char *text);
/* A moment of CLOCK_MONOTONIC as time of day, in ns since 1970 UTC, by the gateway's clock. */
int64_t openrtu_wall_ns(const struct openrtu *rtu, int64_t time_ns);
/* The library's version, as "1.0.0". */
const char *openrtu_version(void);

#ifdef __cplusplus
}
#endif

#endif
