/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * What the tests of the flash do on the board that no program of its image does: one page with what the driver says
 * of it, one block, and files written so that a power cut has something to destroy.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <mtd/mtd-user.h>

#define PAGE        2048
#define SPARE       64
#define RECORD_MAX  6000
#define FILES       7
#define REPLACED_IN 4 /* of so many records, one replaces a file instead */

static void fail(const char *what)
{
	fprintf(stderr, "%s: %s\n", what, strerror(errno));
	exit(1);
}

static int opened(const char *path, int flags)
{
	int fd = open(path, flags, 0600);

	if (fd < 0)
		fail(path);
	return fd;
}

static uintptr_t address(const void *memory)
{
	return (uintptr_t)memory;
}

/* ---- pages and blocks */

static void erase(int fd, uint32_t start)
{
	struct mtd_info_user info;
	struct erase_info_user block = {.start = start};

	if (ioctl(fd, MEMGETINFO, &info) < 0)
		fail("MEMGETINFO");
	block.length = info.erasesize;
	if (ioctl(fd, MEMERASE, &block) < 0)
		fail("erase");
}

static void print_hex(const uint8_t *bytes, size_t count)
{
	for (size_t i = 0; i < count; i++)
		printf("%02x", bytes[i]);
}

/* Errors uncorrected, bits corrected, the most in one step; how the call ended; data and spare bytes. */
static void read_page(int fd, uint32_t start, uint8_t mode)
{
	static uint8_t data[PAGE], spare[SPARE];
	struct mtd_read_req request = {
	    .start = start,
	    .len = PAGE,
	    .ooblen = SPARE,
	    .usr_data = address(data),
	    .usr_oob = address(spare),
	    .mode = mode,
	};
	int error = ioctl(fd, MEMREAD, &request) < 0 ? errno : 0;

	if (error && error != EBADMSG && error != EUCLEAN)
		fail("read");
	printf("%u %u %u %s ", request.ecc_stats.uncorrectable_errors, request.ecc_stats.corrected_bitflips,
	       request.ecc_stats.max_bitflips,
	       error == EBADMSG ? "EBADMSG"
	       : error          ? "EUCLEAN"
				: "good");
	print_hex(data, PAGE);
	print_hex(spare, SPARE);
	putchar('\n');
}

static void write_page(int fd, uint32_t start, uint8_t mode)
{
	uint8_t page[PAGE + SPARE];
	size_t size = fread(page, 1, sizeof(page), stdin);
	struct mtd_write_req request = {
	    .start = start,
	    .len = PAGE,
	    .ooblen = size - PAGE,
	    .usr_data = address(page),
	    .usr_oob = size > PAGE ? address(page + PAGE) : 0,
	    .mode = mode,
	};

	if (ioctl(fd, MEMWRITE, &request) < 0)
		fail("write");
}

/* ---- files */

/* The n-th content: its size, then bytes that only this number has. */
static size_t content(uint32_t number, uint8_t *bytes)
{
	uint32_t state = number * 2654435761u + 1;
	uint32_t size = 8 + (state >> 8) % (RECORD_MAX - 8);

	memcpy(bytes, &number, 4);
	memcpy(bytes + 4, &size, 4);
	for (size_t i = 8; i < size; i++) {
		state = state * 1664525u + 1013904223u;
		bytes[i] = (uint8_t)(state >> 24);
	}
	return size;
}

static void write_all(int fd, const uint8_t *bytes, size_t size)
{
	while (size > 0) {
		ssize_t done = write(fd, bytes, size);

		if (done < 0)
			fail("write");
		bytes += done;
		size -= (size_t)done;
	}
	if (fsync(fd) < 0)
		fail("fsync");
}

static void replace_file(uint32_t number, const uint8_t *bytes, size_t size)
{
	char name[32];
	int fd = opened("new", O_WRONLY | O_CREAT | O_TRUNC), folder;

	snprintf(name, sizeof(name), "file%u", number % FILES);
	write_all(fd, bytes, size);
	close(fd);
	if (rename("new", name) < 0)
		fail("rename");
	folder = opened(".", O_RDONLY);
	if (fsync(folder) < 0)
		fail("fsync of the folder");
	close(folder);
}

/* Prints each number once its content would survive. */
static void record(void)
{
	static uint8_t bytes[RECORD_MAX];
	int journal = opened("journal", O_WRONLY | O_CREAT | O_APPEND);

	for (uint32_t number = 1;; number++) {
		size_t size = content(number, bytes);

		if (number % REPLACED_IN == 0) {
			replace_file(number, bytes, size);
		} else {
			write_all(journal, bytes, size);
		}
		printf("kept %u.\n", number);
		fflush(stdout);
	}
}

static int is_content(int fd, uint32_t number)
{
	static uint8_t expected[RECORD_MAX], found[RECORD_MAX];
	size_t size = content(number, expected);

	return read(fd, found, size) == (ssize_t)size && memcmp(found, expected, size) == 0;
}

static uint32_t next_in_journal(uint32_t number)
{
	return number + 1 + ((number + 1) % REPLACED_IN == 0);
}

/* The first number that is not whole in the journal, and each file's number. */
static void check(void)
{
	uint32_t number = 1;
	int fd = open("journal", O_RDONLY);

	while (fd >= 0 && is_content(fd, number))
		number = next_in_journal(number);
	printf("journal %u\n", number);
	for (uint32_t i = 0; i < FILES; i++) {
		char name[32];
		uint32_t found;

		snprintf(name, sizeof(name), "file%u", i);
		fd = open(name, O_RDONLY);
		if (fd < 0)
			continue;
		if (read(fd, &found, sizeof(found)) != sizeof(found) || lseek(fd, 0, SEEK_SET) < 0 ||
		    !is_content(fd, found) || found % FILES != i)
			printf("%s broken\n", name);
		else
			printf("%s %u\n", name, found);
		close(fd);
	}
}

int main(int argc, char **argv)
{
	const char *command = argc > 1 ? argv[1] : "";
	uint8_t mode = argc > 4 && !strcmp(argv[4], "raw") ? MTD_OPS_RAW : MTD_OPS_PLACE_OOB;

	if (argc == 2 && !strcmp(command, "record")) {
		record();
	} else if (argc == 2 && !strcmp(command, "check")) {
		check();
	} else if (argc >= 4) {
		uint32_t start = (uint32_t)strtoul(argv[3], NULL, 0);
		int fd = opened(argv[2], !strcmp(command, "read") ? O_RDONLY : O_RDWR);

		if (!strcmp(command, "erase"))
			erase(fd, start);
		else if (!strcmp(command, "read"))
			read_page(fd, start, mode);
		else
			write_page(fd, start, mode);
	} else {
		fputs("usage: flashwork erase|read|write DEVICE OFFSET [raw] | record | check\n", stderr);
		return 2;
	}
	return 0;
}
