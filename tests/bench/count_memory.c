/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * A plugin of QEMU: what a program of the board costs its core, as three numbers of eight octets in the file that
 * -plugin …,count=FILE names (counts.h): instructions, system calls, octets between the cache for data and memory.
 *
 * The cache is an ARM926EJ-S' as the NUC980 has it: 16 KiB, 4 ways, lines of 32 octets, written back, filled by loads alone. A
 * process that has slept finds it empty: this core flushes it whenever another address space comes.
 */
#include <inttypes.h>
#include <stdbool.h>

#include <qemu-plugin.h>

#include "counts.h"
#include "plugin_file.h"

enum { LINE = 32, WAYS = 4, SETS = 16384 / WAYS / LINE };
/* Of the calls of ARM EABI. */
enum { CLOCK_NANOSLEEP = 265, PPOLL = 336, CLOCK_NANOSLEEP_TIME64 = 407, PPOLL_TIME64 = 414 };

QEMU_PLUGIN_EXPORT int qemu_plugin_version = QEMU_PLUGIN_VERSION;

static struct counts *counts;
static struct line {
	uint64_t number; /* and one more; 0: it is empty */
	bool dirty;
} cache[SETS][WAYS];
static unsigned victim[SETS];

static struct line *find(uint64_t number)
{
	for (unsigned way = 0; way < WAYS; way++)
		if (cache[number % SETS][way].number == number + 1)
			return &cache[number % SETS][way];
	return NULL;
}

static void write_back(struct line *line)
{
	counts->octets += line->dirty ? LINE : 0;
	*line = (struct line){.number = 0};
}

static void fill(uint64_t number)
{
	const uint64_t set = number % SETS;
	struct line *line = &cache[set][victim[set]++ % WAYS];

	write_back(line);
	line->number = number + 1;
	counts->octets += LINE;
}

/* No access of this core crosses a line, unaligned ones aside, which there are not. */
static void touch(unsigned cpu, qemu_plugin_meminfo_t info, uint64_t address, void *data)
{
	struct line *line = find(address / LINE);

	(void)cpu, (void)data;
	if (!qemu_plugin_mem_is_store(info)) {
		if (line == NULL)
			fill(address / LINE);
	} else if (line != NULL) {
		line->dirty = true;
	} else {
		counts->octets += UINT64_C(1) << qemu_plugin_mem_size_shift(info);
	}
}

static void call(qemu_plugin_id_t id, unsigned cpu, int64_t number, uint64_t a, uint64_t b, uint64_t c,
		 uint64_t d, uint64_t e, uint64_t f, uint64_t g, uint64_t h)
{
	(void)id, (void)cpu, (void)a, (void)b, (void)c, (void)d, (void)e, (void)f, (void)g, (void)h;
	counts->calls++;
	if (number != CLOCK_NANOSLEEP && number != PPOLL && number != CLOCK_NANOSLEEP_TIME64 &&
	    number != PPOLL_TIME64)
		return;
	for (unsigned i = 0; i < SETS * WAYS; i++)
		write_back(&cache[i / WAYS][i % WAYS]);
}

static void translate(qemu_plugin_id_t id, struct qemu_plugin_tb *block)
{
	const size_t count = qemu_plugin_tb_n_insns(block);

	(void)id;
	qemu_plugin_register_vcpu_tb_exec_inline(block, QEMU_PLUGIN_INLINE_ADD_U64, &counts->instructions,
						 count);
	for (size_t i = 0; i < count; i++)
		qemu_plugin_register_vcpu_mem_cb(qemu_plugin_tb_get_insn(block, i), touch,
						 QEMU_PLUGIN_CB_NO_REGS, QEMU_PLUGIN_MEM_RW, NULL);
}

QEMU_PLUGIN_EXPORT int qemu_plugin_install(qemu_plugin_id_t id, const qemu_info_t *info, int argc,
					   char **argv)
{
	(void)info;
	counts = plugin_file(argc, argv, sizeof(*counts));
	if (counts == NULL)
		return 1;
	qemu_plugin_register_vcpu_tb_trans_cb(id, translate);
	qemu_plugin_register_vcpu_syscall_cb(id, call);
	return 0;
}
