/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The walk through the objects, the keys, and the sinks' windows in virtual time. */
#include "snmp/agent.h"
#include "snmp/keys.h"
#include "snmp/sink.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "map/test_stage.h"

#define NAMES_MAX 2000

struct fixture {
	struct stage *stage;
	struct map *map; /* of rtu-iec104, which may request */
	struct snmp_settings settings;
	struct snmp_shared *shared;
	struct snmp_agent agent;
};

static struct fixture begin(void **state)
{
	static const struct snmp_settings settings = {
	    .base = {1, 3, 6, 1, 4, 1, 8072, 9999, 9999, 104},
	    .base_length = 10,
	    .station = "test",
	    .max_message = 1472,
	    .release_s = 60,
	    .user_count = 1,
	    .users = {{"centre", SNMP_OPERATOR}},
	    .sink_count = 1,
	    .sinks = {{.name = "nms", .window = 2, .retries = 1, .inform = true, .timeout_ms = 1000}},
	};
	struct fixture fixture = {.stage = *state, .settings = settings};

	return fixture;
}

static void start_agent(struct fixture *fixture)
{
	map_add_section(&fixture->stage->config, SNMP_SETTINGS, sizeof(fixture->settings), 1,
			&fixture->settings);
	make_again(fixture->stage);
	fixture->map = start(fixture->stage, "rtu-iec104");
	fixture->shared = calloc(1, sizeof(*fixture->shared));
	assert_true(snmp_begin(&fixture->agent, fixture->map, fixture->shared));
}

static struct snmp_interface interface_named(const char *name, uint32_t kernel)
{
	struct snmp_interface interface = {.kernel = kernel, .link = SNMP_LINK_UP};

	strcpy(interface.name, name);
	return interface;
}

static void come(struct snmp_agent *agent, const char *name, uint32_t kernel)
{
	const struct snmp_interface interface = interface_named(name, kernel);

	snmp_interface_is(agent, &interface);
}

static void mount(struct snmp_agent *agent, const char *name, uint64_t size)
{
	struct snmp_storage storage = {
	    .type = SNMP_STORAGE_FLASH, .unit = 4096, .size = size, .used = size / 2};

	strcpy(storage.name, name);
	snmp_storage_is(agent, &storage);
}

static void have_a_machine(struct snmp_agent *agent)
{
	come(agent, "lo", 1);
	come(agent, "eth0", 2);
	mount(agent, "/", 1000);
	mount(agent, "/data", 2000);
	agent->machine.up_ns = NS_PER_S;
}

static void end(struct fixture *fixture)
{
	snmp_end(&fixture->agent);
	map_detach(fixture->map);
	free(fixture->shared);
}

/* ---- the walk ---------------------------------------------------------------------------- */

struct name {
	uint32_t ids[SNMP_IDS_MAX];
	size_t length;
};

static int order(const struct name *a, const struct name *b)
{
	for (size_t i = 0; i < a->length && i < b->length; i++)
		if (a->ids[i] != b->ids[i])
			return a->ids[i] < b->ids[i] ? -1 : 1;
	return a->length == b->length ? 0 : a->length < b->length ? -1 : 1;
}

/* All names, one behind the other, as GETNEXT finds them. */
static size_t walk(const struct snmp_agent *agent, struct name *names)
{
	struct name name = {.length = 0};
	struct snmp_place place;
	size_t count = 0;

	while (snmp_next(agent, name.ids, name.length, SNMP_OPERATOR, &place)) {
		name.length = snmp_name(agent, &place, name.ids);
		assert_true(count < NAMES_MAX);
		names[count++] = name;
	}
	return count;
}

static void test_each_instance_is_behind_the_one_before(void **state)
{
	static struct name names[NAMES_MAX];
	struct fixture fixture = begin(state);
	struct snmp_place place, found;
	size_t count;

	start_agent(&fixture);
	have_a_machine(&fixture.agent);
	count = walk(&fixture.agent, names);
	assert_true(count > 200);
	assert_true(snmp_next(&fixture.agent, NULL, 0, SNMP_OPERATOR, &place));
	for (size_t i = 0; i < count; i++) {
		struct name here;

		assert_true(i == 0 || order(&names[i - 1], &names[i]) < 0);
		assert_true(snmp_find(&fixture.agent, names[i].ids, names[i].length, &found));
		here.length = snmp_name(&fixture.agent, &place, here.ids);
		assert_int_equal(order(&here, &names[i]), 0);
		assert_int_equal(snmp_after(&fixture.agent, SNMP_OPERATOR, &place), i + 1 < count);
	}
	end(&fixture);
}

