/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A frame on a pseudo-terminal of a size that is set. */
#include <pty.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>

#include "rtuctl/terminal.h"

#define ROWS    3
#define COLUMNS 5

static const char frame[] = "\033[32mgr\303\274n is good\033[0m\nabcde\nabcdef\nfourth";
static const char drawn[] =
    "\033[H\033[32mgr\303\274n \033[0m\033[0m\033[K\r\nabcde\033[0m\033[K\r\nabcde\033[0m\033[K\033[J";

static void test_width(void **state)
{
	(void)state;
	assert_int_equal(terminal_width("plain"), 5);
	assert_int_equal(terminal_width("gr\303\274n"), 4);
	assert_int_equal(terminal_width("\033[1;31mred\033[0m"), 3);
	assert_int_equal(terminal_width("cut \033[3"), 4);
}

static void test_frame_is_clipped_to_the_terminal(void **state)
{
	const struct winsize size = {.ws_row = ROWS, .ws_col = COLUMNS};
	char seen[256] = "";
	size_t length = 0;
	int terminal;
	pid_t child = forkpty(&terminal, NULL, NULL, &size);

	(void)state;
	if (child == 0) {
		terminal_draw(frame);
		_exit(0);
	}
	assert_true(child > 0);
	for (ssize_t got; (got = read(terminal, seen + length, sizeof(seen) - 1 - length)) > 0;)
		length += (size_t)got;
	waitpid(child, NULL, 0);
	assert_string_equal(seen, drawn);
}

static void test_no_terminal_is_not_taken(void **state)
{
	int pipes[2];

	(void)state;
	assert_int_equal(pipe(pipes), 0);
	dup2(pipes[0], STDIN_FILENO);
	assert_false(terminal_open());
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_width),
	    cmocka_unit_test(test_frame_is_clipped_to_the_terminal),
	    cmocka_unit_test(test_no_terminal_is_not_taken),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
