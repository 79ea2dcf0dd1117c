/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Making the files of the map: the configuration, the segments, the bells. */
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "map/layout.h"
#include "map/supervise.h"
#include "map/time_ns.h"

#define LOCK_MS    500
#define LOCK_TRIES 50

/* ---- modules and their points ------------------------------------------------------------ */

/* The kernel keeps modules apart by their users. 0 is of those that rtud starts no process for. */
static int check_users(const struct map_config *config, char *error)
{
	for (uint32_t i = 0; i < config->module_count; i++)
		for (uint32_t j = i + 1; j < config->module_count; j++)
			if (config->modules[i].user != 0 &&
			    config->modules[i].user == config->modules[j].user &&
			    !((config->modules[i].flags | config->modules[j].flags) & MAP_IS_GONE))
				return map_fail(error,
						"%s and %s would run as one user, number %u of the modules'",
						config->modules[i].name, config->modules[j].name,
						config->modules[i].user);
	return 0;
}

static int take_modules(struct config_header *header, const struct map_config *config, const uint32_t *made,
			char *error)
{
	if (config->module_count == 0 || config->module_count > MAP_MODULES_MAX ||
	    !(config->modules[MAP_RTUD].flags & MAP_IS_SUPERVISOR))
		return map_fail(error, "a map holds at most %d modules, with rtud as the first",
				MAP_MODULES_MAX);
	if (check_users(config, error) < 0)
		return -1;
	header->module_count = config->module_count;
	for (uint32_t i = 0; i < config->module_count; i++) {
		header->modules[i].plan = config->modules[i];
		header->modules[i].made = made[i];
	}
	for (uint32_t i = 0; i < config->set_count; i++)
		if (config->sets[i].module >= config->module_count ||
		    !(config->modules[config->sets[i].module].flags & MAP_MAY_OWN))
			return map_fail(error, "the set of points %s belongs to no module that may own it",
					config->sets[i].name);
	return 0;
}

static uint32_t all_sets(const struct map_config *config)
{
	return config->set_count + config->gone_set_count;
}

static uint32_t all_points(const struct map_config *config)
{
	return config->point_count + config->gone_point_count;
}

static void assign_slots(struct config_header *header, const struct map_config *config)
{
	uint32_t owned = 0;

	for (uint32_t i = 0; i < all_sets(config); i++)
		config->sets[i].latch = header->modules[config->sets[i].module].set_count++;
	for (uint32_t i = 0; i < all_points(config); i++) {
		struct map_point *point = &config->points[i];
		struct module_entry *owner = &header->modules[config->sets[point->set].module];

		point->slot = owner->point_count++;
		owner->live_count += i < config->point_count;
		point->command = (point->flags & MAP_POINT_COMMAND) ? owner->command_count++ : MAP_NONE;
		if (point->type == MAP_COUNTER)
			point->extra = owner->total_count++;
		else if (is_measured(point))
			point->extra = owner->parameter_count++;
		else if (point->flags & MAP_POINT_TEXT)
			point->extra = owner->text_count++;
	}
	for (uint32_t i = 0; i < header->module_count; i++) {
		header->modules[i].first_owned = owned;
		owned += header->modules[i].point_count;
	}
}

struct address_key {
	uint64_t key; /* CA, IOA */
	uint32_t point;
};

static uint64_t address_key(const struct map_config *config, uint32_t point)
{
	return (uint64_t)config->sets[config->points[point].set].ca << 32 | config->points[point].ioa;
}

static int compare_keys(const void *left, const void *right)
{
	const struct address_key *a = left, *b = right;

	return (a->key > b->key) - (a->key < b->key);
}

static int index_addresses(const struct map_config *config, uint32_t *by_address)
{
	struct address_key *keys = calloc(config->point_count + 1, sizeof(*keys));

	if (!keys)
		return -1;
	for (uint32_t i = 0; i < config->point_count; i++)
		keys[i] = (struct address_key){address_key(config, i), i};
	qsort(keys, config->point_count, sizeof(*keys), compare_keys);
	for (uint32_t i = 0; i < config->point_count; i++)
		by_address[i] = keys[i].point;
	free(keys);
	return 0;
}

