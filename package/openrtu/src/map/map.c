/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Attaching to the map's files, taking a changed configuration, letting go. */
#include "map/map.h"

#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "map/layout.h"
#include "map/supervise.h"
#include "map/time_ns.h"

#define EPOCH_TRIES 16 /* a configuration that is changed again while it is opened */
#define TURN_MS     1  /* between two looks whether it is the caller's turn */

int map_fail(char *error, const char *format, ...)
{
	va_list arguments;

	va_start(arguments, format);
	vsnprintf(error, MAP_ERROR_SIZE, format, arguments);
	va_end(arguments);
	return -1;
}

/* No name of a module has a plus sign. */
void segment_file(char name[FILE_NAME_SIZE], const char *module, uint32_t made)
{
	if (made == 0)
		snprintf(name, FILE_NAME_SIZE, "%s.seg", module);
	else
		snprintf(name, FILE_NAME_SIZE, "%s+%u.seg", module, made);
}

void bell_file(char name[FILE_NAME_SIZE], const char *module)
{
	snprintf(name, FILE_NAME_SIZE, "%s.bell", module);
}

void config_file(char name[FILE_NAME_SIZE], uint32_t epoch)
{
	snprintf(name, FILE_NAME_SIZE, "rtud+%u.config", epoch);
}

/* ---- files ------------------------------------------------------------------------------- */

/* What the first bytes of the configuration and of rtud's segment say, the others' headers being their owners' to write. */
static int check_header(const struct segment_header *header, uint32_t magic, const char *name, size_t size,
			char *error)
{
	if (header->magic != magic)
		return map_fail(error, "%s is not a segment of a point map", name);
	if (header->layout != MAP_LAYOUT)
		return map_fail(error,
				"%s has layout %u, this program was built for layout %u: restart rtud and "
				"all modules with the same version",
				name, header->layout, MAP_LAYOUT);
	if (header->fingerprint != layout_fingerprint() || header->size != size)
		return map_fail(
		    error, "%s has records of other sizes: the program that made it was built differently",
		    name);
	return 0;
}

/* Whether rtud opened this segment for us, whose user may not. */
static bool is_handed(int directory_fd, const char *name)
{
	struct stat file, handed;

	return (fcntl(MAP_SEGMENT_FD, F_GETFL) & O_ACCMODE) == O_RDWR &&
	       fstat(MAP_SEGMENT_FD, &handed) == 0 &&
	       fstatat(directory_fd, name, &file, AT_SYMLINK_NOFOLLOW) == 0 && file.st_dev == handed.st_dev &&
	       file.st_ino == handed.st_ino;
}

/* The descriptor is closed once the segment is mapped: what takes over the process later cannot truncate the file. */
static int open_file(int directory_fd, const char *name, bool writable)
{
	if (writable && is_handed(directory_fd, name))
		return MAP_SEGMENT_FD;
	return openat(directory_fd, name, (writable ? O_RDWR : O_RDONLY) | O_CLOEXEC | O_NOFOLLOW);
}

static const char *likely_cause(int code)
{
	if (code == EACCES)
		return " (rtud's user may write it, members of the modules' group may read it)";
	return code == ENOENT ? " (does rtud run?)" : "";
}

static void *map_file(int directory_fd, const char *name, bool writable, size_t *size, char *error)
{
	struct stat status;
	void *memory = MAP_FAILED;
	int fd;

	fd = open_file(directory_fd, name, writable);
	if (fd < 0) {
		map_fail(error, "cannot open %s: %s%s", name, strerror(errno), likely_cause(errno));
		return NULL;
	}
	if (fstat(fd, &status) == 0 && status.st_size >= (off_t)sizeof(struct segment_header))
		memory = mmap(NULL, (size_t)status.st_size, writable ? PROT_READ | PROT_WRITE : PROT_READ,
			      MAP_SHARED, fd, 0);
	close(fd);
	if (memory == MAP_FAILED) {
		map_fail(error, "cannot map %s: it is empty, or memory is short", name);
		errno = EIO;
		return NULL;
	}
	*size = (size_t)status.st_size;
	return memory;
}

/* ---- the configuration ------------------------------------------------------------------- */

