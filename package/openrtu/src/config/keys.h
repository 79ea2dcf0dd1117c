/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The configuration file's keys: tables that say which keys an object of the file has and what each may
 * hold, and one reader that checks any JSON object against its table. Every finding is reported with its place in the file.
 */
#ifndef OPENRTU_CONFIG_KEYS_H
#define OPENRTU_CONFIG_KEYS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include <jansson.h>

#define CONFIG_PLACE_SIZE 192 /* a place in words, terminator included */
#define CONFIG_WHERE_SIZE 768 /* with its file and line */

#define CONFIG_SHOWN_MAX 200 /* messages; what is behind them is counted */

/* A file's text, as long as something may have to be said of it. */
struct config_source {
	const char *path;
	const char *text;
	size_t length;
};

/* Where in the file, in words: port[2].slaves[0].coils[1].address */
struct config_place {
	const struct config_place *in; /* NULL: this is the whole file */
	const char *key;               /* NULL: element number index of an array */
	size_t index;
	/* Of a whole file: */
	const struct config_source *source;  /* NULL: the report's */
	const struct config_place *instance; /* of a template, for which slave it is read; else NULL */
};

struct config_report {
	FILE *messages;
	struct config_source source; /* the file that was asked for */
	unsigned errors;
	unsigned shown; /* messages */
};

enum config_kind {
	CONFIG_INTEGER, /* low..high */
	CONFIG_NUMBER,  /* low..high */
	CONFIG_BOOLEAN,
	CONFIG_TEXT,   /* low..high bytes of UTF-8 without control characters */
	CONFIG_CHOICE, /* one of choices; the value is its index */
	CONFIG_ARRAY,  /* at most high elements */
	CONFIG_OBJECT,
	CONFIG_ANYTHING, /* not looked at */
};

struct config_inside;

struct config_rule {
	const char *name;
	enum config_kind kind;
	bool required;
	bool page;                          /* the gateway's page may change it: config/page.h */
	bool stays;                         /* but not beside what it may not change: what that acts on */
	const struct config_inside *inside; /* of that, what its own keys' rows say; NULL: all of it */
	double low, high;
	const char *const *choices; /* ends with NULL */
	double fallback;            /* the value of a key that is not given */
#if OPENRTU_SCHEMA
	const char *says;           /* what the key means, in a sentence or more */
	const char *see;            /* the page that says more, and #heading */
	const char *unit;           /* where the name does not end with it */
	bool unset;                 /* not given, it has no value: the fallback is none */
	double otherwise;           /* what holds without the key, if it is not the fallback; 0: it is */
	const char *otherwise_text; /* the same of a text */
	const struct config_table *table;        /* of the object, or of each element of the array */
	const struct config_table *const *forms; /* other tables, which json names; ends with NULL */
	const char *pattern;                     /* of a text */
	const char *json;                        /* an object: what of its schema no other field says */
#endif
};

/*
 * What rtud --schema says of a rule, and what a reader of files has no use for: only a build with the option schema has it. The
 * sentence comes first, then other fields of the rule.
 */
struct config_table;
#if OPENRTU_SCHEMA
/* A table of rules, as the schema calls it. */
struct config_table {
	const char *name;
	const struct config_rule *rules;
	size_t count;
	const struct config_rule *own;   /* in the place of the rule of its name, or behind all; NULL: none */
	const struct config_table *like; /* has the same rules, but for own; NULL: none */
	const struct config_table *const *forms; /* as of a rule */
	const char *json;                        /* an object: what holds between its keys */
	/* What of that other tables of the room say, put into the schema; NULL: nothing. False: there is no memory. */
	bool (*add)(json_t *schema);
};
#define CONFIG_SAYS(...)                .says = __VA_ARGS__
#define CONFIG_TABLE(table, ...)        static const struct config_table table = {__VA_ARGS__}
#define CONFIG_SHARED_TABLE(table, ...) const struct config_table table = {__VA_ARGS__}
#define CONFIG_JSON(...)                #__VA_ARGS__
#define CONFIG_FORMS(...)                                                                                    \
	(const struct config_table *const[])                                                                 \
	{                                                                                                    \
		__VA_ARGS__, NULL                                                                            \
	}
#else
#define CONFIG_SAYS(...)
#define CONFIG_TABLE(table, ...)        struct config_table
#define CONFIG_SHARED_TABLE(table, ...) struct config_table
#endif

struct config_value {
	bool given;      /* and as its rule wants it */
	bool wrong;      /* given, but not as its rule wants it, or missing though required */
	int64_t integer; /* integer, boolean, choice; not given: the fallback */
	double number;   /* number */
	const char *text;
	const json_t *json;
};

static inline struct config_place config_key_of(const struct config_place *in, const char *key)
{
	return (struct config_place){.in = in, .key = key};
}

static inline struct config_place config_element_of(const struct config_place *in, size_t index)
{
	return (struct config_place){.in = in, .index = index};
}

/* Writes a place in words with file and line, as something else that is spoken of. out: CONFIG_WHERE_SIZE bytes. */
void config_place_where(const struct config_report *report, const struct config_place *place, char *out);

/* Reports an error at a place and counts it. */
void config_error(struct config_report *report, const struct config_place *place, const char *format, ...)
    __attribute__((format(printf, 3, 4)));
/* Tells the user something that is no error. */
void config_note(struct config_report *report, const struct config_place *place, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/*
 * Reads the keys of a JSON object: values[i] is what rules[i] says. Reports everything that is not as the rules want it:
 * not an object, unknown keys, missing keys, wrong types, values out of range. NULL is an object without keys.
 */
void config_read_keys(struct config_report *report, const struct config_place *place, const json_t *object,
		      const struct config_rule *rules, size_t count, struct config_value *values);

/* There is no memory to read on. */
void config_out_of_memory(struct config_report *report);

/* Says how many messages were not shown. */
void config_report_end(struct config_report *report);

/* ---- where.c ----------------------------------------------------------------------------- */

/* The line of a place, from 1; of what is missing, of what it is missing in. */
unsigned config_line_of(const struct config_source *source, const struct config_place *place);

#endif
