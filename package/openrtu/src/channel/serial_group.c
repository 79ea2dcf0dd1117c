/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Why a port does not open to us: whose it is, and what to type. With the system calls of serial.c alone. */
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/auxv.h>
#include <sys/stat.h>
#include <unistd.h>

#include "channel/serial.h"
#include "map/users.h"

#define LINE_SIZE     1024
#define NAME_SIZE     33 /* shadow-utils: 32 characters */
#define GROUP_MODE    (S_IRGRP | S_IWGRP)
#define GROUPS_FILE   "/etc/group"
#define MODULES_GROUP "dialout" /* what rtud, as root, gives to the modules that open ports */

static bool look_at(const char *path, struct stat *status)
{
	int fd = open(path, O_PATH | O_CLOEXEC);
	bool seen = fd >= 0 && fstat(fd, status) == 0;

	if (fd >= 0)
		close(fd);
	return seen;
}

/* dialout:x:20:anna,ben */
static bool take_name(char *line, gid_t group, char name[NAME_SIZE])
{
	char *rest = line, *first = strsep(&rest, ":");
	const char *number;

	strsep(&rest, ":");
	number = strsep(&rest, ":");
	if (number == NULL || (gid_t)strtoul(number, NULL, 10) != group)
		return false;
	snprintf(name, NAME_SIZE, "%s", first);
	return true;
}

/* Of what was read, the lines that are whole; moves the rest to the front and returns its size. */
static size_t take_lines(char *text, size_t size, gid_t group, char name[NAME_SIZE], bool *found)
{
	char *line = text, *end;

	text[size] = '\0';
	while (!*found && (end = strchr(line, '\n')) != NULL) {
		*end = '\0';
		*found = take_name(line, group, name);
		line = end + 1;
	}
	size -= (size_t)(line - text);
	memmove(text, line, size);
	return size;
}

/* Not getgrgid, which asks whatever the system's name service is: a filter of system calls would end the process. */
static void name_group(gid_t group, char name[NAME_SIZE])
{
	int fd = open(GROUPS_FILE, O_RDONLY | O_CLOEXEC);
	char text[LINE_SIZE + 1];
	size_t size = 0;
	ssize_t count;
	bool found = false;

	snprintf(name, NAME_SIZE, "%u", (unsigned)group);
	while (fd >= 0 && !found && size < LINE_SIZE && (count = read(fd, text + size, LINE_SIZE - size)) > 0)
		size = take_lines(text, size + (size_t)count, group, name, &found);
	if (fd >= 0)
		close(fd);
}

/* rtud, as root, runs a module as a user without account, the group's number and that of the module. */
static bool has_user_of_its_own(void)
{
	unsigned long user = getauxval(AT_UID), group = getauxval(AT_GID);

	return user > group && user - group <= LAST_USER;
}

void serial_explain(const char *path, char hint[SERIAL_HINT_SIZE])
{
	struct stat status;
	char name[NAME_SIZE];

	if (!look_at(path, &status))
		return;
	name_group(status.st_gid, name);
	if ((status.st_mode & GROUP_MODE) != GROUP_MODE)
		snprintf(hint, SERIAL_HINT_SIZE, "its group, %s, may not read and write it (mode %04o)", name,
			 status.st_mode & 07777u);
	else if (status.st_gid == 0 || has_user_of_its_own()) /* nobody shall join root's */
		snprintf(hint, SERIAL_HINT_SIZE, "its group is %s: sudo chgrp " MODULES_GROUP " %.63s", name,
			 path);
	else
		snprintf(hint, SERIAL_HINT_SIZE,
			 "its group is %s; join it: sudo usermod -aG %s $USER, and log in again", name, name);
}