/* A name of an instance with some of its numbers changed, cut or added to. */
static struct name any_name(const struct name *names, size_t count, unsigned *seed)
{
	struct name name = names[(unsigned)rand_r(seed) % count];

	if (rand_r(seed) % 2)
		name.length = (unsigned)rand_r(seed) % (name.length + 1);
	if (rand_r(seed) % 2 && name.length > 0)
		name.ids[(unsigned)rand_r(seed) % name.length] += (uint32_t)(rand_r(seed) % 3) - 1;
	if (rand_r(seed) % 2 && name.length < SNMP_IDS_MAX)
		name.ids[name.length++] = (unsigned)rand_r(seed) % 2 ? UINT32_MAX : 0;
	return name;
}

static void test_the_next_of_any_name_is_the_first_behind_it(void **state)
{
	static struct name names[NAMES_MAX];
	struct fixture fixture = begin(state);
	unsigned seed = 1;
	size_t count;

	start_agent(&fixture);
	have_a_machine(&fixture.agent);
	count = walk(&fixture.agent, names);
	for (unsigned i = 0; i < 20000; i++) {
		const struct name name = any_name(names, count, &seed);
		struct snmp_place place;
		struct name next;
		size_t expected = 0;

		while (expected < count && order(&names[expected], &name) <= 0)
			expected++;
		assert_int_equal(snmp_next(&fixture.agent, name.ids, name.length, SNMP_OPERATOR, &place),
				 expected < count);
		if (expected == count)
			continue;
		next.length = snmp_name(&fixture.agent, &place, next.ids);
		assert_int_equal(order(&next, &names[expected]), 0);
	}
	end(&fixture);
}

/* ---- the machine ------------------------------------------------------------------------- */

/* ifIndex. 0: there is none of this name. */
static uint32_t number_of(const struct snmp_agent *agent, const char *name)
{
	for (uint32_t i = 0; i < agent->machine.interface_count; i++)
		if (strcmp(agent->machine.interfaces[i].name, name) == 0)
			return agent->machine.interfaces[i].number;
	return 0;
}

static void test_an_interface_has_one_number(void **state)
{
	struct fixture fixture = begin(state);
	struct snmp_agent *agent = &fixture.agent, next;

	start_agent(&fixture);
	have_a_machine(agent);
	come(agent, "ppp0", 3);
	assert_int_equal(number_of(agent, "ppp0"), 3);
	agent->now_ns += NS_PER_S;
	snmp_interface_gone(agent, 3);
	assert_int_equal(number_of(agent, "ppp0"), 0);
	assert_int_equal(agent->machine.interfaces_changed_ns, agent->now_ns);
	come(agent, "ppp0", 7);
	assert_int_equal(number_of(agent, "ppp0"), 3);
	assert_int_equal(agent->machine.interfaces[2].came_ns, agent->now_ns);
	come(agent, "eth1", 3); /* moved here from elsewhere, with a number that is another's */
	assert_int_equal(number_of(agent, "eth1"), 4);
	come(agent, "wan", 7); /* a new name */
	assert_int_equal(number_of(agent, "wan"), 3);
	come(agent, "ppp0", 8);
	assert_int_equal(number_of(agent, "ppp0"), 8);
	assert_true(snmp_begin(&next, fixture.map, fixture.shared));
	come(&next, "eth1", 5);
	come(&next, "wan", 9);
	come(&next, "lo", 1);
	assert_int_equal(number_of(&next, "eth1"), 4);
	assert_int_equal(number_of(&next, "wan"), 3);
	assert_int_equal(next.machine.interfaces[0].number, 1); /* in order */
	assert_int_equal(next.machine.interfaces[0].changed_ns, 0);
	snmp_end(&next);
	end(&fixture);
}

