/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The numbers that C shares with Python, JavaScript, the MIB, the schema and the pages: one row each. `make codes` writes theirs
 * from these rows (scripts/codes.py). A number that was released stays, and a new one comes at the end.
 */
#ifndef OPENRTU_MAP_CODES_H
#define OPENRTU_MAP_CODES_H

/* The quality descriptor's bits, at the places IEC 60870-5-101, 7.2.6.3 gives them; the worst first: name, bit, word, letters */
#define MAP_QUALITIES(ROW)                                                                                   \
	ROW(MAP_INVALID, 0x80, "invalid", "IV")                                                              \
	ROW(MAP_NOT_TOPICAL, 0x40, "not topical", "NT") /* not read when it was due */                       \
	ROW(MAP_SUBSTITUTED, 0x20, "substituted", "SB") /* somebody entered it */                            \
	ROW(MAP_BLOCKED, 0x10, "blocked", "BL")         /* held as it was before somebody blocked it */      \
	ROW(MAP_OVERFLOW, 0x01, "overflow", "OV")       /* beyond what the point can hold */

/*
 * The ten states of a command, after "Implementing the telecontrol application functions defined by IEC 870-5-104 using
 * SNMPv3 services" (docs/glossary.md, "Sources"): name, number, words
 */
#define MAP_COMMAND_STATES(ROW)                                                                              \
	ROW(MAP_INACTIVE, 0, "inactive command")                                                             \
	ROW(MAP_SELECTION_REQUEST, 1, "selection request")                                                   \
	ROW(MAP_ACCEPTED_SELECTION, 2, "accepted selection")                                                 \
	ROW(MAP_REFUSED_SELECTION, 3, "refused selection")                                                   \
	ROW(MAP_INTERRUPTION_REQUEST, 4, "interruption of selection request")                                \
	ROW(MAP_INTERRUPTED_SELECTION, 5, "interrupted selection")                                           \
	ROW(MAP_EXECUTION_REQUEST, 6, "execution request")                                                   \
	ROW(MAP_EXECUTING, 7, "executing command")                                                           \
	ROW(MAP_REFUSED_COMMAND, 8, "refused command")                                                       \
	ROW(MAP_EXECUTED_COMMAND, 9, "executed command")

/* Why a state was reached: name, number, words */
#define MAP_COMMAND_RESULTS(ROW)                                                                             \
	ROW(MAP_RESULT_NONE, 0, "none")                                                                      \
	ROW(MAP_RESULT_DONE, 1, "done") /* while executing: the device has confirmed it, and it goes on */   \
	ROW(MAP_RESULT_EXCEPTION, 2, "exception") /* the device refused */                                   \
	ROW(MAP_RESULT_TIMEOUT, 3, "time-out") /* the device did not answer: it may or may not have acted */ \
	ROW(MAP_RESULT_TOO_OLD, 4, "too old")  /* not begun in time */                                       \
	ROW(MAP_RESULT_NOT_SELECTED, 5, "not selected") /* it needs a selection */                           \
	ROW(MAP_RESULT_INTERLOCK, 6, "interlock")       /* another has the point, or its owner refuses it */ \
	ROW(MAP_RESULT_OUT_OF_RANGE, 7, "out of range") /* the point cannot hold this value */               \
	ROW(MAP_RESULT_NOT_COMMANDABLE, 8, "not commandable") /* or its owner does not run */                \
	ROW(MAP_RESULT_UNKNOWN_FATE, 9, "unknown fate") /* the owner died: it may or may not have acted */   \
	ROW(MAP_RESULT_NO_SCALE, 10, "no power of ten") /* the device's scale is not known */                \
	ROW(MAP_RESULT_SENT, 11, "sent, unanswered")    /* to all, of whom none answers: a broadcast */

/* Why a value is sent (IEC 60870-5-101, 7.2.3: causes 3, 11 and 12): name, number, words */
#define MAP_CAUSES(ROW)                                                                                      \
	ROW(MAP_SPONTANEOUS, 0, "spontaneous")                                                               \
	ROW(MAP_RETURN_REMOTE, 1, "return information remote") /* after a controlling station's command */   \
	ROW(MAP_RETURN_LOCAL, 2, "return information local")   /* after a command of rtuctl */

