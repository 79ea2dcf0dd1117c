/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The file on the disk, and those before it. A process that ends at any of its calls leaves the old file or the new one. */
#include "rtud/history.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>

#include "web/setup.h"

static char folder[] = "/tmp/openrtu-history-XXXXXX";
static char path[sizeof(folder) + 16];
static int calls_left = -1; /* until the process ends; -1: it does not */

static void count_call(void)
{
	if (calls_left == 0)
		_exit(1);
	if (calls_left > 0)
		calls_left--;
}

int __real_fsync(int fd);
int __wrap_fsync(int fd);
int __real_renameat(int from, const char *old, int to, const char *new);
int __wrap_renameat(int from, const char *old, int to, const char *new);
ssize_t __real_write(int fd, const void *octets, size_t size);
ssize_t __wrap_write(int fd, const void *octets, size_t size);

int __wrap_fsync(int fd)
{
	count_call();
	return __real_fsync(fd);
}

int __wrap_renameat(int from, const char *old, int to, const char *new)
{
	count_call();
	return __real_renameat(from, old, to, new);
}

/* Half of it, when it is the last. */
ssize_t __wrap_write(int fd, const void *octets, size_t size)
{
	if (calls_left == 0)
		__real_write(fd, octets, size / 2);
	count_call();
	return __real_write(fd, octets, size);
}

static struct history_text text_of(const char *words)
{
	return (struct history_text){.octets = (char *)(uintptr_t)words, .length = strlen(words)};
}

static bool replace(const char *former, const char *text, const char *user)
{
	const struct history_text was = text_of(former), is = text_of(text);
	FILE *nowhere = fopen("/dev/null", "w");
	const bool done = history_replace(path, &was, &is, user, nowhere);

	fclose(nowhere);
	return done;
}

static void assert_file_is(const char *words)
{
	struct history_text text;

	assert_true(history_read(path, &text));
	assert_string_equal(text.octets, words);
	free(text.octets);
}

static void write_file(const char *words)
{
	FILE *file = fopen(path, "w");

	fputs(words, file);
	fclose(file);
}

static int begin(void **state)
{
	(void)state;
	if (mkdtemp(folder) == NULL)
		return -1;
	snprintf(path, sizeof(path), "%s/gateway.json", folder);
	return 0;
}

static int end(void **state)
{
	char command[sizeof(folder) + 16];

	(void)state;
	snprintf(command, sizeof(command), "rm -r %s", folder);
	return system(command);
}

static void test_what_was_there_can_be_had_again(void **state)
{
	struct history_text text;
	struct stat status;
	json_t *list;

	(void)state;
	write_file("one");
	chmod(path, 0640);
	assert_true(replace("one", "two", "anna/../../etc"));
	assert_file_is("two");
	assert_int_equal(stat(path, &status), 0);
	assert_int_equal(status.st_mode & 07777, 0640);
	list = history_list(path);
	assert_int_equal(json_array_size(list), 1);
	assert_string_equal(json_string_value(json_object_get(json_array_get(list, 0), "user")),
			    "anna-..-..-etc");
	json_decref(list);
	assert_true(history_recall(path, 1, &text));
	assert_string_equal(text.octets, "one");
	free(text.octets);
	assert_false(history_recall(path, 2, &text));
}

static void test_who_has_no_name_is_listed_too(void **state)
{
	json_t *list;

	(void)state;
	assert_true(replace("two", "two", ""));
	list = history_list(path);
	assert_int_equal(json_array_size(list), 2);
	assert_string_equal(json_string_value(json_object_get(json_array_get(list, 0), "user")), "-");
	json_decref(list);
}

static void test_so_many_are_kept(void **state)
{
	json_t *list;

	(void)state;
	for (unsigned i = 0; i < SETUP_HISTORY + 5; i++)
		assert_true(replace("two", "two", "bert"));
	list = history_list(path);
	assert_int_equal(json_array_size(list), SETUP_HISTORY);
	assert_int_equal(json_integer_value(json_object_get(json_array_get(list, 0), "number")),
			 SETUP_HISTORY + 7);
	json_decref(list);
}

static void test_what_cannot_be_written_stays(void **state)
{
	char history[sizeof(path) + 16];

	(void)state;
	snprintf(history, sizeof(history), "%s.history/x", path);
	assert_int_equal(symlink("/etc/passwd", history), 0); /* is none of the history */
	assert_true(replace("two", "two", "bert"));
	snprintf(path, sizeof(path), "%s/none/g.json", folder);
	assert_false(replace("a", "b", "bert"));
	snprintf(path, sizeof(path), "%s/gateway.json", folder);
	assert_file_is("two");
}

static void test_a_file_that_was_not_there_is_made(void **state)
{
	struct history_text text;

	(void)state;
	snprintf(path, sizeof(path), "%s/kept.json", folder);
	assert_true(replace("elsewhere", "kept", "bert"));
	assert_file_is("kept");
	assert_true(history_recall(path, 1, &text));
	assert_string_equal(text.octets, "elsewhere");
	free(text.octets);
	snprintf(path, sizeof(path), "%s/gateway.json", folder);
}

/* A process that ends at the call of that number. True: it did. */
static bool ends_at(int call, const char *former, const char *text)
{
	int status;
	const pid_t pid = fork();

	if (pid == 0) {
		calls_left = call;
		_exit(replace(former, text, "anna") ? 0 : 2);
	}
	assert_int_equal(waitpid(pid, &status, 0), pid);
	assert_true(WIFEXITED(status) && WEXITSTATUS(status) < 2);
	return WEXITSTATUS(status) == 1;
}

static void test_who_ends_anywhere_leaves_one_of_both(void **state)
{
	struct history_text text;
	unsigned old = 0, new = 0;
	int call = 0;

	(void)state;
	do {
		write_file("the old one");
		if (!ends_at(call++, "the old one", "the new one"))
			break;
		assert_true(history_read(path, &text));
		old += strcmp(text.octets, "the old one") == 0;
		new += strcmp(text.octets, "the new one") == 0;
		free(text.octets);
		assert_int_equal(old + new, call);
	} while (call < 100);
	assert_true(old >= 6 && new >= 1 && call < 100);
	assert_file_is("the new one");
	/* What was left half-written is in nobody's way. */
	assert_true(replace("the new one", "the last one", "anna"));
	assert_file_is("the last one");
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_what_was_there_can_be_had_again),
	    cmocka_unit_test(test_who_has_no_name_is_listed_too),
	    cmocka_unit_test(test_so_many_are_kept),
	    cmocka_unit_test(test_what_cannot_be_written_stays),
	    cmocka_unit_test(test_a_file_that_was_not_there_is_made),
	    cmocka_unit_test(test_who_ends_anywhere_leaves_one_of_both),
	};

	return cmocka_run_group_tests(tests, begin, end);
}