/* ---- files ------------------------------------------------------------------------------- */

/* A new file of that size, all zero and really there, so that a full tmpfs shows now and not as SIGBUS. */
static void *create_file(int directory_fd, const char *name, size_t size, uint32_t group, char *error)
{
	const mode_t mode = group ? 0640 : 0600;
	void *memory = MAP_FAILED;
	int fd;

	unlinkat(directory_fd, name, 0);
	fd = openat(directory_fd, name, O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, mode);
	if (fd < 0) {
		map_fail(error, "cannot create the map's segment %s: %s", name, strerror(errno));
		return NULL;
	}
	if (fchmod(fd, mode) < 0 || (group && fchown(fd, (uid_t)-1, group) < 0) ||
	    (errno = posix_fallocate(fd, 0, (off_t)size)) != 0 ||
	    (memory = mmap(NULL, size, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0)) == MAP_FAILED)
		map_fail(error, "cannot give the map's segment %s %zu bytes: %s", name, size,
			 strerror(errno));
	close(fd);
	return memory == MAP_FAILED ? NULL : memory;
}

static int create_bell(int directory_fd, const char *module, uint32_t group, char *error)
{
	char name[FILE_NAME_SIZE];

	bell_file(name, module);
	unlinkat(directory_fd, name, 0);
	if (mkfifoat(directory_fd, name, 0660) < 0 || fchmodat(directory_fd, name, 0660, 0) < 0 ||
	    (group && fchownat(directory_fd, name, (uid_t)-1, group, AT_SYMLINK_NOFOLLOW) < 0))
		return map_fail(error, "cannot create the bell %s: %s", name, strerror(errno));
	return 0;
}

static int create_segment(int directory_fd, const struct module_entry *entry, uint32_t group, char *error)
{
	const struct layout layout = layout_of(entry);
	struct segment_header *header;
	char name[FILE_NAME_SIZE];

	segment_file(name, entry->plan.name, entry->made);
	header = create_file(directory_fd, name, layout.size, group, error);
	if (!header)
		return -1;
	header->layout = MAP_LAYOUT;
	header->fingerprint = layout_fingerprint();
	header->size = (uint32_t)layout.size;
	header->next_request = 1;
	header->made = entry->made;
	if (entry->plan.flags & MAP_IS_SUPERVISOR)
		((struct directory *)(void *)((uint8_t *)header + layout.directory))->starts = 1;
	atomic_thread_fence(memory_order_release);
	header->magic = MAP_MAGIC;
	munmap(header, layout.size);
	return 0;
}

/* An empty table may be no table at all. */
static void copy_table(uint8_t *to, const void *table, size_t size)
{
	if (size)
		memcpy(to, table, size);
}

static void list_owned(const struct config_header *header, const struct map_config *config, uint32_t *owned)
{
	for (uint32_t i = 0; i < all_points(config); i++) {
		const struct map_point *point = &config->points[i];

		owned[header->modules[config->sets[point->set].module].first_owned + point->slot] = i;
	}
}

static int fill_config(uint8_t *memory, const struct config_layout *layout,
		       const struct config_header *header, const struct map_config *config)
{
	memcpy(memory, header, sizeof(*header));
	copy_table(memory + layout->sets, config->sets, all_sets(config) * sizeof(*config->sets));
	copy_table(memory + layout->points, config->points, all_points(config) * sizeof(*config->points));
	copy_table(memory + layout->names, config->names, config->names_size);
	for (uint32_t i = 0; i < config->section_count; i++)
		copy_table(memory + layout->sections[i], config->sections[i].records,
			   (size_t)config->sections[i].count * config->sections[i].record_size);
	list_owned(header, config, (uint32_t *)(void *)(memory + layout->owned));
	return index_addresses(config, (uint32_t *)(void *)(memory + layout->by_address));
}