static void test_the_list_of_interfaces_takes_its_place(void **state)
{
	struct fixture fixture = begin(state);
	struct snmp_agent *agent = &fixture.agent;

	start_agent(&fixture);
	have_a_machine(agent);
	snmp_interfaces_before(agent);
	come(agent, "eth0", 2);
	come(agent, "usb0", 3);
	snmp_interfaces_after(agent);
	assert_int_equal(number_of(agent, "lo"), 0);
	assert_int_equal(agent->machine.interface_count, 2);
	assert_int_equal(agent->machine.interfaces[0].changed_ns, 0); /* as it was */
	end(&fixture);
}

static void test_of_too_many_the_first_are_told(void **state)
{
	struct fixture fixture = begin(state);
	struct snmp_agent *agent = &fixture.agent;
	char name[SNMP_NUMBERED_SIZE];

	start_agent(&fixture);
	for (uint32_t round = 0; round < 3; round++) { /* more names than are kept */
		for (uint32_t i = 1; i <= 2 * SNMP_INTERFACES_MAX; i++) {
			snprintf(name, SNMP_IF_NAME_SIZE, "veth%u-%u", round, i);
			come(agent, name, 1000 * round + i);
			snprintf(name, sizeof(name), "/mnt/%u/%u", round, i);
			mount(agent, name, 1);
		}
		assert_int_equal(agent->machine.interface_count, SNMP_INTERFACES_MAX);
		assert_int_equal(agent->machine.storage_count, SNMP_MOUNTS_MAX);
		for (uint32_t i = 1; i < SNMP_INTERFACES_MAX; i++)
			assert_true(agent->machine.interfaces[i].number >
				    agent->machine.interfaces[i - 1].number);
		snmp_interfaces_before(agent);
		snmp_interfaces_after(agent);
		snmp_storages_before(agent);
		snmp_storages_after(agent);
	}
	assert_int_equal(agent->machine.interface_count, 0);
	assert_int_equal(agent->machine.storage_count, 0);
	end(&fixture);
}

static void link_is(struct snmp_agent *agent, uint32_t kernel, enum snmp_link link)
{
	struct snmp_interface interface = interface_named("eth0", kernel);

	interface.link = (uint8_t)link;
	snmp_interface_is(agent, &interface);
	agent->now_ns += NS_PER_S;
	snmp_links_tick(agent);
}

/* The kind of the newest event, if it is behind this one. 0: it is not. */
static unsigned told_behind(const struct snmp_agent *agent, uint32_t *number)
{
	if (agent->position.last == *number)
		return 0;
	assert_int_equal(agent->position.last, ++*number);
	return snmp_event_at(agent, *number)->kind;
}

/* RFC 2863, 3.1.13 and 3.1.14: into the state down and out of it, but for what is not present. */
static void test_links_that_go_down_and_up_are_told(void **state)
{
	static const struct {
		enum snmp_link link;
		unsigned kind;
	} steps[] = {
	    {SNMP_LINK_DOWN, SNMP_EVENT_LINK_DOWN},
	    {SNMP_LINK_UP, SNMP_EVENT_LINK_UP},
	    {SNMP_LINK_DORMANT, 0},
	    {SNMP_LINK_LOWER_DOWN, 0},
	    {SNMP_LINK_DOWN, SNMP_EVENT_LINK_DOWN},
	    {SNMP_LINK_DOWN, 0},
	    {SNMP_LINK_NOT_PRESENT, 0},
	    {SNMP_LINK_DOWN, 0},
	    {SNMP_LINK_LOWER_DOWN, SNMP_EVENT_LINK_UP},
	};
	struct fixture fixture = begin(state);
	struct snmp_agent *agent = &fixture.agent;
	uint32_t number;

	start_agent(&fixture);
	number = agent->position.last;
	link_is(agent, 2, SNMP_LINK_UP);
	assert_int_equal(told_behind(agent, &number), 0);
	for (unsigned i = 0; i < sizeof(steps) / sizeof(steps[0]); i++) {
		link_is(agent, 2, steps[i].link);
		assert_int_equal(told_behind(agent, &number), steps[i].kind);
	}
	assert_int_equal(snmp_event_at(agent, number)->value.u, number_of(agent, "eth0"));
	assert_int_equal(snmp_event_at(agent, number)->state, SNMP_LINK_LOWER_DOWN);
	end(&fixture);
}

