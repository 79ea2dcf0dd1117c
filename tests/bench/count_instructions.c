/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * A plugin of QEMU: how many instructions a program has had carried out so far, as eight octets in the file that
 * -plugin …,count=FILE names, for whoever looks while it runs.
 */
#include <inttypes.h>

#include <qemu-plugin.h>

#include "plugin_file.h"

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
	(void)info;
	count = plugin_file(argc, argv, sizeof(*count));
	if (count == NULL)
		return 1;
	qemu_plugin_register_vcpu_tb_trans_cb(id, add);
	return 0;
}