/* What a module's process does, as rtud sees it: name, number, word */
#define MAP_MODULE_STATES(ROW)                                                                               \
	ROW(MAP_MODULE_STOPPED, 0, "stopped")   /* no process, on purpose */                                 \
	ROW(MAP_MODULE_STARTING, 1, "starting") /* forked, has not attached yet */                           \
	ROW(MAP_MODULE_RUNNING, 2, "running")                                                                \
	ROW(MAP_MODULE_SWITCHING, 3, "switching") /* its process is being exchanged */                       \
	ROW(MAP_MODULE_DOWN, 4, "down")           /* died or hangs; rtud restarts it */

/* How bad a line of the log is: name, number, word */
#define MAP_LOG_LEVELS(ROW)                                                                                  \
	ROW(MAP_LOG_ERROR, 0, "error")                                                                       \
	ROW(MAP_LOG_WARNING, 1, "warning")                                                                   \
	ROW(MAP_LOG_INFO, 2, "info")                                                                         \
	ROW(MAP_LOG_DEBUG, 3, "debug")

/*
 * The types of points that IEC 60870-5-101 has, in the order of their numbers: name, word in the configuration, bits, class and
 * form (map/type.h), least and greatest value as it lies in union map_value, what people may write
 */
#define MAP_STANDARD_TYPES(ROW)                                                                              \
	ROW(MAP_SINGLE, "single", 1, STATE, SINGLE, 0, 1, "on or off")                                       \
	ROW(MAP_DOUBLE, "double", 2, STATE, DOUBLE, 0, 3, "on or off")                                       \
	ROW(MAP_STEP, "step", 7, POSITION, SIGNED, -64, 63, "an integer from -64 to 63")                     \
	ROW(MAP_BITSTRING, "bitstring", 32, PATTERN, UNSIGNED, 0, UINT32_MAX,                                \
	    "an integer from 0 to 0xffffffff")                                                               \
	ROW(MAP_NORMALIZED, "normalized", 16, MEASURED, FRACTION, INT16_MIN, INT16_MAX,                      \
	    "a number from -1 to 0.99997")                                                                   \
	ROW(MAP_SCALED, "scaled", 16, MEASURED, SIGNED, INT16_MIN, INT16_MAX,                                \
	    "an integer from -32768 to 32767")                                                               \
	ROW(MAP_FLOAT, "float", 32, MEASURED, FLOAT, -FLT_MAX, FLT_MAX, "a number")                          \
	ROW(MAP_COUNTER, "counter", 32, TOTAL, SIGNED, INT32_MIN, INT32_MAX,                                 \
	    "an integer from -2147483648 to 2147483647")

/*
 * And our own, which no object of Modbus and no ASDU of the standard has; before what people may write, the type that carries
 * one to a controlling station. It comes as the carrier's value: an angle in degrees, of a bitstring the 32 bits.
 */
#define MAP_OWN_TYPES(ROW)                                                                                   \
	ROW(MAP_INTEGER, "integer", 32, MEASURED, SIGNED, INT32_MIN, INT32_MAX, MAP_BITSTRING,               \
	    "an integer from -2147483648 to 2147483647") /* a measured value that keeps all bits */          \
	ROW(MAP_ANGLE, "angle", 32, MEASURED, DEGREES, -180.0 * MAP_ANGLE_PER_DEGREE,                        \
	    180.0 * MAP_ANGLE_PER_DEGREE, MAP_FLOAT,                                                         \
	    "degrees from -180 to 180") /* a float would be a metre coarse */

/* Of a row: an enumerator, a text by its number; a type, which has no number but its place, and its label in a switch. */
#define MAP_CODE(name, number, ...)    name = number,
#define MAP_WORDS(name, number, words) [number] = words,
#define MAP_TYPE_CODE(name, ...)       name,
#define MAP_CASE(name, ...)            case name:
#define MAP_TYPE_NAME(type, name, ...) [type] = name,
#define MAP_OR_CODE(name, ...)         | name

#endif