static void count_tables(struct map_config *config, const struct config_header *file)
{
	*config = (struct map_config){
	    .settings = file->settings,
	    .set_count = file->set_count,
	    .point_count = file->point_count,
	    .gone_set_count = file->gone_set_count,
	    .gone_point_count = file->gone_point_count,
	    .names_size = file->names_size,
	};
	for (uint32_t i = 0; i < file->section_count; i++)
		map_add_section(config, file->sections[i].id, file->sections[i].record_size,
				file->sections[i].count, NULL);
}

static int place_tables(struct map *map, const struct config_header *file, size_t size, char *error)
{
	uint8_t *memory = (uint8_t *)(uintptr_t)file;
	struct config_layout layout;

	count_tables(&map->config, file);
	layout = config_layout_of(&map->config);
	if (layout.size != size)
		return map_fail(error, "the configuration has %zu bytes, its contents need %zu", size,
				layout.size);
	map->file = file;
	map->followed = file->epoch;
	map->module_count = file->module_count;
	memcpy(map->modules, file->modules, sizeof(map->modules));
	map->config.sets = (void *)(memory + layout.sets);
	map->config.points = (void *)(memory + layout.points);
	map->by_address = (void *)(memory + layout.by_address);
	map->owned = (void *)(memory + layout.owned);
	map->config.names = (char *)(memory + layout.names);
	for (uint32_t i = 0; i < map->config.section_count; i++)
		map->config.sections[i].records = memory + layout.sections[i];
	return 0;
}

/* Writable for rtud, whose file it is. -1 with ENOENT: it was followed by another. */
static int open_config(struct map *map, uint32_t epoch, bool writable, char *error)
{
	char name[FILE_NAME_SIZE];
	void *memory;
	size_t size;

	config_file(name, epoch);
	memory = map_file(map->directory_fd, name, writable, &size, error);
	if (!memory)
		return -1;
	if (size >= sizeof(struct config_header) &&
	    check_header(memory, CONFIG_MAGIC, name, size, error) == 0 &&
	    place_tables(map, memory, size, error) == 0)
		return 0;
	munmap(memory, size);
	errno = EIO;
	return -1;
}

/* made: of the own segment, which may be for a configuration that is not in force yet. */
static int open_newest_config(struct map *map, uint32_t made, bool writable, char *error)
{
	for (int tries = 0; tries < EPOCH_TRIES; tries++) {
		uint32_t epoch = atomic_load_explicit(&map->directory->epoch, memory_order_acquire);

		if (open_config(map, made > epoch ? made : epoch, writable, error) == 0)
			return 0;
		if (errno != ENOENT)
			break;
	}
	return -1;
}

/* ---- attach ------------------------------------------------------------------------------ */

/* rtud's segment first: it says what else there is, and which version. */
static int attach_directory(struct map *map, bool writable, char *error)
{
	const struct module_entry rtud = {.plan = {.flags = MAP_IS_SUPERVISOR}};
	const struct layout layout = layout_of(&rtud);
	size_t size;
	uint8_t *memory = map_file(map->directory_fd, "rtud.seg", writable, &size, error);

	if (!memory)
		return -1;
	map->segments[MAP_RTUD] = (struct segment){.header = (void *)memory, .size = size, .bell = -1};
	if (check_header((void *)memory, MAP_MAGIC, "rtud.seg", size, error) < 0)
		return -1;
	map->directory = (void *)(memory + layout.directory);
	return 0;
}

/* Of the segment that rtud has opened for this process; 0: none, or one of the first configuration. */
static uint32_t handed_made(int directory_fd, const char *module)
{
	struct segment_header header;
	char name[FILE_NAME_SIZE];

	if ((fcntl(MAP_SEGMENT_FD, F_GETFL) & O_ACCMODE) != O_RDWR ||
	    pread(MAP_SEGMENT_FD, &header, sizeof(header), 0) != sizeof(header))
		return 0;
	segment_file(name, module, header.made);
	return is_handed(directory_fd, name) ? header.made : 0;
}

