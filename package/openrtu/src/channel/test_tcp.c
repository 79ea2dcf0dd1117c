/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "channel/tcp.h"

#define SOON_MS 2000
#define HOST    "127.0.0.1"

/* A port of this host that is bound, and listened on when asked for. */
static int bind_somewhere(uint16_t *port)
{
	struct sockaddr_in address = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
	socklen_t size = sizeof(address);
	int fd = socket(AF_INET, SOCK_STREAM, 0);

	assert_int_equal(bind(fd, (struct sockaddr *)&address, size), 0);
	assert_int_equal(getsockname(fd, (struct sockaddr *)&address, &size), 0);
	*port = ntohs(address.sin_port);
	return fd;
}

static enum tcp_state decided(int fd, char *error)
{
	struct pollfd waits = {.fd = fd, .events = POLLOUT};

	assert_int_equal(poll(&waits, 1, SOON_MS), 1);
	return tcp_look(fd, error);
}

static int option(int fd, int level, int name)
{
	int value = 0;
	socklen_t size = sizeof(value);

	assert_int_equal(getsockopt(fd, level, name, &value, &size), 0);
	return value;
}

static void test_a_connection_notices_a_dead_peer_and_does_not_collect(void **state)
{
	(void)state;
	uint16_t port;
	char error[TCP_ERROR_SIZE];
	int listener = bind_somewhere(&port);

	assert_int_equal(listen(listener, 1), 0);
	int fd = tcp_connect(HOST, port, error);
	assert_true(fd >= 0);
	assert_int_equal(decided(fd, error), TCP_CONNECTED);
	assert_true(option(fd, IPPROTO_TCP, TCP_NODELAY));
	assert_true(option(fd, SOL_SOCKET, SO_KEEPALIVE));
	assert_int_equal(option(fd, IPPROTO_TCP, TCP_USER_TIMEOUT), 5000);
	close(fd);
	close(listener);
}

static void test_nobody_listens(void **state)
{
	(void)state;
	uint16_t port;
	char error[TCP_ERROR_SIZE];
	int holder = bind_somewhere(&port), fd = tcp_connect(HOST, port, error);

	if (fd >= 0)
		assert_int_equal(decided(fd, error), TCP_FAILED);
	assert_string_equal(error, "cannot be connected: Connection refused");
	if (fd >= 0)
		close(fd);
	close(holder);
}

/* Behind a full backlog, as before a host that is not there. */
static void test_nobody_answers(void **state)
{
	(void)state;
	uint16_t port;
	char error[TCP_ERROR_SIZE];
	int listener = bind_somewhere(&port), fds[16], count = 0;
	enum tcp_state last = TCP_CONNECTED;

	assert_int_equal(listen(listener, 0), 0);
	while (last == TCP_CONNECTED && count < 16) {
		struct pollfd waits = {.events = POLLOUT};

		fds[count] = waits.fd = tcp_connect(HOST, port, error);
		assert_true(fds[count++] >= 0);
		poll(&waits, 1, 200);
		last = tcp_look(waits.fd, error);
	}
	assert_int_equal(last, TCP_PENDING);
	while (count > 0)
		close(fds[--count]);
	close(listener);
}

static void test_no_way_there(void **state)
{
	(void)state;
	char error[TCP_ERROR_SIZE] = "";

	assert_int_equal(tcp_connect("255.255.255.255", 502, error), -1);
	assert_non_null(strstr(error, "cannot be connected: "));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
	    cmocka_unit_test(test_a_connection_notices_a_dead_peer_and_does_not_collect),
	    cmocka_unit_test(test_nobody_listens),
	    cmocka_unit_test(test_nobody_answers),
	    cmocka_unit_test(test_no_way_there),
	};
	return cmocka_run_group_tests_name("tcp", tests, NULL, NULL);
}
