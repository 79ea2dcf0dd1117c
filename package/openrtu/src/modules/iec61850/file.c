/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/iec61850/file.h"

#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "modules/iec61850/cid.h"

#define SIZE_MOST (4 << 20) /* the board has 64 MiB; 5 000 points take some 2.5 */

/* The descriptor of the file, which nobody can change any more. -1 with errno. */
static int write_file(const struct iec61850_model *model)
{
	const int fd = memfd_create("scl", MFD_CLOEXEC | MFD_ALLOW_SEALING);
	FILE *out = fd < 0 ? NULL : fdopen(dup(fd), "w");
	bool good = out != NULL;

	if (good) {
		cid_write(out, model, true, NULL);
		good = ferror(out) == 0;
		good = fclose(out) == 0 && good;
	}
	if (good && fcntl(fd, F_ADD_SEALS, F_SEAL_WRITE | F_SEAL_GROW | F_SEAL_SHRINK | F_SEAL_SEAL) == 0)
		return fd;
	if (fd >= 0)
		close(fd);
	return -1;
}

static bool map_file(struct iec61850_server *server, int fd)
{
	struct stat about;
	void *octets;

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

void file_make(struct iec61850_server *server, struct map *map)
{
	const int fd = write_file(&server->model);

	if (!map_file(server, fd))
		map_log(map, MAP_LOG_WARNING, "has no SCL file for its clients: %s", strerror(errno));
	if (fd >= 0)
		close(fd);
	date_file(server, map);
}