static int find_self(struct map *map, const char *module, char *error)
{
	for (uint32_t i = 0; i < map_module_count(map); i++) {
		if (strcmp(map->modules[i].plan.name, module) == 0 &&
		    !(map->modules[i].plan.flags & MAP_IS_GONE)) {
			map->self = i;
			return 0;
		}
	}
	return map_fail(error, "the map has no module %s", module);
}

static int attach_segment(const struct map *map, uint32_t module, struct segment *out, char *error)
{
	const struct module_entry *entry = &map->modules[module];
	const struct layout layout = layout_of(entry);
	char name[FILE_NAME_SIZE];
	size_t size;
	void *memory;

	segment_file(name, entry->plan.name, entry->made);
	memory = map_file(map->directory_fd, name, module == map->self, &size, error);
	if (!memory)
		return -1;
	if (size != layout.size) {
		munmap(memory, size);
		return map_fail(error, "%s has %zu bytes, its contents need %zu", name, size, layout.size);
	}
	segment_place(out, memory, &layout);
	return 0;
}

static int attach_segments(struct map *map, char *error)
{
	const struct layout layout = layout_of(&map->modules[MAP_RTUD]);

	if (layout.size != map->segments[MAP_RTUD].size)
		return map_fail(error, "rtud.seg has %zu bytes, its contents need %zu",
				map->segments[MAP_RTUD].size, layout.size);
	segment_place(&map->segments[MAP_RTUD], map->segments[MAP_RTUD].header, &layout);
	for (uint32_t i = MAP_RTUD + 1; i < map_module_count(map); i++)
		if (attach_segment(map, i, &map->segments[i], error) < 0)
			return -1;
	return 0;
}

/* Opened for reading too: then it never fails for want of a listener, and never raises SIGPIPE. */
static int attach_bells(struct map *map, char *error)
{
	for (uint32_t i = 0; i < map_module_count(map); i++) {
		char name[FILE_NAME_SIZE];

		if (map->segments[i].bell >= 0)
			continue;
		bell_file(name, map->modules[i].plan.name);
		map->segments[i].bell =
		    openat(map->directory_fd, name, O_RDWR | O_NONBLOCK | O_CLOEXEC | O_NOFOLLOW);
		if (map->segments[i].bell < 0)
			return map_fail(error, "cannot open the bell %s: %s", name, strerror(errno));
	}
	return 0;
}

/* What the former process has published last is what this one compares with. */
static void report_carried(struct map *map)
{
	for (uint32_t i = 0; i < map->modules[map->self].point_count; i++) {
		const struct map_sample sample = shown_sample(map, point_in(map, map->self, i));

		map->reported[i] = (struct reported){.value = sample.value,
						     .quality = sample.quality,
						     .detail = sample.detail,
						     .valid = sample.time_ns != 0};
	}
}

/* What was asked of the former generation is not done by this one. */
static void forget_requests(struct map *map)
{
	struct segment_header *header = map->segments[map->self].header;

	for (uint32_t i = 0; i < map_module_count(map); i++) {
		header->request_next[i] = ring_head(&map->segments[i].requests);
		header->answer_next[i] = ring_head(&map->segments[i].answers);
	}
}

static void begin_generation(struct map *map)
{
	struct segment_header *header = map->segments[map->self].header;
	const bool carried = atomic_load(&header->carried) != 0;

	if (carried) {
		report_carried(map);
	} else {
		forget_requests(map);
		points_recover(map);
		commands_recover(map);
	}
	totals_recover(map);
	forces_recover(map);
	atomic_store(&header->carried, 0);
	atomic_store_explicit(&header->heartbeat_ms, now_ms(), memory_order_release);
	forces_follow(map);
	if (map->modules[map->self].plan.flags & MAP_IS_LOCAL)
		atomic_fetch_add(&header->generation, 1);
	else
		atomic_store(&header->generation,
			     atomic_load(&map->directory->modules[map->self].generation));
}

/* The configuration that this process was started for comes into force when the one before has ended. */
static void await_turn(const struct map *map)
{
	const struct timespec pause = {.tv_nsec = TURN_MS * NS_PER_MS};

	atomic_store(&map->segments[map->self].header->ready, 1);
	while (atomic_load_explicit(&map->directory->epoch, memory_order_acquire) < map->file->epoch)
		nanosleep(&pause, NULL);
}

