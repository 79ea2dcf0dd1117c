/*
 * Nuvoton NUC980 flash memory interface: raw NAND
 *
 * The registers are those of the vendor's NUC980 BSP (nuc980.h) and, for the
 * bits, of its header for the sister interface of the MA35D1 (nfi_reg.h).
 * A transfer takes no time; what the flash does with its array does.
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#include "qemu/osdep.h"
#include "exec/address-spaces.h"
#include "hw/block/flash.h"
#include "hw/block/nuc980_bch.h"
#include "hw/block/nuc980_fmi.h"
#include "hw/irq.h"
#include "hw/misc/nuc980_unimp.h"
#include "hw/qdev-properties.h"
#include "hw/registerfields.h"
#include "migration/vmstate.h"
#include "qemu/log.h"
#include "sysemu/dma.h"
#include "trace.h"

REG32(DMACTL, 0x400)
    FIELD(DMACTL, DMACEN, 0, 1)
    FIELD(DMACTL, DMARST, 1, 1)
    FIELD(DMACTL, SGEN, 3, 1)
    FIELD(DMACTL, DMABUSY, 9, 1)
REG32(DMASA, 0x408)
REG32(DMABCNT, 0x40c)
REG32(DMAINTEN, 0x410)
REG32(DMAINTSTS, 0x414)
    FIELD(DMAINTSTS, ABORTIF, 0, 1)
REG32(GCTL, 0x800)
    FIELD(GCTL, GCTLRST, 0, 1)
    FIELD(GCTL, EMMCEN, 1, 1)
    FIELD(GCTL, NANDEN, 3, 1)
REG32(GINTEN, 0x804)
REG32(GINTSTS, 0x808)
    FIELD(GINTSTS, DTAIF, 0, 1)
REG32(NANDCTL, 0x8a0)
    FIELD(NANDCTL, SWRST, 0, 1)
    FIELD(NANDCTL, DRDEN, 1, 1)
    FIELD(NANDCTL, DWREN, 2, 1)
    FIELD(NANDCTL, REDUNREN, 3, 1)
    FIELD(NANDCTL, REDUNAUTOWEN, 4, 1)
    FIELD(NANDCTL, PROTREGIONEN, 5, 1)
    FIELD(NANDCTL, ECCCHK, 7, 1)
    FIELD(NANDCTL, PROT3BEN, 8, 1)
    FIELD(NANDCTL, SRAMINT, 9, 1)
    FIELD(NANDCTL, PSIZE, 16, 2)
    FIELD(NANDCTL, BCHTSEL, 18, 5)
    FIELD(NANDCTL, ECCEN, 23, 1)
    FIELD(NANDCTL, CS0, 25, 1)
    FIELD(NANDCTL, CS1, 26, 1)
REG32(NANDTMCTL, 0x8a4)
REG32(NANDINTEN, 0x8a8)
REG32(NANDINTSTS, 0x8ac)
    FIELD(NANDINTSTS, DMAIF, 0, 1)
    FIELD(NANDINTSTS, ECCFLDIF, 2, 1)
    FIELD(NANDINTSTS, RB0IF, 10, 1)
    FIELD(NANDINTSTS, RB0STATUS, 18, 1)
REG32(NANDCMD, 0x8b0)
REG32(NANDADDR, 0x8b4)
REG32(NANDDATA, 0x8b8)
REG32(NANDRACTL, 0x8bc)
    FIELD(NANDRACTL, RA128EN, 0, 9)
    FIELD(NANDRACTL, MECC, 16, 16)
REG32(NANDECTL, 0x8c0)
    FIELD(NANDECTL, WP, 0, 1)
REG32(NANDECCES0, 0x8d0)
REG32(NANDECCEA0, 0x900)
REG32(NANDECCED0, 0x960)

#define SPARE_OFFSET        0xa00

#define STATUS_REGS         4           /* NANDECCES: four fields each */
#define ERROR_ADDRESS_REGS  12          /* NANDECCEA: two errors each */
#define ERROR_DATA_REGS     6           /* NANDECCED: four errors each */