static void count_tables(struct config_header *header, const struct map_config *config)
{
	header->settings = config->settings;
	header->set_count = config->set_count;
	header->point_count = config->point_count;
	header->gone_set_count = config->gone_set_count;
	header->gone_point_count = config->gone_point_count;
	header->names_size = config->names_size;
	header->section_count = config->section_count;
	for (uint32_t i = 0; i < config->section_count; i++)
		header->sections[i] = (struct section_entry){
		    config->sections[i].id, config->sections[i].record_size, config->sections[i].count};
}

static int create_config(int directory_fd, struct config_header *header, const struct map_config *config,
			 uint32_t group, char *error)
{
	const struct config_layout layout = config_layout_of(config);
	char name[FILE_NAME_SIZE];
	uint8_t *memory;
	int result;

	config_file(name, header->epoch);
	memory = create_file(directory_fd, name, layout.size, group, error);
	if (!memory)
		return -1;
	header->layout = MAP_LAYOUT;
	header->fingerprint = layout_fingerprint();
	header->size = (uint32_t)layout.size;
	count_tables(header, config);
	result = fill_config(memory, &layout, header, config);
	if (result < 0)
		map_fail(error, "out of memory for %u points", config->point_count);
	atomic_thread_fence(memory_order_release);
	((struct config_header *)(void *)memory)->magic = CONFIG_MAGIC;
	munmap(memory, layout.size);
	return result;
}

/* Bells have no epoch: whoever rings one does not ask which process hears it. */
static bool has_bell(int directory_fd, const char *module)
{
	struct stat status;
	char name[FILE_NAME_SIZE];

	bell_file(name, module);
	return fstatat(directory_fd, name, &status, AT_SYMLINK_NOFOLLOW) == 0 && S_ISFIFO(status.st_mode);
}

int config_create(int directory_fd, const struct map_config *config, uint32_t epoch, const uint32_t *made,
		  uint32_t group, char *error)
{
	struct config_header header = {.epoch = epoch};

	if (take_modules(&header, config, made, error) < 0)
		return -1;
	assign_slots(&header, config);
	for (uint32_t i = 0; i < header.module_count; i++) {
		const struct module_entry *entry = &header.modules[i];

		if (entry->made != epoch)
			continue;
		if ((epoch == 0 || !has_bell(directory_fd, entry->plan.name)) &&
		    create_bell(directory_fd, entry->plan.name, group, error) < 0)
			return -1;
		if (create_segment(directory_fd, entry, group, error) < 0)
			return -1;
	}
	return create_config(directory_fd, &header, config, group, error);
}

/* ---- the map ----------------------------------------------------------------------------- */

/* The child of an rtud that was killed, which reads a configuration or becomes a module, ends a moment later and holds it until then. */
static bool lock(int fd)
{
	static const struct timespec moment = {.tv_nsec = LOCK_MS / LOCK_TRIES * NS_PER_MS};

	for (unsigned tries = 1; flock(fd, LOCK_EX | LOCK_NB) < 0; tries++) {
		if (tries > LOCK_TRIES)
			return false;
		nanosleep(&moment, NULL);
	}
	return true;
}

/*
 * A folder that somebody else may write to, made before us in a place like /tmp, would let him exchange the
 * segments.
 */
static int take_directory(int fd, const char *dir, char *error)
{
	struct stat status;

	if (fstat(fd, &status) < 0 || status.st_uid != geteuid() || (status.st_mode & (S_IWGRP | S_IWOTH)))
		return map_fail(error,
				"another user owns the map's folder %s or may write to it: remove it or use "
				"another --map",
				dir);
	if (!lock(fd))
		return map_fail(error, "another rtud runs on the map in %s: stop it or use another --map",
				dir);
	return 0;
}