static int attach_all(struct map *map, const char *module, char *error)
{
	const bool is_rtud = module && strcmp(module, "rtud") == 0;
	uint32_t made = 0;

	if (attach_directory(map, is_rtud, error) < 0)
		return -1;
	if (module && !is_rtud)
		made = handed_made(map->directory_fd, module);
	if (open_newest_config(map, made, is_rtud, error) < 0)
		return -1;
	if (module && find_self(map, module, error) < 0)
		return -1;
	if (attach_segments(map, error) < 0)
		return -1;
	if (!module)
		return 0;
	if (attach_bells(map, error) < 0)
		return -1;
	map->reported = calloc(map->modules[map->self].point_count + 1, sizeof(*map->reported));
	map->smoothed = calloc(map->modules[map->self].point_count + 1, sizeof(*map->smoothed));
	map->commanded_count = map->modules[map->self].command_count;
	map->commanded = calloc(map->commanded_count + 1, sizeof(*map->commanded));
	if (!map->reported || !map->smoothed || !map->commanded)
		return map_fail(error, "out of memory");
	await_turn(map);
	begin_generation(map);
	return 0;
}

int map_attach(struct map **out, const char *dir, const char *module, char *error)
{
	struct map *map = calloc(1, sizeof(*map));

	if (!map)
		return map_fail(error, "out of memory");
	map->self = MAP_NONE;
	for (unsigned i = 0; i < MAP_MODULES_MAX; i++)
		map->segments[i].bell = -1;
	map->directory_fd = open(dir, O_PATH | O_DIRECTORY | O_CLOEXEC);
	if (map->directory_fd < 0)
		map_fail(error, "no map in %s: %s (does rtud run?)", dir, strerror(errno));
	else if (attach_all(map, module, error) == 0) {
		*out = map;
		return 0;
	}
	map_detach(map);
	return -1;
}

/* ---- a configuration that may follow --------------------------------------------------------- */

int map_attach_again(struct map **out, const struct map *map, uint32_t later, char *error)
{
	struct map *next = calloc(1, sizeof(*next));

	if (!next)
		return map_fail(error, "out of memory");
	next->self = MAP_NONE;
	for (unsigned i = 0; i < MAP_MODULES_MAX; i++)
		next->segments[i].bell = -1;
	next->directory_fd = fcntl(map->directory_fd, F_DUPFD_CLOEXEC, 0);
	if (attach_directory(next, false, error) == 0 &&
	    open_config(next, map->file->epoch + later, false, error) == 0 &&
	    attach_segments(next, error) == 0) {
		*out = next;
		return 0;
	}
	map_detach(next);
	return -1;
}

/* ---- a changed configuration --------------------------------------------------------------- */

bool map_is_changed(const struct map *map)
{
	return atomic_load_explicit(&map->directory->epoch, memory_order_acquire) != map->file->epoch;
}

void map_forget(struct map *map)
{
	if (map->before)
		munmap((void *)(uintptr_t)map->before, map->before->size);
	map->before = NULL;
}

static bool is_kept(const struct map *former, const struct map *map, uint32_t module)
{
	return module < map_module_count(former) && former->modules[module].made == map->modules[module].made;
}

/* A module that was gone has given its number away. */
static bool is_another(const struct map *former, const struct map *map, uint32_t module)
{
	return module < map_module_count(former) &&
	       strcmp(former->modules[module].plan.name, map->modules[module].plan.name) != 0;
}

/* Lets go of what the one has and the other has not. */
static void drop_segments(struct map *map, const struct map *other)
{
	for (uint32_t i = 0; i < map_module_count(map); i++) {
		struct segment *segment = &map->segments[i];

		if (segment->header && segment->header != other->segments[i].header)
			munmap(segment->header, segment->size);
		if (segment->bell >= 0 && segment->bell != other->segments[i].bell)
			close(segment->bell);
	}
}

