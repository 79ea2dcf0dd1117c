/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/iec61850/file.h"

#include <errno.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#define SIZE_MOST (4 << 20) /* the board has 64 MiB; 5 000 points take some 2 */

static bool map_file(struct iec61850_server *server, int fd)
{
	struct stat about;
	void *octets;

	errno = ENOENT; /* rtud could not write it */
	if (fd < 0 || fstat(fd, &about) < 0)
		return false;
	if (about.st_size > SIZE_MOST) {
		errno = EFBIG;
		return false;
	}
	octets = mmap(NULL, (size_t)about.st_size, PROT_READ, MAP_SHARED, fd, 0);
	if (octets == MAP_FAILED)
		return false;
	server->file = octets;
	server->file_size = (size_t)about.st_size;
	return true;
}

/* Here: gmtime_r reads a file, which is forbidden later. */
static void date_file(struct iec61850_server *server, const struct map *map)
{
	const int64_t wall_ns = map_wall_ns(map_clock_read(map), map_now_ns());
	const time_t seconds = (time_t)(wall_ns / NS_PER_S);
	struct tm date;

	if (wall_ns > 0 && gmtime_r(&seconds, &date) != NULL &&
	    strftime(server->file_date, sizeof(server->file_date), "%Y%m%d%H%M%SZ", &date) == 0)
		server->file_date[0] = '\0'; /* a year of five figures */
}

void file_take(struct iec61850_server *server, struct map *map, int fd)
{
	if (!map_file(server, fd))
		map_log(map, MAP_LOG_WARNING, "has no SCL file for its clients: %s", strerror(errno));
	if (fd >= 0)
		close(fd);
	date_file(server, map);
}