/* Others may pass through the folder, whatever the umask, and not open it: so nobody but this user can hold its lock. */
static int open_directory(const char *dir, char *error)
{
	bool made = mkdir(dir, 0711) == 0;
	int fd;

	if (!made && errno != EEXIST)
		return map_fail(error, "cannot create the map's folder %s: %s", dir, strerror(errno));
	fd = open(dir, O_RDONLY | O_DIRECTORY | O_CLOEXEC | O_NOFOLLOW);
	if (fd < 0)
		return map_fail(error, "cannot open the map's folder %s: %s", dir, strerror(errno));
	if (take_directory(fd, dir, error) == 0 && (!made || fchmod(fd, 0711) == 0))
		return fd;
	close(fd);
	return -1;
}

int map_check(const struct map_config *config, size_t *size, char *error)
{
	const uint32_t made[MAP_MODULES_MAX] = {0};
	struct config_header header = {.epoch = 0};

	if (take_modules(&header, config, made, error) < 0)
		return -1;
	assign_slots(&header, config);
	*size = config_layout_of(config).size;
	for (uint32_t i = 0; i < header.module_count; i++)
		*size += layout_of(&header.modules[i]).size;
	if (*size > UINT32_MAX)
		return map_fail(error, "the map would have %zu MiB", *size >> 20);
	return 0;
}

void settings_put(const struct map *map, const struct map_settings *settings)
{
	atomic_store(&map->directory->select_timeout_s, settings->select_timeout_s);
	atomic_store(&map->directory->command_timeout_s, settings->command_timeout_s);
}

int map_create(struct map **map, const char *dir, const struct map_config *config, uint32_t group,
	       char *error)
{
	const uint32_t made[MAP_MODULES_MAX] = {0};
	int fd = open_directory(dir, error);
	struct module_status *rtud;

	if (fd < 0)
		return -1;
	map_sweep(fd, NULL); /* what an rtud left that was killed */
	if (config_create(fd, config, 0, made, group, error) < 0 || map_attach(map, dir, "rtud", error) < 0) {
		close(fd);
		return -1;
	}
	close((*map)->directory_fd);
	(*map)->directory_fd = fd;
	settings_put(*map, &config->settings);
	rtud = &(*map)->directory->modules[MAP_RTUD];
	atomic_store(&rtud->state, MAP_MODULE_RUNNING);
	atomic_store(&rtud->pid, (uint32_t)getpid());
	atomic_store(&rtud->started_s, now_s());
	return 0;
}

size_t map_size(const struct map *map)
{
	size_t size = map->file->size;

	for (uint32_t i = 0; i < map_module_count(map); i++)
		size += map->segments[i].size;
	return size;
}

int map_segment_open(const struct map *map, uint32_t module)
{
	char name[FILE_NAME_SIZE];

	segment_file(name, map->modules[module].plan.name, map->modules[module].made);
	return openat(map->directory_fd, name, O_RDWR | O_CLOEXEC | O_NOFOLLOW);
}

static bool ends_with(const char *name, const char *end)
{
	const size_t length = strlen(name), ending = strlen(end);

	return length > ending && strcmp(name + length - ending, end) == 0;
}

static bool is_of_the_map(const char *name)
{
	return ends_with(name, ".seg") || ends_with(name, ".bell") || ends_with(name, ".config") ||
	       strcmp(name, MAP_REPORT) == 0 || strncmp(name, MAP_SETUP_FILES, strlen(MAP_SETUP_FILES)) == 0;
}

void map_sweep(int directory_fd, const char *mark)
{
	const int fd = openat(directory_fd, ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
	DIR *directory = fd < 0 ? NULL : fdopendir(fd);
	const struct dirent *entry;

	while (directory != NULL && (entry = readdir(directory)) != NULL)
		if (is_of_the_map(entry->d_name) && (mark == NULL || strstr(entry->d_name, mark) != NULL))
			unlinkat(directory_fd, entry->d_name, 0);
	if (directory != NULL)
		closedir(directory);
}

void map_remove(struct map *map)
{
	map_sweep(map->directory_fd, NULL);
}