static int renew_segments(struct map *fresh, const struct map *former, char *error)
{
	for (uint32_t i = 0; i < map_module_count(fresh); i++) {
		const int bell = is_another(former, fresh, i) ? -1 : fresh->segments[i].bell;

		if (is_kept(former, fresh, i))
			continue;
		fresh->segments[i] = (struct segment){.bell = bell};
		if (attach_segment(fresh, i, &fresh->segments[i], error) < 0)
			return -1;
	}
	return fresh->self == MAP_NONE ? 0 : attach_bells(fresh, error);
}

int map_renew(struct map *map, struct map_config *before, char *error)
{
	struct map fresh = *map;

	map_forget(map);
	fresh.before = NULL;
	if (open_newest_config(&fresh, 0, map->self == MAP_RTUD, error) < 0)
		return -1;
	if (renew_segments(&fresh, map, error) < 0) {
		drop_segments(&fresh, map);
		munmap((void *)(uintptr_t)fresh.file, fresh.file->size);
		return -1;
	}
	drop_segments(map, &fresh);
	*before = map->config;
	fresh.before = map->file;
	*map = fresh;
	return 0;
}

/* ---- who requests, in a configuration that the caller does not take ------------------------- */

/* Of a module that owns points here, what this configuration says of them is true of the segment that it had. */
static int follow_module(struct map *map, const struct map *newest, uint32_t module, char *error)
{
	const struct module_entry *entry = &newest->modules[module];
	const bool known = module < map->module_count, another = is_another(map, newest, module);
	struct segment segment = {.bell = known && !another ? map->segments[module].bell : -1};

	if (known && map->modules[module].made == entry->made) {
		map->modules[module].plan.flags |= entry->plan.flags & MAP_IS_GONE;
		return 0;
	}
	if (known && !another && map->modules[module].point_count != 0)
		return 0;
	if (attach_segment(newest, module, &segment, error) < 0)
		return -1;
	if (known)
		munmap(map->segments[module].header, map->segments[module].size);
	if (another)
		close(map->segments[module].bell);
	map->segments[module] = segment;
	map->modules[module] = *entry;
	map->modules[module].point_count = 0; /* they have no numbers here */
	map->modules[module].plan.listed_count = 0;
	if (!known)
		map->module_count++;
	return 0;
}

static int follow_modules(struct map *map, char *error)
{
	struct map newest = {
	    .directory_fd = map->directory_fd, .directory = map->directory, .self = map->self};
	int result = 0;

	if (open_newest_config(&newest, 0, false, error) < 0)
		return -1;
	map->followed = newest.followed;
	for (uint32_t i = 0; result == 0 && i < newest.module_count; i++)
		result = follow_module(map, &newest, i, error);
	munmap((void *)(uintptr_t)newest.file, newest.file->size);
	return result < 0 ? -1 : attach_bells(map, error);
}

void requesters_follow(struct map *map)
{
	const uint32_t epoch = atomic_load_explicit(&map->directory->epoch, memory_order_acquire);
	char error[MAP_ERROR_SIZE];

	if (epoch == map->followed || !(map->modules[map->self].plan.flags & MAP_MAY_OWN))
		return;
	map->followed = epoch;
	if (follow_modules(map, error) < 0)
		map_log(map, MAP_LOG_ERROR, "hears no commands of new modules until it starts again: %s",
			error);
	bell_ring(map, map->self); /* they may have asked already */
}

uint32_t map_number_now(const struct map *map, const struct map_config *before, uint32_t point)
{
	const struct map_point *object = &before->points[point];
	uint32_t now = map_find(map, before->sets[object->set].ca, object->ioa);

	return now != MAP_NONE && map->config.points[now].type == object->type ? now : MAP_NONE;
}

void map_detach(struct map *map)
{
	for (unsigned i = 0; i < MAP_MODULES_MAX; i++) {
		if (map->segments[i].header)
			munmap(map->segments[i].header, map->segments[i].size);
		if (map->segments[i].bell >= 0)
			close(map->segments[i].bell);
	}
	map_forget(map);
	if (map->file)
		munmap((void *)(uintptr_t)map->file, map->file->size);
	if (map->directory_fd >= 0)
		close(map->directory_fd);
	free(map->reported);
	free(map->smoothed);
	free(map->commanded);
	free(map);
}
