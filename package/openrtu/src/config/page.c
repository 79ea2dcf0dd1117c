/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "config/page.h"

#include <string.h>

/* What is there and what shall be, at a place of the proposed file. NULL: it is not there. */
struct pair {
	const json_t *was, *is;
};

static void compare_object(struct config_report *report, const struct config_place *place, struct pair pair,
			   const struct config_inside *inside);

/* NULL: no row knows it. */
static const struct config_rule *rule_of(const struct config_inside *inside, const char *key)
{
	for (; inside != NULL; inside = inside->further)
		for (size_t i = 0; i < inside->count; i++)
			if (strcmp(inside->rules[i].name, key) == 0)
				return &inside->rules[i];
	return NULL;
}

/* ---- what is locked ---------------------------------------------------------------------- */

static bool has_locked_value(const json_t *json, const struct config_rule *rule);

/* One object; null, which takes an entry out, has nothing. */
static bool has_locked_key(const json_t *json, const struct config_inside *inside)
{
	const char *key;
	json_t *value;

	if (!json_is_object(json))
		return !json_is_null(json);
	json_object_foreach((json_t *)json, key, value)
	{
		if (has_locked_value(value, rule_of(inside, key)))
			return true;
	}
	return false;
}

static bool has_its_form(const json_t *json, const struct config_rule *rule)
{
	return rule->inside->by_name || rule->kind == CONFIG_OBJECT ? json_is_object(json)
								    : json_is_array(json);
}

static bool has_locked_element(const json_t *array, const struct config_inside *inside)
{
	const json_t *element;
	size_t i;

	json_array_foreach(array, i, element)
	{
		if (has_locked_key(element, inside))
			return true;
	}
	return false;
}

static bool has_locked_name(const json_t *object, const struct config_inside *inside)
{
	const char *name;
	json_t *value;

	json_object_foreach((json_t *)object, name, value)
	{
		if (has_locked_key(value, inside))
			return true;
	}
	return false;
}

static bool has_locked_value(const json_t *json, const struct config_rule *rule)
{
	if (rule == NULL || !rule->page)
		return true;
	if (rule->inside == NULL)
		return false;
	if (!has_its_form(json, rule))
		return true;
	if (rule->inside->by_name)
		return has_locked_name(json, rule->inside);
	return rule->kind == CONFIG_OBJECT ? has_locked_key(json, rule->inside)
					   : has_locked_element(json, rule->inside);
}

/* ---- what differs ------------------------------------------------------------------------ */

static void compare_whole(struct config_report *report, const struct config_place *place, struct pair pair)
{
	if (pair.was == NULL)
		config_error(report, place, "is new: the page may not add it");
	else if (pair.is == NULL)
		config_error(report, place, "is missing: the page may not take it out");
	else if (!json_equal(pair.was, pair.is))
		config_error(report, place,
			     "is another one than in the file in force: the page may not "
			     "change it");
}

/* Beside what is locked: what that acts on. */
static void compare_bound(struct config_report *report, const struct config_place *place, struct pair pair)
{
	if (pair.was == NULL || pair.is == NULL || !json_equal(pair.was, pair.is))
		config_error(report, place,
			     "is not as in the file in force: it stays, since there are keys beside it "
			     "that the page may not change");
}

/* The next element from *next on that has something locked. NULL: there is none. */
static const json_t *next_locked(const json_t *array, const struct config_inside *inside, size_t *next)
{
	const json_t *element;

	while ((element = json_array_get(array, (*next)++)) != NULL)
		if (has_locked_key(element, inside))
			return element;
	return NULL;
}

/* The first of one that has something locked is the first of the other, and so on. */
static void compare_array(struct config_report *report, const struct config_place *place, struct pair pair,
			  const struct config_inside *inside)
{
	size_t was = 0, is = 0;
	struct pair next;

	do {
		next.was = next_locked(pair.was, inside, &was);
		next.is = next_locked(pair.is, inside, &is);
		if (next.is != NULL) {
			const struct config_place here = config_element_of(place, is - 1);

			compare_object(report, &here, next, inside);
		} else if (next.was != NULL) {
			compare_object(report, place, next, inside);
		}
	} while (next.was != NULL || next.is != NULL);
}

static void compare_named(struct config_report *report, const struct config_place *place, struct pair pair,
			  const struct config_inside *inside)
{
	const char *name;
	json_t *value;

	json_object_foreach((json_t *)pair.is, name, value)
	{
		const struct config_place here = config_key_of(place, name);

		compare_object(report, &here, (struct pair){json_object_get(pair.was, name), value}, inside);
	}
	json_object_foreach((json_t *)pair.was, name, value)
	{
		const struct config_place here = config_key_of(place, name);

		if (json_object_get(pair.is, name) == NULL)
			compare_object(report, &here, (struct pair){value, NULL}, inside);
	}
}

static void compare_value(struct config_report *report, const struct config_place *place, struct pair pair,
			  const struct config_rule *rule)
{
	if (rule != NULL && rule->page && rule->inside == NULL)
		return;
	if (rule == NULL || !rule->page || (pair.was != NULL && !has_its_form(pair.was, rule)) ||
	    (pair.is != NULL && !has_its_form(pair.is, rule)))
		compare_whole(report, place, pair);
	else if (rule->inside->by_name)
		compare_named(report, place, pair, rule->inside);
	else if (rule->kind == CONFIG_OBJECT)
		compare_object(report, place, pair, rule->inside);
	else
		compare_array(report, place, pair, rule->inside);
}

static bool is_no_object(const json_t *json)
{
	return json != NULL && !json_is_object(json);
}

/* In both files, and with something locked in one of them. */
static bool binds(struct pair object, const struct config_inside *inside)
{
	return object.was != NULL && object.is != NULL &&
	       (has_locked_key(object.was, inside) || has_locked_key(object.is, inside));
}

static void compare_key(struct config_report *report, const struct config_place *object, const char *key,
			struct pair pair, const struct config_inside *inside, bool bound)
{
	const struct config_place here = config_key_of(object, key);
	const struct config_rule *rule = rule_of(inside, key);

	if (bound && rule != NULL && rule->page && (rule->stays || inside->whole))
		compare_bound(report, &here, pair);
	else
		compare_value(report, &here, pair, rule);
}

static void compare_object(struct config_report *report, const struct config_place *place, struct pair pair,
			   const struct config_inside *inside)
{
	const char *key;
	json_t *value;
	bool bound;

	if (json_is_null(pair.was))
		pair.was = NULL;
	if (json_is_null(pair.is))
		pair.is = NULL;
	if (is_no_object(pair.was) || is_no_object(pair.is)) {
		compare_whole(report, place, pair);
		return;
	}
	bound = binds(pair, inside);
	json_object_foreach((json_t *)pair.is, key, value)
	{
		compare_key(report, place, key, (struct pair){json_object_get(pair.was, key), value}, inside,
			    bound);
	}
	json_object_foreach((json_t *)pair.was, key, value)
	{
		if (json_object_get(pair.is, key) == NULL)
			compare_key(report, place, key, (struct pair){value, NULL}, inside, bound);
	}
}

void config_check_page(struct config_report *report, const json_t *in_force, const json_t *proposed,
		       const struct config_inside *file)
{
	compare_object(report, &(struct config_place){.in = NULL}, (struct pair){in_force, proposed}, file);
}
