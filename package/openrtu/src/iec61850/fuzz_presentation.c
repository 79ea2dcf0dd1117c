/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * libFuzzer on the presentation layer: what a CP-type or user data carry lies inside them, each context has its answer in the
 * CPA-type, and what is written around user data is taken off again.
 */
#include "ber/fuzz_element.h"
#include "iec61850/presentation.h"

#define OCTETS_MAX 8192

enum { CPA_TYPE = 0x31, NORMAL_MODE = 0xa2, RESPONDING_SELECTOR = 0x83, RESULTS = 0xa5, RESULT = 0x80 };

static uint8_t octets[OCTETS_MAX];

static void check_results(const struct ber_element *normal, const struct iec61850_contexts *contexts)
{
	struct ber_element results, each, result;
	struct ber_reader reader;
	int64_t number;

	CHECK(ber_find(normal, RESULTS, &results));
	reader = ber_inside(&results);
	for (unsigned i = 0; i < contexts->count; i++) {
		CHECK(ber_expect(&reader, BER_SEQUENCE, &each) && ber_find(&each, RESULT, &result));
		CHECK(ber_integer(&result, &number) && (number == 0) == contexts->known[i]);
	}
	CHECK(reader.at == reader.end);
}

static void accept(const struct iec61850_contexts *contexts, const struct ber_element *called,
		   const struct ber_element *carried)
{
	struct ber_writer writer = {.octets = octets, .at = sizeof(octets)};
	struct ber_element whole, normal, selector;
	struct ber_reader reader;

	ber_put_octets(&writer, carried->value, carried->size);
	iec61850_presentation_accept(&writer, contexts, called, sizeof(octets));
	whole = written(&writer, sizeof(octets));
	reader = ber_inside(&whole);
	CHECK(ber_expect(&reader, CPA_TYPE, &normal) && reader.at == reader.end);
	CHECK(ber_find(&normal, NORMAL_MODE, &normal));
	check_results(&normal, contexts);
	CHECK(ber_find(&normal, RESPONDING_SELECTOR, &selector) == (called->size > 0));
	if (called->size > 0)
		check_same(&selector, called);
}

static void reject(const struct iec61850_contexts *contexts, const struct ber_element *called,
		   const struct ber_element *carried)
{
	struct ber_writer writer = {.octets = octets, .at = sizeof(octets)};
	struct ber_element whole, normal;
	struct ber_reader reader;

	ber_put_octets(&writer, carried->value, carried->size);
	iec61850_presentation_reject(&writer, contexts, called, sizeof(octets));
	whole = written(&writer, sizeof(octets));
	reader = ber_inside(&whole);
	CHECK(ber_expect(&reader, BER_SEQUENCE, &normal) && reader.at == reader.end);
	check_results(&normal, contexts);
}

static void connect(const struct ber_element *whole)
{
	struct iec61850_contexts contexts;
	struct ber_element called, acse;

	if (!iec61850_presentation_connect(whole, &contexts, &called, &acse))
		return;
	check_inside(&acse, whole);
	CHECK(contexts.count <= IEC61850_CONTEXTS_MAX && contexts.acse > 0 && contexts.mms > 0);
	CHECK(called.size <= IEC61850_PRESENTATION_SELECTOR_MAX);
	if (called.size > 0)
		check_inside(&called, whole);
	accept(&contexts, &called, &acse);
	reject(&contexts, &called, &acse);
}

static void read_data(const struct ber_element *whole, int8_t context)
{
	struct ber_writer writer = {.octets = octets, .at = sizeof(octets)};
	struct ber_element carried, again, envelope;

	if (!iec61850_presentation_read(whole, context, &carried))
		return;
	check_inside(&carried, whole);
	ber_put_octets(&writer, carried.value, carried.size);
	iec61850_presentation_write(&writer, context, sizeof(octets));
	envelope = written(&writer, sizeof(octets));
	CHECK(iec61850_presentation_read(&envelope, context, &again));
	check_same(&again, &carried);
	CHECK(!iec61850_presentation_read(&envelope, (int8_t)(context + 1), &again));
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	const struct ber_element whole = {.value = data, .size = size};

	if (size > OCTETS_MAX / 2)
		return 0;
	connect(&whole);
	read_data(&whole, 1);
	read_data(&whole, 3);
	return 0;
}