/* As a modem's, and while another process of the agent begins. */
static void test_a_link_that_goes_is_down_and_comes_up_again(void **state)
{
	struct fixture fixture = begin(state);
	struct snmp_agent *agent = &fixture.agent, next;
	uint32_t number;

	start_agent(&fixture);
	number = agent->position.last;
	link_is(agent, 2, SNMP_LINK_UP);
	snmp_interface_gone(agent, 2);
	assert_int_equal(told_behind(agent, &number), SNMP_EVENT_LINK_DOWN);
	link_is(agent, 3, SNMP_LINK_UP);
	assert_int_equal(told_behind(agent, &number), SNMP_EVENT_LINK_UP);
	assert_true(snmp_begin(&next, fixture.map, fixture.shared));
	link_is(&next, 3, SNMP_LINK_DOWN);
	assert_int_equal(told_behind(&next, &number), SNMP_EVENT_LINK_DOWN);
	snmp_end(&next);
	end(&fixture);
}

static void test_a_loose_contact_fills_no_table_of_events(void **state)
{
	struct fixture fixture = begin(state);
	struct snmp_agent *agent = &fixture.agent;
	struct snmp_interface interface = interface_named("eth0", 2);
	uint32_t first;

	start_agent(&fixture);
	first = agent->position.last;
	link_is(agent, 2, SNMP_LINK_UP);
	for (unsigned i = 0; i < 1000; i++) { /* of 10 ms */
		interface.link = i % 2 == 0 ? SNMP_LINK_DOWN : SNMP_LINK_UP;
		snmp_interface_is(agent, &interface);
		agent->now_ns += 10 * NS_PER_MS;
		snmp_links_tick(agent);
	}
	assert_in_range(agent->position.last - first, 2, 10);
	agent->now_ns += NS_PER_S;
	snmp_links_tick(agent);
	assert_int_equal(agent->machine.interfaces[0].told, agent->machine.interfaces[0].link);
	end(&fixture);
}

static int64_t number_at(struct snmp_agent *agent, const uint32_t *ids, size_t length)
{
	static struct snmp_value value;
	struct snmp_place place;

	assert_true(snmp_find(agent, ids, length, &place));
	assert_true(snmp_table_at(agent, &place)->read(agent, place.column, place.row, &value));
	return value.number;
}

/* RFC 2790: hrStorageSize is an Integer32. */
static void test_a_large_storage_has_large_units(void **state)
{
	static const uint32_t column[] = {1, 3, 6, 1, 2, 1, 25, 2, 3, 1};
	struct fixture fixture = begin(state);
	uint32_t ids[12];
	int64_t numbers[3];

	start_agent(&fixture);
	mount(&fixture.agent, "/", UINT64_C(1) << 40); /* of 4096 octets each */
	memcpy(ids, column, sizeof(column));
	ids[11] = 31;
	for (uint32_t i = 0; i < 3; i++) {
		ids[10] = 4 + i; /* units, size, used */
		numbers[i] = number_at(&fixture.agent, ids, 12);
		assert_in_range(numbers[i], 1, INT32_MAX);
	}
	assert_true(numbers[0] * numbers[1] == INT64_C(4096) << 40);
	assert_true(numbers[0] * numbers[2] == INT64_C(2048) << 40);
	end(&fixture);
}

/* ---- keys -------------------------------------------------------------------------------- */

#define SHA "00112233445566778899aabbccddeeff00112233445566778899aabbccddeeff"
#define AES "00112233445566778899aabbccddeeff"

