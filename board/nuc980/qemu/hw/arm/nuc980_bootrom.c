/*
 * Nuvoton NUC980 boot ROM: starting from NAND
 *
 * What the ROM does is known from what the vendor's NuWriter writes for it:
 * the same image in each of the blocks 0 to 3 that is good, at its start a
 * header (addMagicHeader() in parse.c), then values for the DDR controller
 * (DDR2Buf() in xusb.cpp), then the code. The model's RAM needs no values.
 *
 * The straps ask for pages of 2 KiB with BCH T8, which is what the board has.
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#include "qemu/osdep.h"
#include "exec/address-spaces.h"
#include "hw/arm/nuc980_bootrom.h"
#include "hw/block/nuc980_bch.h"
#include "qemu/error-report.h"
#include "sysemu/reset.h"
#include "trace.h"

#define PAGE_SIZE           2048
#define SPARE_SIZE          64
#define PAGES_A_BLOCK       64
#define BLOCK_SIZE          (PAGES_A_BLOCK * PAGE_SIZE)
#define BLOCKS_TRIED        4

#define FIELD_SIZE          512
#define FIELDS              (PAGE_SIZE / FIELD_SIZE)
#define PROTECTED_SIZE      544         /* a field, padding and parity */
#define PARITY_SIZE         15

#define BOOT_MARKER         0x4e565420  /* " TVN" */
#define DDR_MARKER          0xaa55aa55
#define HEADER_SIZE         32

typedef struct BootROM {
    ARMCPU *cpu;
    BlockBackend *nand;
} BootROM;

static bool correct_field(uint8_t *data, const uint8_t *spare, int field)
{
    const NUC980BCH *code = nuc980_bch(8);
    const uint8_t *parity = spare + SPARE_SIZE - (FIELDS - field) * PARITY_SIZE;
    uint8_t message[PROTECTED_SIZE - PARITY_SIZE] = {};
    unsigned where[NUC980_BCH_MAX_T];
    int errors;

    memcpy(message, data, FIELD_SIZE);
    if (field == 0) {
        memcpy(message + FIELD_SIZE, spare, 3);
    }
    errors = nuc980_bch_decode(code, message, sizeof(message), parity, where);
    for (int i = 0; i < errors; i++) {
        if (where[i] < 8 * FIELD_SIZE) {
            data[where[i] / 8] ^= 0x80 >> (where[i] % 8);
        }
    }
    return errors >= 0;
}

static bool read_page(BlockBackend *nand, int64_t page, uint8_t *data)
{
    uint8_t content[PAGE_SIZE + SPARE_SIZE];

    if (blk_pread(nand, page * sizeof(content), sizeof(content), content,
                  0) < 0) {
        return false;
    }
    for (int field = 0; field < FIELDS; field++) {
        if (!correct_field(content + field * FIELD_SIZE, content + PAGE_SIZE,
                           field)) {
            return false;
        }
    }
    memcpy(data, content, PAGE_SIZE);
    return true;
}

/* Where the code begins, behind the list of values: {marker, n, n pairs} */
static uint64_t skip_ddr_values(const uint8_t *block)
{
    uint32_t pairs = ldl_le_p(block + HEADER_SIZE + 4);

    if (ldl_le_p(block + HEADER_SIZE) != DDR_MARKER) {
        return HEADER_SIZE;
    }
    if (pairs > (PAGE_SIZE - HEADER_SIZE - 8) / 8) {
        return BLOCK_SIZE;
    }
    for (uint32_t i = 0; i < pairs; i++) {
        const uint8_t *pair = block + HEADER_SIZE + 8 + 8 * i;

        trace_nuc980_bootrom_ddr(ldl_le_p(pair), ldl_le_p(pair + 4));
    }
    return HEADER_SIZE + ROUND_UP(8 + 8 * (uint64_t)pairs, 16);
}

/* Loads the code that one block has; returns whether it has any. */
static bool load_block(BlockBackend *nand, int64_t number, uint32_t *entry)
{
    g_autofree uint8_t *block = g_malloc(BLOCK_SIZE);
    uint64_t code, end;

    if (!read_page(nand, number * PAGES_A_BLOCK, block) ||
        ldl_le_p(block) != BOOT_MARKER) {
        return false;
    }
    *entry = ldl_le_p(block + 4);
    code = skip_ddr_values(block);
    end = code + ldl_le_p(block + 8);
    if (end > BLOCK_SIZE) {
        return false;
    }
    for (int page = 1; page * PAGE_SIZE < end; page++) {
        if (!read_page(nand, number * PAGES_A_BLOCK + page,
                       block + page * PAGE_SIZE)) {
            return false;
        }
    }
    trace_nuc980_bootrom_load(number, *entry, end - code);
    return address_space_write(&address_space_memory, *entry,
                               MEMTXATTRS_UNSPECIFIED, block + code,
                               end - code) == MEMTX_OK;
}

static void bootrom_start(void *opaque)
{
    BootROM *rom = opaque;
    uint32_t entry;

    cpu_reset(CPU(rom->cpu));
    for (int block = 0; block < BLOCKS_TRIED; block++) {
        if (load_block(rom->nand, block, &entry)) {
            cpu_set_pc(CPU(rom->cpu), entry);
            return;
        }
    }
    /* The chip would now wait for a PC on its USB. */
    warn_report("the NAND's blocks 0 to %d have no code to boot (\" TVN\", "
                "with BCH T8): the CPU halts", BLOCKS_TRIED - 1);
    CPU(rom->cpu)->halted = 1;
    CPU(rom->cpu)->exception_index = EXCP_HLT;
}

void nuc980_boot_from_nand(ARMCPU *cpu, BlockBackend *nand)
{
    BootROM *rom = g_new(BootROM, 1);

    *rom = (BootROM) { cpu, nand };
    qemu_register_reset(bootrom_start, rom);
}
