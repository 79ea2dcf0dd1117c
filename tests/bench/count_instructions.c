/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * A plugin of QEMU: how many instructions a program has had carried out so far, as eight octets in the file that
 * -plugin …,count=FILE names, for whoever looks while it runs.
 */
#include <fcntl.h>
#include <inttypes.h>
#include <stddef.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include <qemu-plugin.h>

#define KEY "count="

QEMU_PLUGIN_EXPORT int qemu_plugin_version = QEMU_PLUGIN_VERSION;

static uint64_t *count;

static void add(qemu_plugin_id_t id, struct qemu_plugin_tb *block)
{
	(void)id;
	qemu_plugin_register_vcpu_tb_exec_inline(block, QEMU_PLUGIN_INLINE_ADD_U64, count,
						 qemu_plugin_tb_n_insns(block));
}

QEMU_PLUGIN_EXPORT int qemu_plugin_install(qemu_plugin_id_t id, const qemu_info_t *info, int argc,
					   char **argv)
{
	int fd;

	(void)info;
	if (argc != 1 || strncmp(argv[0], KEY, strlen(KEY)) != 0)
		return 1;
	fd = open(argv[0] + strlen(KEY), O_RDWR);
	if (fd < 0 || ftruncate(fd, sizeof(*count)) < 0)
		return 1;
	count = mmap(NULL, sizeof(*count), PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
	close(fd);
	if (count == MAP_FAILED)
		return 1;
	qemu_plugin_register_vcpu_tb_trans_cb(id, add);
	return 0;
}