static void test_keys_are_taken_whole_or_not_at_all(void **state)
{
	static const char *const wrong[] = {
	    "engine",
	    "engine 80",
	    "engine 800g1f8805",
	    "engine 80001f88051",
	    "user centre SHA-256 " SHA " AES-128",
	    "user centre SHA-256 " AES " AES-128 " AES,
	    "user centre MD5 " SHA " AES-128 " AES,
	    "user centre SHA-256 " SHA " AES-128 " SHA,
	    "user centre SHA-256 " SHA " AES-128 " AES " more",
	    "sink nms SHA-256 " SHA " AES-128 " AES,
	    "password centre",
	};
	struct fixture fixture = begin(state);
	struct snmp_keyring ring = {0};
	char line[SNMP_KEY_LINE + 8];
	const char *name;

	for (size_t i = 0; i < sizeof(wrong) / sizeof(wrong[0]); i++)
		assert_false(snmp_keys_take(&ring, &fixture.settings, wrong[i]));
	memset(line, 'a', sizeof(line));
	line[sizeof(line) - 1] = '\0';
	assert_false(snmp_keys_take(&ring, &fixture.settings, line));
	assert_string_equal(snmp_keys_missing(&ring, &fixture.settings, &name), "engine ID");
	assert_true(snmp_keys_take(&ring, &fixture.settings, "engine 80001f8805\n"));
	assert_true(snmp_keys_take(&ring, &fixture.settings, "# comment"));
	assert_true(snmp_keys_take(&ring, &fixture.settings, "user other SHA-256 " SHA " AES-128 " AES));
	assert_string_equal(snmp_keys_missing(&ring, &fixture.settings, &name), "user");
	assert_true(snmp_keys_take(&ring, &fixture.settings, "user centre SHA-256 " SHA " AES-128 " AES));
	assert_string_equal(snmp_keys_missing(&ring, &fixture.settings, &name), "sink");
	assert_true(
	    snmp_keys_take(&ring, &fixture.settings, "sink nms 80001f8806 SHA-256 " SHA " AES-128 " AES));
	assert_null(snmp_keys_missing(&ring, &fixture.settings, &name));
	assert_int_equal(ring.users[0].auth_key[1], 0x11);
}

/* ---- sinks ------------------------------------------------------------------------------- */

static void add_events(struct fixture *fixture, unsigned count)
{
	while (count-- > 0)
		snmp_event_add(&fixture->agent,
			       &(struct snmp_event){.kind = SNMP_EVENT_CLOCK, .ca = SNMP_NO_CA});
}

/* Sends one event a message. NULL: nothing is due. */
static struct snmp_flight *send_one(struct fixture *fixture)
{
	struct snmp_flight *flight;

	if (snmp_sink_next(&fixture->agent, 0, &flight) != SNMP_SEND_EVENTS)
		return NULL;
	snmp_sink_sent(&fixture->agent, 0, flight, flight->first);
	return flight;
}

static void test_a_window_is_confirmed_in_order(void **state)
{
	struct fixture fixture = begin(state);
	struct snmp_flight *one, *two;

	start_agent(&fixture);
	add_events(&fixture, 3);
	one = send_one(&fixture);
	two = send_one(&fixture);
	assert_int_equal(one->first, 1);
	assert_int_equal(two->first, 2);
	assert_null(send_one(&fixture)); /* the window is full */
	snmp_sink_answered(&fixture.agent, 0, two);
	assert_int_equal(fixture.shared->confirmed[0], 0);
	assert_null(send_one(&fixture)); /* of two the place is kept until the first one is there */
	snmp_sink_answered(&fixture.agent, 0, one);
	assert_int_equal(fixture.shared->confirmed[0], 2);
	assert_int_equal(send_one(&fixture)->first, 3);
	end(&fixture);
}

static void test_a_silent_sink_is_probed_and_loses_nothing(void **state)
{
	struct fixture fixture = begin(state);
	struct snmp_flight *flight;

	start_agent(&fixture);
	add_events(&fixture, 1);
	flight = send_one(&fixture);
	snmp_sink_unanswered(&fixture.agent, 0, flight, fixture.agent.now_ns, NULL);
	assert_ptr_equal(send_one(&fixture), flight); /* its retry */
	assert_int_equal(flight->tries, 2);
	snmp_sink_unanswered(&fixture.agent, 0, flight, fixture.agent.now_ns, NULL);
	assert_true(fixture.agent.sinks[0].silent);
	add_events(&fixture, 5);
	assert_int_equal(snmp_sink_next(&fixture.agent, 0, &flight), SNMP_SEND_NOTHING);
	for (unsigned minute = 0; minute < 3; minute++) {
		fixture.agent.now_ns += 61 * NS_PER_S;
		assert_int_equal(snmp_sink_next(&fixture.agent, 0, &flight), SNMP_SEND_PROBE);
		snmp_sink_probed(&fixture.agent, 0);
		assert_int_equal(snmp_sink_next(&fixture.agent, 0, &flight), SNMP_SEND_NOTHING);
		if (minute < 2)
			snmp_sink_unanswered(&fixture.agent, 0, NULL, fixture.agent.now_ns, NULL);
	}
	snmp_sink_answered(&fixture.agent, 0, NULL);
	for (uint32_t number = 1; number <= 8; number++) { /* coldStart and rtuStarted are first */
		flight = send_one(&fixture);
		assert_int_equal(flight->first, number);
		snmp_sink_answered(&fixture.agent, 0, flight);
	}
	assert_null(send_one(&fixture));
	assert_int_equal(fixture.shared->sink_lost[0], 0);
	end(&fixture);
}

