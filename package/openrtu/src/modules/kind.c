/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/kind.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include "map/address.h"

#define BACKLOG 64

enum kind_change kind_starts_again(const struct map_config *before, const struct map_config *now)
{
	(void)before, (void)now;
	return KIND_STARTS_AGAIN;
}

static bool bind_to(int fd, const struct in6_addr *address, uint16_t port)
{
	struct sockaddr_in6 six = {.sin6_family = AF_INET6, .sin6_port = htons(port), .sin6_addr = *address};
	struct sockaddr_in four = {.sin_family = AF_INET, .sin_port = htons(port)};

	if (!IN6_IS_ADDR_V4MAPPED(address))
		return bind(fd, (const struct sockaddr *)&six, sizeof(six)) == 0;
	memcpy(&four.sin_addr, &address->s6_addr[12], sizeof(four.sin_addr));
	return bind(fd, (const struct sockaddr *)&four, sizeof(four)) == 0;
}

int kind_open_port(const char *address, uint16_t port, int type)
{
	const int on = 1;
	struct in6_addr parsed;
	int fd, error;

	if (!map_address_parse(address, &parsed)) {
		errno = EINVAL;
		return -1;
	}
	fd = socket(IN6_IS_ADDR_V4MAPPED(&parsed) ? AF_INET : AF_INET6, type | SOCK_NONBLOCK | SOCK_CLOEXEC,
		    0);
	if (fd < 0)
		return -1;
	if (type == SOCK_STREAM)
		setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on));
	if (bind_to(fd, &parsed, port) && (type != SOCK_STREAM || listen(fd, BACKLOG) == 0))
		return fd;
	error = errno;
	close(fd);
	errno = error;
	return -1;
}

void kind_give_secret(struct map *map, const char *path, const char *what, uid_t user, gid_t group)
{
	const int fd = open(path, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
	struct stat status;

	if (fd < 0)
		return; /* the module says what is wrong with it */
	if (fstat(fd, &status) == 0 && S_ISREG(status.st_mode) &&
	    (fchown(fd, user, group) < 0 || fchmod(fd, 0400) < 0))
		map_log(map, MAP_LOG_ERROR, "cannot give %s: %s", what, strerror(errno));
	close(fd);
}