enum {
    FIELD_CORRECTABLE = 1,              /* the errors' number is in bits 6:2 */
    FIELD_UNCORRECTABLE = 2,
};

enum {
    CMD_READ_START = 0x30,
    CMD_PROGRAM = 0x10,
    CMD_CACHE_PROGRAM = 0x15,
    CMD_STATUS = 0x70,
    CMD_ERASE = 0xd0,
    CMD_RESET = 0xff,
};

/* guess: typical of a 1 Gbit flash, after the data sheet of W29N01HV */
#define READ_NS             (25 * SCALE_US)
#define PROGRAM_NS          (200 * SCALE_US)
#define ERASE_NS            (2 * SCALE_MS)

#define NAND_STATUS_READY   0x40

#define MAX_FIELD_SIZE      1024
#define MAX_PADDING         64

/* How a page is protected: in fields that each have a parity of their own */
typedef struct Layout {
    const NUC980BCH *code;              /* NULL: not at all, one field */
    unsigned fields;
    unsigned size;                      /* bytes a field */
    unsigned padding;                  /* bytes from data to parity's end */
    unsigned parity;                    /* bytes a field */
    unsigned parity_at;                 /* the first field's, in the spare */
} Layout;

#define SET_FIELD(s, reg, field, value) \
    ((s)->regs[R_##reg] = FIELD_DP32((s)->regs[R_##reg], reg, field, value))
#define GET_FIELD(s, reg, field) FIELD_EX32((s)->regs[R_##reg], reg, field)

static void fmi_update_irq(NUC980FMIState *s)
{
    /* Each flag is at the place of its enable bit. */
    qemu_set_irq(s->irq,
                 (s->regs[R_NANDINTSTS] & s->regs[R_NANDINTEN]) ||
                 (s->regs[R_DMAINTSTS] & s->regs[R_DMAINTEN]) ||
                 (s->regs[R_GINTSTS] & s->regs[R_GINTEN]));
}

static unsigned fmi_page_size(NUC980FMIState *s)
{
    static const uint16_t size[] = { 512, 2048, 4096, 8192 };

    return size[GET_FIELD(s, NANDCTL, PSIZE)];
}

static unsigned fmi_spare_size(NUC980FMIState *s)
{
    return MIN(GET_FIELD(s, NANDRACTL, RA128EN), NUC980_FMI_SPARE);
}

/* BCHTSEL has one bit set: T24, T4, T8, T12 or T15 */
static const NUC980BCH *fmi_code(NUC980FMIState *s)
{
    switch (GET_FIELD(s, NANDCTL, BCHTSEL)) {
    case 0x01:
        return nuc980_bch(24);
    case 0x02:
        return nuc980_bch(4);
    case 0x04:
        return nuc980_bch(8);
    case 0x08:
        return nuc980_bch(12);
    case 0x10:
        return nuc980_bch(15);
    default:
        return NULL;
    }
}

static Layout fmi_layout(NUC980FMIState *s)
{
    bool t24 = GET_FIELD(s, NANDCTL, BCHTSEL) == 1;
    Layout l = {
        .code = fmi_code(s),
        .size = t24 ? 1024 : 512,
        .padding = t24 ? 64 : 32,
    };

    if (l.code) {
        l.fields = fmi_page_size(s) / l.size;
        l.parity = nuc980_bch_parity_size(l.code);
        if (l.fields && l.fields * l.parity <= fmi_spare_size(s)) {
            l.parity_at = fmi_spare_size(s) - l.fields * l.parity;
            return l;
        }
    }
    if (GET_FIELD(s, NANDCTL, ECCEN)) {
        qemu_log_mask(LOG_GUEST_ERROR, "%s: NANDCTL 0x%08x asks for a parity "
                      "that %u bytes with %u spare cannot have\n",
                      TYPE_NUC980_FMI, s->regs[R_NANDCTL], fmi_page_size(s),
                      fmi_spare_size(s));
    }
    return (Layout) { .fields = 1, .size = fmi_page_size(s) };
}

/* ---- the flash ---- */

/* Whether CS0's flash is there, wired and selected. */
static bool fmi_reaches_flash(NUC980FMIState *s)
{
    return s->nand && s->pins && GET_FIELD(s, GCTL, NANDEN) &&
           !GET_FIELD(s, NANDCTL, CS0);
}

static void fmi_set_flash_pins(NUC980FMIState *s, bool cle, bool ale)
{
    /* nand.c has the spare in reach while its pin GND is high. */
    nand_setpins(s->nand, cle, ale, 0, GET_FIELD(s, NANDECTL, WP), 1);
}

static void fmi_become_ready(NUC980FMIState *s)
{
    s->busy = false;
    timer_del(&s->ready);
    SET_FIELD(s, NANDINTSTS, RB0IF, 1);
    trace_nuc980_fmi_ready();
    fmi_update_irq(s);
}

static void fmi_ready(void *opaque)
{
    fmi_become_ready(opaque);
}

/* A guest that polls sees the time pass without waiting for the main loop. */
static void fmi_look_at_ready(NUC980FMIState *s)
{
    if (s->busy && timer_expired(&s->ready,
                                 qemu_clock_get_ns(QEMU_CLOCK_VIRTUAL))) {
        fmi_become_ready(s);
    }
}

static void fmi_become_busy(NUC980FMIState *s, int64_t ns)
{
    s->busy = true;
    timer_mod(&s->ready, qemu_clock_get_ns(QEMU_CLOCK_VIRTUAL) + ns);
}

static void fmi_command(NUC980FMIState *s, uint8_t command)
{
    trace_nuc980_fmi_command(command);
    if (!fmi_reaches_flash(s)) {
        return;
    }
    if (s->busy && command != CMD_STATUS && command != CMD_RESET) {
        qemu_log_mask(LOG_GUEST_ERROR, "%s: command 0x%02x to a busy flash\n",
                      TYPE_NUC980_FMI, command);
        return;
    }
    s->command = command;
    fmi_set_flash_pins(s, true, false);
    nand_setio(s->nand, command);
    switch (command) {
    case CMD_READ_START:
        fmi_become_busy(s, READ_NS);
        break;
    case CMD_PROGRAM:
    case CMD_CACHE_PROGRAM:
        fmi_become_busy(s, PROGRAM_NS);
        break;
    case CMD_ERASE:
        fmi_become_busy(s, ERASE_NS);
        break;
    case CMD_RESET:
        /* guess: at once, since the vendor's Linux driver does not wait */
        fmi_become_ready(s);
        break;
    }
}

static void fmi_address(NUC980FMIState *s, uint8_t address)
{
    if (fmi_reaches_flash(s) && !s->busy) {
        fmi_set_flash_pins(s, false, true);
        nand_setio(s->nand, address);
    }
}

static void fmi_put(NUC980FMIState *s, uint8_t value)
{
    if (fmi_reaches_flash(s) && !s->busy) {
        fmi_set_flash_pins(s, false, false);
        nand_setio(s->nand, value);
    }
}

/* Nobody drives the bus where no flash answers: pull-ups do. */
static uint8_t fmi_get(NUC980FMIState *s)
{
    uint8_t value;

    if (!fmi_reaches_flash(s)) {
        return 0xff;
    }
    if (s->busy && s->command != CMD_STATUS) {
        qemu_log_mask(LOG_GUEST_ERROR, "%s: data read from a busy flash\n",
                      TYPE_NUC980_FMI);
        return 0xff;
    }
    fmi_set_flash_pins(s, false, false);
    value = nand_getio(s->nand);
    return s->busy ? value & ~NAND_STATUS_READY : value;
}

/* ---- a page, field by field ---- */

/*
 * What the parity protects: a field's data and a padding of zeros. With
 * PROT3BEN the first field has the spare's first three bytes in there.
 */
static size_t fmi_message(NUC980FMIState *s, const Layout *l, unsigned field,
                          uint8_t message[MAX_FIELD_SIZE + MAX_PADDING])
{
    memset(message + l->size, 0, l->padding);
    if (field == 0 && GET_FIELD(s, NANDCTL, PROT3BEN)) {
        memcpy(message + l->size, s->spare, 3);
    }
    return l->size + l->padding - l->parity;
}

static uint8_t *fmi_parity(NUC980FMIState *s, const Layout *l, unsigned field)
{
    return s->spare + l->parity_at + field * l->parity;
}

/* With ECCCHK: more than eight ones in the spare's bytes 2 and 3 */
static bool fmi_is_unused(NUC980FMIState *s)
{
    return GET_FIELD(s, NANDCTL, ECCCHK) &&
           ctpop8(s->spare[2]) + ctpop8(s->spare[3]) > 8;
}

static void fmi_clear_errors(NUC980FMIState *s)
{
    memset(&s->regs[R_NANDECCES0], 0, 4 * STATUS_REGS);
    memset(&s->regs[R_NANDECCEA0], 0, 4 * ERROR_ADDRESS_REGS);
    memset(&s->regs[R_NANDECCED0], 0, 4 * ERROR_DATA_REGS);
}

static void fmi_report_field(NUC980FMIState *s, unsigned field, uint8_t status)
{
    s->regs[R_NANDECCES0 + field / 4] |= status << (8 * (field % 4));
    SET_FIELD(s, NANDINTSTS, ECCFLDIF, 1);
}

/*
 * An error is a byte's place in data, padding and parity, and the bits to flip.
 * guess: so F1ECNT counts bytes, which is how far the drivers' loops go
 */
static void fmi_report_errors(NUC980FMIState *s, unsigned field,
                              const unsigned *where, int bits)
{
    int errors = 0;

    for (int i = 0; i < bits; i++) {
        unsigned byte = where[i] / 8;

        if (!i || byte != where[i - 1] / 8) {
            s->regs[R_NANDECCEA0 + errors / 2] |= byte << (16 * (errors % 2));
            errors++;
        }
        s->regs[R_NANDECCED0 + (errors - 1) / 4] |=
            0x80 >> (where[i] % 8) << (8 * ((errors - 1) % 4));
    }
    fmi_report_field(s, field, errors << 2 | FIELD_CORRECTABLE);
}

static void fmi_check_field(NUC980FMIState *s, const Layout *l, unsigned field,
                            uint8_t message[MAX_FIELD_SIZE + MAX_PADDING])
{
    unsigned where[NUC980_BCH_MAX_T];
    size_t size = fmi_message(s, l, field, message);
    int bits = nuc980_bch_decode(l->code, message, size,
                                 fmi_parity(s, l, field), where);

    if (bits) {
        trace_nuc980_fmi_error(field, bits);
        if (bits < 0) {
            fmi_report_field(s, field, FIELD_UNCORRECTABLE);
        } else {
            fmi_report_errors(s, field, where, bits);
        }
    }
}

static void fmi_end_transfer(NUC980FMIState *s)
{
    SET_FIELD(s, NANDCTL, DRDEN, 0);
    SET_FIELD(s, NANDCTL, DWREN, 0);
    s->field = 0;
}

static void fmi_abort(NUC980FMIState *s)
{
    qemu_log_mask(LOG_GUEST_ERROR, "%s: bus error at 0x%08x\n",
                  TYPE_NUC980_FMI, s->regs[R_DMASA]);
    SET_FIELD(s, DMAINTSTS, ABORTIF, 1);
    SET_FIELD(s, GINTSTS, DTAIF, 1);
    SET_FIELD(s, DMACTL, DMACEN, 0);
    fmi_end_transfer(s);
}

/*
 * The parity to compare with is what software has put into the spare buffer:
 * all drivers read a page's spare first. A wrong field stops the transfer
 * until ECCFLDIF is cleared (vendor's sm.c of NuWriter).
 */
static void fmi_read_page(NUC980FMIState *s)
{
    Layout l = fmi_layout(s);
    bool check = l.code && GET_FIELD(s, NANDCTL, ECCEN);
    uint8_t data[8192 + MAX_PADDING];

    while (s->field < l.fields && !GET_FIELD(s, NANDINTSTS, ECCFLDIF)) {
        for (unsigned i = 0; i < l.size; i++) {
            data[i] = fmi_get(s);
        }
        if (dma_memory_write(&address_space_memory,
                             s->regs[R_DMASA] + s->field * l.size, data,
                             l.size, MEMTXATTRS_UNSPECIFIED) != MEMTX_OK) {
            fmi_abort(s);
            return;
        }
        if (check && !fmi_is_unused(s)) {
            fmi_check_field(s, &l, s->field, data);
        }
        s->field++;
    }
    if (!GET_FIELD(s, NANDINTSTS, ECCFLDIF)) {
        fmi_end_transfer(s);
        SET_FIELD(s, NANDINTSTS, DMAIF, 1);
    }
}

/* guess: a parity that is not made, ECCEN being 0, shows as 0xff here too */
static void fmi_write_spare(NUC980FMIState *s, const Layout *l)
{
    if (l->code && !GET_FIELD(s, NANDCTL, ECCEN)) {
        memset(s->spare + l->parity_at, 0xff, l->fields * l->parity);
    }
    for (unsigned i = 0; i < fmi_spare_size(s); i++) {
        fmi_put(s, s->spare[i]);
    }
}

static void fmi_write_page(NUC980FMIState *s)
{
    Layout l = fmi_layout(s);
    uint8_t data[8192 + MAX_PADDING];

    for (unsigned field = 0; field < l.fields; field++) {
        if (dma_memory_read(&address_space_memory,
                            s->regs[R_DMASA] + field * l.size, data, l.size,
                            MEMTXATTRS_UNSPECIFIED) != MEMTX_OK) {
            fmi_abort(s);
            return;
        }
        for (unsigned i = 0; i < l.size; i++) {
            fmi_put(s, data[i]);
        }
        if (l.code && GET_FIELD(s, NANDCTL, ECCEN)) {
            size_t size = fmi_message(s, &l, field, data);

            nuc980_bch_encode(l.code, data, size, fmi_parity(s, &l, field));
        }
    }
    if (GET_FIELD(s, NANDCTL, REDUNAUTOWEN)) {
        fmi_write_spare(s, &l);
    }
    fmi_end_transfer(s);
    SET_FIELD(s, NANDINTSTS, DMAIF, 1);
}

/* Goes on with a transfer that is asked for, as far as it gets. */
static void fmi_run(NUC980FMIState *s)
{
    if (!GET_FIELD(s, DMACTL, DMACEN)) {
        return;
    }
    if (GET_FIELD(s, NANDCTL, DRDEN)) {
        fmi_read_page(s);
    } else if (GET_FIELD(s, NANDCTL, DWREN)) {
        fmi_write_page(s);
    }
}

/* ---- registers ---- */

static uint32_t fmi_dma_control(NUC980FMIState *s)
{
    bool busy = GET_FIELD(s, DMACTL, DMACEN) &&
                (GET_FIELD(s, NANDCTL, DRDEN) || GET_FIELD(s, NANDCTL, DWREN));

    return FIELD_DP32(s->regs[R_DMACTL], DMACTL, DMABUSY, busy);
}

static uint32_t fmi_bytes_left(NUC980FMIState *s)
{
    if (!GET_FIELD(s, NANDCTL, DRDEN)) {
        return 0;
    }
    return fmi_page_size(s) - s->field * fmi_layout(s).size;
}

/*
 * guess: where no flash is wired or selected, R/-B is pulled up: a probe finds
 * nothing and ends, instead of waiting for ever
 */
static uint32_t fmi_interrupt_status(NUC980FMIState *s)
{
    fmi_look_at_ready(s);
    return FIELD_DP32(s->regs[R_NANDINTSTS], NANDINTSTS, RB0STATUS,
                      !(s->busy && s->pins));
}

static uint64_t fmi_read(void *opaque, hwaddr addr, unsigned size)
{
    NUC980FMIState *s = opaque;

    switch (addr & ~3) {
    case A_DMACTL:
        return fmi_dma_control(s);
    case A_DMABCNT:
        return fmi_bytes_left(s);
    case A_NANDINTSTS:
        return fmi_interrupt_status(s);
    case A_NANDDATA:
        fmi_look_at_ready(s);
        return fmi_get(s);
    case A_NANDCMD:
    case A_NANDADDR:
        return 0;                       /* guess: write only */
    case A_DMASA:
    case A_DMAINTEN:
    case A_DMAINTSTS:
    case A_GCTL:
    case A_GINTEN:
    case A_GINTSTS:
    case A_NANDCTL:
    case A_NANDTMCTL:
    case A_NANDINTEN:
    case A_NANDRACTL:
    case A_NANDECTL:
    case A_NANDECCES0 ... A_NANDECCES0 + 4 * STATUS_REGS - 4:
    case A_NANDECCEA0 ... A_NANDECCEA0 + 4 * ERROR_ADDRESS_REGS - 4:
    case A_NANDECCED0 ... A_NANDECCED0 + 4 * ERROR_DATA_REGS - 4:
        return s->regs[addr / 4];
    default:
        nuc980_unimp_once(s->unimplemented, TYPE_NUC980_FMI, addr);
        return 0;
    }
}

/* Not modelled: what the bits of this mask ask for */
static void fmi_unimp_bits(NUC980FMIState *s, hwaddr addr, uint32_t bits)
{
    if (bits && qemu_loglevel_mask(LOG_UNIMP) &&
        !test_and_set_bit(addr / 4, s->unimplemented)) {
        qemu_log("%s: register 0x%" HWADDR_PRIx ": bits 0x%08x are not "
                 "modelled\n", TYPE_NUC980_FMI, addr, bits);
    }
}

static void fmi_write_dma_control(NUC980FMIState *s, uint32_t value)
{
    fmi_unimp_bits(s, A_DMACTL, value & R_DMACTL_SGEN_MASK);
    s->regs[R_DMACTL] = value & (R_DMACTL_DMACEN_MASK | R_DMACTL_SGEN_MASK);
}

/* A new page size sets the spare's to what is usual with it. */
static void fmi_write_nand_control(NUC980FMIState *s, uint32_t value)
{
    const uint32_t self_clearing = R_NANDCTL_SWRST_MASK |
                                   R_NANDCTL_REDUNREN_MASK |
                                   R_NANDCTL_SRAMINT_MASK;
    static const uint16_t spare_size[] = { 16, 64, 128, 256 };
    unsigned page = FIELD_EX32(value, NANDCTL, PSIZE);
    uint32_t started = value & ~s->regs[R_NANDCTL] &
                       (R_NANDCTL_DRDEN_MASK | R_NANDCTL_DWREN_MASK);

    fmi_unimp_bits(s, A_NANDCTL, value & R_NANDCTL_PROTREGIONEN_MASK);
    if (page != GET_FIELD(s, NANDCTL, PSIZE)) {
        SET_FIELD(s, NANDRACTL, RA128EN, spare_size[page]);
    }
    if (started) {
        trace_nuc980_fmi_page(started & R_NANDCTL_DRDEN_MASK ? "read" : "write",
                              s->regs[R_DMASA], value);
        fmi_clear_errors(s);
    }
    s->regs[R_NANDCTL] = value & ~self_clearing;
    if (FIELD_EX32(value, NANDCTL, SWRST)) {
        fmi_end_transfer(s);
    }
    if (FIELD_EX32(value, NANDCTL, SRAMINT)) {
        memset(s->spare, 0xff, 8);
    }
    if (FIELD_EX32(value, NANDCTL, REDUNREN)) {
        for (unsigned i = 0; i < fmi_spare_size(s); i++) {
            s->spare[i] = fmi_get(s);
        }
    }
}

/* guess: a field's errors go with its flag: NuWriter looks for the first */
static void fmi_clear_interrupts(NUC980FMIState *s, uint32_t value)
{
    s->regs[R_NANDINTSTS] &= ~value;
    if (FIELD_EX32(value, NANDINTSTS, ECCFLDIF)) {
        fmi_clear_errors(s);
    }
}

static void fmi_write(void *opaque, hwaddr addr, uint64_t value, unsigned size)
{
    NUC980FMIState *s = opaque;

    trace_nuc980_fmi_write(addr, value);
    fmi_look_at_ready(s);
    switch (addr & ~3) {
    case A_DMACTL:
        fmi_write_dma_control(s, value);
        break;
    case A_DMAINTSTS:
    case A_GINTSTS:
        s->regs[addr / 4] &= ~value;
        break;
    case A_GCTL:
        fmi_unimp_bits(s, A_GCTL, value & R_GCTL_EMMCEN_MASK);
        s->regs[R_GCTL] = value & (R_GCTL_EMMCEN_MASK | R_GCTL_NANDEN_MASK);
        if (FIELD_EX32(value, GCTL, GCTLRST)) {
            fmi_end_transfer(s);
        }
        break;
    case A_NANDCTL:
        fmi_write_nand_control(s, value);
        break;
    case A_NANDINTSTS:
        fmi_clear_interrupts(s, value);
        break;
    case A_NANDCMD:
        fmi_command(s, value);
        break;
    case A_NANDADDR:
        fmi_address(s, value);
        break;
    case A_NANDDATA:
        fmi_put(s, value);
        break;
    case A_NANDRACTL:
        fmi_unimp_bits(s, A_NANDRACTL, value & R_NANDRACTL_MECC_MASK);
        /* fall through */
    case A_DMASA:
    case A_DMAINTEN:
    case A_GINTEN:
    case A_NANDTMCTL:
    case A_NANDINTEN:
    case A_NANDECTL:
        s->regs[addr / 4] = value;
        break;
    case A_DMABCNT:
    case A_NANDECCES0 ... A_NANDECCES0 + 4 * STATUS_REGS - 4:
    case A_NANDECCEA0 ... A_NANDECCEA0 + 4 * ERROR_ADDRESS_REGS - 4:
    case A_NANDECCED0 ... A_NANDECCED0 + 4 * ERROR_DATA_REGS - 4:
        qemu_log_mask(LOG_GUEST_ERROR, "%s: register 0x%" HWADDR_PRIx
                      " is read only\n", TYPE_NUC980_FMI, addr);
        break;
    default:
        nuc980_unimp_once(s->unimplemented, TYPE_NUC980_FMI, addr);
        break;
    }
    fmi_run(s);
    fmi_update_irq(s);
}

static const MemoryRegionOps fmi_ops = {
    .read = fmi_read,
    .write = fmi_write,
    .endianness = DEVICE_LITTLE_ENDIAN,
    /* The vendor's tools read and write the NAND's ports also as bytes. */
    .valid = { .min_access_size = 1, .max_access_size = 4 },
    .impl = { .min_access_size = 4, .max_access_size = 4 },
};

static uint64_t fmi_spare_read(void *opaque, hwaddr addr, unsigned size)
{
    NUC980FMIState *s = opaque;

    return s->spare[addr];
}

static void fmi_spare_write(void *opaque, hwaddr addr, uint64_t value,
                            unsigned size)
{
    NUC980FMIState *s = opaque;

    s->spare[addr] = value;
}

static const MemoryRegionOps fmi_spare_ops = {
    .read = fmi_spare_read,
    .write = fmi_spare_write,
    .endianness = DEVICE_LITTLE_ENDIAN,
    .valid = { .min_access_size = 1, .max_access_size = 4 },
    .impl = { .min_access_size = 1, .max_access_size = 1 },
};

static void fmi_set_pins(void *opaque, int n, int level)
{
    NUC980FMIState *s = opaque;

    s->pins = level;
}

static void fmi_reset(DeviceState *dev)
{
    NUC980FMIState *s = NUC980_FMI(dev);

    memset(s->regs, 0, sizeof(s->regs));
    memset(s->spare, 0xff, sizeof(s->spare));   /* guess */
    s->regs[R_NANDCTL] = 0x1e880090;
    s->regs[R_NANDRACTL] = 16;
    s->field = 0;
    s->command = 0;
    s->busy = false;
    timer_del(&s->ready);
    fmi_update_irq(s);
    /* It has no reset pin, nor a bus to be reset with: boot software does. */
    if (s->nand) {
        device_cold_reset(s->nand);
    }
}

static int fmi_post_load(void *opaque, int version_id)
{
    fmi_update_irq(opaque);
    return 0;
}

static const VMStateDescription vmstate_nuc980_fmi = {
    .name = TYPE_NUC980_FMI,
    .version_id = 1,
    .minimum_version_id = 1,
    .post_load = fmi_post_load,
    .fields = (VMStateField[]) {
        VMSTATE_UINT32_ARRAY(regs, NUC980FMIState, NUC980_FMI_REGS),
        VMSTATE_UINT8_ARRAY(spare, NUC980FMIState, NUC980_FMI_SPARE),
        VMSTATE_BOOL(pins, NUC980FMIState),
        VMSTATE_UINT8(command, NUC980FMIState),
        VMSTATE_BOOL(busy, NUC980FMIState),
        VMSTATE_TIMER(ready, NUC980FMIState),
        VMSTATE_UINT8(field, NUC980FMIState),
        VMSTATE_END_OF_LIST()
    }
};

static void fmi_init(Object *obj)
{
    NUC980FMIState *s = NUC980_FMI(obj);

    memory_region_init_io(&s->iomem, obj, &fmi_ops, s, TYPE_NUC980_FMI,
                          NUC980_FMI_SIZE);
    memory_region_init_io(&s->spare_iomem, obj, &fmi_spare_ops, s,
                          "nuc980-fmi.spare", NUC980_FMI_SPARE);
    memory_region_add_subregion(&s->iomem, SPARE_OFFSET, &s->spare_iomem);
    sysbus_init_mmio(SYS_BUS_DEVICE(obj), &s->iomem);
    sysbus_init_irq(SYS_BUS_DEVICE(obj), &s->irq);
    qdev_init_gpio_in_named(DEVICE(obj), fmi_set_pins, "pins", 1);
    timer_init_ns(&s->ready, QEMU_CLOCK_VIRTUAL, fmi_ready, s);
}

static Property fmi_properties[] = {
    DEFINE_PROP_LINK("nand", NUC980FMIState, nand, TYPE_DEVICE, DeviceState *),
    DEFINE_PROP_END_OF_LIST(),
};

static void fmi_class_init(ObjectClass *klass, void *data)
{
    DeviceClass *dc = DEVICE_CLASS(klass);

    dc->reset = fmi_reset;
    dc->vmsd = &vmstate_nuc980_fmi;
    device_class_set_props(dc, fmi_properties);
    set_bit(DEVICE_CATEGORY_STORAGE, dc->categories);
}

static const TypeInfo nuc980_fmi_types[] = {
    {
        .name = TYPE_NUC980_FMI,
        .parent = TYPE_SYS_BUS_DEVICE,
        .instance_size = sizeof(NUC980FMIState),
        .instance_init = fmi_init,
        .class_init = fmi_class_init,
    },
};

DEFINE_TYPES(nuc980_fmi_types)
