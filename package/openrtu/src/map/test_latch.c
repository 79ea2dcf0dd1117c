/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What readers see while a writer follows one that was killed anywhere. */
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <sys/mman.h>

#include <cmocka.h>

#include "map/latch.h"

#define WORDS 512

struct record {
	uint32_t words[WORDS];
};

static map_latch latch;
static struct record copies[2];
static sigjmp_buf stopped;

static void on_fault(int number)
{
	(void)number;
	siglongjmp(stopped, 1);
}

static struct record of(uint32_t word)
{
	struct record record;

	for (unsigned i = 0; i < WORDS; i++)
		record.words[i] = word;
	return record;
}

/* Stops before anything of the new record is there: its page cannot be read. */
static void store_until_stopped(void *page)
{
	if (sigsetjmp(stopped, 1) == 0) {
		latch_store(&latch, copies, page, sizeof(struct record));
		fail_msg("it was not stopped");
	}
}

static void test_a_torn_copy_is_never_shown(void **state)
{
	const struct record before = of(1), next = of(2);
	struct record seen;
	void *page = mmap(NULL, sizeof(struct record), PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);

	(void)state;
	assert_true(page != MAP_FAILED);
	signal(SIGSEGV, on_fault);
	for (unsigned flips = 0; flips <= 2;
	     flips++) { /* of the former writer, who dies within the last one's copy */
		unsigned torn = !latch_whole_copy(&latch);

		latch_store(&latch, copies, &before, sizeof(before));
		for (unsigned i = 0; i < flips; i++)
			torn = latch_flip(&latch);
		memcpy(&copies[torn], &next, sizeof(next) / 2);
		for (unsigned i = 0; i < 2; i++) {
			store_until_stopped(page);
			assert_true(latch_load(&latch, copies, &seen, sizeof(seen)));
			assert_memory_equal(&seen, &before, sizeof(seen));
		}
		latch_store(&latch, copies, &next, sizeof(next));
		assert_true(latch_load(&latch, copies, &seen, sizeof(seen)));
		assert_memory_equal(&seen, &next, sizeof(seen));
		latch_store(&latch, copies, &before, sizeof(before));
	}
	signal(SIGSEGV, SIG_DFL);
	munmap(page, sizeof(struct record));
}

int main(void)
{
	const struct CMUnitTest tests[] = {cmocka_unit_test(test_a_torn_copy_is_never_shown)};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