/* What is due is sent as rtu-snmp does; nobody answers. */
static void run_unanswered(struct fixture *fixture)
{
	struct snmp_flight *flight = NULL;
	enum snmp_sending what;

	while ((what = snmp_sink_next(&fixture->agent, 0, &flight)) == SNMP_SEND_EVENTS) {
		snmp_sink_sent(&fixture->agent, 0, flight, flight->first);
		snmp_sink_unanswered(&fixture->agent, 0, flight, fixture->agent.now_ns + NS_PER_S, NULL);
	}
	if (what == SNMP_SEND_PROBE) {
		snmp_sink_probed(&fixture->agent, 0);
		snmp_sink_unanswered(&fixture->agent, 0, NULL, 0, NULL);
	}
}

/* 60 s of virtual time at 100 events a second. */
static void test_a_sink_that_is_away_for_a_minute_misses_nothing(void **state)
{
	struct fixture fixture = begin(state);
	struct snmp_flight *flight;
	uint32_t wanted = 1;

	start_agent(&fixture);
	for (unsigned i = 0; i < 6000; i++) {
		fixture.agent.now_ns += NS_PER_S / 100;
		add_events(&fixture, 1);
		run_unanswered(&fixture);
	}
	assert_true(fixture.agent.sinks[0].silent);
	fixture.agent.now_ns += 61 * NS_PER_S;
	assert_int_equal(snmp_sink_next(&fixture.agent, 0, &flight), SNMP_SEND_PROBE);
	snmp_sink_probed(&fixture.agent, 0);
	snmp_sink_answered(&fixture.agent, 0, NULL);
	for (; (flight = send_one(&fixture)) != NULL; wanted++) {
		assert_int_equal(flight->first, wanted);
		snmp_sink_answered(&fixture.agent, 0, flight);
	}
	assert_int_equal(wanted, fixture.agent.position.last + 1);
	assert_int_equal(fixture.shared->sink_lost[0], 0);
	end(&fixture);
}

static void test_what_left_the_table_is_counted(void **state)
{
	struct fixture fixture = begin(state);
	struct snmp_flight *flight;

	start_agent(&fixture);
	add_events(&fixture, SNMP_EVENTS + 8); /* beside coldStart and rtuStarted */
	flight = send_one(&fixture);
	assert_int_equal(flight->first, 11);
	assert_int_equal(fixture.shared->sink_lost[0], 10);
	end(&fixture);
}

/* As after kill -9: what the segment holds is all there is. */
static void test_another_process_goes_on_with_the_numbers(void **state)
{
	struct fixture fixture = begin(state);
	struct snmp_agent next;

	start_agent(&fixture);
	add_events(&fixture, 4);
	snmp_sink_answered(&fixture.agent, 0, send_one(&fixture));
	assert_true(snmp_begin(&next, fixture.map, fixture.shared));
	assert_int_equal(next.position.last, 6);
	assert_int_equal(next.sinks[0].next, 2);
	snmp_end(&next);
	end(&fixture);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    TEST(test_each_instance_is_behind_the_one_before),
	    TEST(test_the_next_of_any_name_is_the_first_behind_it),
	    TEST(test_an_interface_has_one_number),
	    TEST(test_the_list_of_interfaces_takes_its_place),
	    TEST(test_of_too_many_the_first_are_told),
	    TEST(test_links_that_go_down_and_up_are_told),
	    TEST(test_a_link_that_goes_is_down_and_comes_up_again),
	    TEST(test_a_loose_contact_fills_no_table_of_events),
	    TEST(test_a_large_storage_has_large_units),
	    TEST(test_keys_are_taken_whole_or_not_at_all),
	    TEST(test_a_window_is_confirmed_in_order),
	    TEST(test_a_silent_sink_is_probed_and_loses_nothing),
	    TEST(test_a_sink_that_is_away_for_a_minute_misses_nothing),
	    TEST(test_what_left_the_table_is_counted),
	    TEST(test_another_process_goes_on_with_the_numbers),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
