/*
 * Nuvoton NUC980 peripheral DMA controller
 *
 * Registers as in Nuvoton's BSP for the chip (pdma.h), which describes them,
 * and as the vendor's Linux driver uses them.
 *
 * Not modelled: stride mode, and what only timing would show: burst size,
 * TXACK, priorities (channels take turns).
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#include "qemu/osdep.h"
#include "exec/address-spaces.h"
#include "hw/dma/nuc980_pdma.h"
#include "hw/irq.h"
#include "hw/misc/nuc980_unimp.h"
#include "hw/qdev-clock.h"
#include "hw/registerfields.h"
#include "migration/vmstate.h"
#include "qemu/log.h"
#include "sysemu/dma.h"
#include "trace.h"

/* A channel's task, four registers; in memory the same four words */
REG32(DSCT_CTL, 0x00)
    FIELD(DSCT_CTL, OPMODE, 0, 2)
    FIELD(DSCT_CTL, TXTYPE, 2, 1)
    FIELD(DSCT_CTL, TBINTDIS, 7, 1)
    FIELD(DSCT_CTL, SAINC, 8, 2)
    FIELD(DSCT_CTL, DAINC, 10, 2)
    FIELD(DSCT_CTL, TXWIDTH, 12, 2)
    FIELD(DSCT_CTL, STRIDEEN, 15, 1)
    FIELD(DSCT_CTL, TXCNT, 16, 16)
REG32(DSCT_SA, 0x04)
REG32(DSCT_DA, 0x08)
REG32(DSCT_NEXT, 0x0c)
REG32(CURSCAT, 0x100)
REG32(CHCTL, 0x400)
REG32(PAUSE, 0x404)
REG32(SWREQ, 0x408)
REG32(TRGSTS, 0x40c)
REG32(PRISET, 0x410)
REG32(PRICLR, 0x414)
REG32(INTEN, 0x418)
REG32(INTSTS, 0x41c)
    FIELD(INTSTS, ABTIF, 0, 1)
    FIELD(INTSTS, TDIF, 1, 1)
    FIELD(INTSTS, ALIGNF, 2, 1)
    FIELD(INTSTS, REQTOF, 8, 10)
REG32(ABTSTS, 0x420)
REG32(TDSTS, 0x424)
REG32(ALIGN, 0x428)
REG32(TACTSTS, 0x42c)
REG32(TOUTPSC, 0x430)
REG32(TOUTEN, 0x434)
REG32(TOUTIEN, 0x438)
REG32(SCATBA, 0x43c)
REG32(TOC0_1, 0x440)
REG32(TOC8_9, 0x450)
REG32(CHRST, 0x460)
REG32(TOUTPSC2, 0x470)
REG32(REQSEL0_3, 0x480)
REG32(REQSEL8_11, 0x488)
REG32(STRIDE, 0x500)

#define DSCT_REGS       4
#define DSCT_END        (4 * DSCT_REGS * NUC980_PDMA_CHANNELS)
#define CURSCAT_END     (A_CURSCAT + 4 * NUC980_PDMA_CHANNELS)
#define STRIDE_END      (4 * NUC980_PDMA_REGS)
#define CHANNELS        ((1u << NUC980_PDMA_CHANNELS) - 1)

enum {
    OPMODE_IDLE = 0,
    OPMODE_BASIC = 1,
    OPMODE_SCATTER = 2,
};

enum { ADDRESS_FIXED = 3 };

/*
 * No request is served at once: it comes from within a register access of the
 * peripheral that the transfer will access again. And a chain that never ends,
 * or two controllers that trigger each other, must leave time for all else: a
 * run has a delay, and so many steps a pause.
 * guess: 15 cycles of HCLK; 256 words in 10 us are about what its bus carries
 */
#define RUN_DELAY_NS    100
#define RUN_STEPS       256
#define RUN_PAUSE_NS    10000

static const char *pdma_name(NUC980PDMAState *s)
{
    return object_get_canonical_path_component(OBJECT(s));
}

static uint32_t *pdma_task(NUC980PDMAState *s, int n)
{
    return &s->regs[DSCT_REGS * n];
}

static unsigned pdma_opmode(NUC980PDMAState *s, int n)
{
    return FIELD_EX32(*pdma_task(s, n), DSCT_CTL, OPMODE);
}

/* Requests */

static unsigned pdma_source(NUC980PDMAState *s, int n)
{
    return extract32(s->regs[R_REQSEL0_3 + n / 4], 8 * (n % 4), 7);
}

static bool pdma_requested(NUC980PDMAState *s, int n)
{
    unsigned source = pdma_source(s, n);

    /* 0: memory, which never asks */
    return extract32(s->swreq, n, 1) ||
           (source && source < NUC980_PDMA_REQUESTS &&
            extract64(s->requests, source, 1));
}

static uint32_t pdma_all_requested(NUC980PDMAState *s)
{
    uint32_t value = 0;

    for (int n = 0; n < NUC980_PDMA_CHANNELS; n++) {
        value |= pdma_requested(s, n) << n;
    }
    return value;
}

static uint32_t pdma_all_active(NUC980PDMAState *s)
{
    uint32_t value = pdma_all_requested(s) & s->regs[R_CHCTL];

    for (int n = 0; n < NUC980_PDMA_CHANNELS; n++) {
        if (pdma_opmode(s, n) == OPMODE_IDLE) {
            value &= ~BIT(n);
        }
    }
    return value;
}

/* Interrupts */

static uint32_t pdma_intsts(NUC980PDMAState *s)
{
    uint32_t value = s->regs[R_INTSTS];

    value = FIELD_DP32(value, INTSTS, ABTIF, !!s->regs[R_ABTSTS]);
    value = FIELD_DP32(value, INTSTS, TDIF, !!s->regs[R_TDSTS]);
    return FIELD_DP32(value, INTSTS, ALIGNF, !!s->regs[R_ALIGN]);
}

static void pdma_update(NUC980PDMAState *s)
{
    uint32_t task = s->regs[R_ABTSTS] | s->regs[R_TDSTS] | s->regs[R_ALIGN];
    uint32_t late = FIELD_EX32(s->regs[R_INTSTS], INTSTS, REQTOF);

    qemu_set_irq(s->irq, (task & s->regs[R_INTEN]) ||
                         (late & s->regs[R_TOUTIEN]));
}

/* Request time-out */

/* Counts from each served request on; the first starts it */
static void pdma_restart_timeout(NUC980PDMAState *s, int n)
{
    unsigned count = extract32(s->regs[R_TOC0_1 + n / 2], 16 * (n % 2), 16);
    unsigned prescale = n < 8 ? extract32(s->regs[R_TOUTPSC], 4 * n, 3) :
                        extract32(s->regs[R_TOUTPSC2], 4 * (n - 8), 3);
    /* guess: 0 is as 1 */
    uint64_t ticks = (uint64_t)MAX(count, 1) << (8 + prescale);

    if (extract32(s->regs[R_TOUTEN], n, 1) && clock_is_enabled(s->hclk)) {
        timer_mod(s->timeout[n].timer,
                  qemu_clock_get_ns(QEMU_CLOCK_VIRTUAL) +
                  clock_ticks_to_ns(s->hclk, ticks));
    } else {
        timer_del(s->timeout[n].timer);
    }
}

/* guess: it counts again only after the next served request */
static void pdma_timeout(void *opaque)
{
    NUC980PDMATimeout *timeout = opaque;
    NUC980PDMAState *s = timeout->pdma;
    int n = timeout - s->timeout;

    trace_nuc980_pdma_timeout(pdma_name(s), n);
    s->regs[R_INTSTS] |= BIT(n) << R_INTSTS_REQTOF_SHIFT;
    pdma_update(s);
}

static void pdma_hclk_update(void *opaque, ClockEvent event)
{
    NUC980PDMAState *s = opaque;

    for (int n = 0; n < NUC980_PDMA_CHANNELS; n++) {
        if (timer_pending(s->timeout[n].timer)) {
            pdma_restart_timeout(s, n);
        }
    }
}

/* Tasks */

/* What a channel that is stopped, by whomever, no longer waits for */
static void pdma_forget(NUC980PDMAState *s, uint32_t channels)
{
    s->swreq &= ~channels;
    for (int n = 0; n < NUC980_PDMA_CHANNELS; n++) {
        if (extract32(channels, n, 1)) {
            timer_del(s->timeout[n].timer);
        }
    }
}

static void pdma_idle(NUC980PDMAState *s, int n)
{
    uint32_t *task = pdma_task(s, n);

    *task = FIELD_DP32(*task, DSCT_CTL, OPMODE, OPMODE_IDLE);
    pdma_forget(s, BIT(n));
}

/* guess: a task that cannot be is over, and is not done */
static void pdma_fail(NUC980PDMAState *s, int n, int flags, const char *why)
{
    uint32_t *task = pdma_task(s, n);

    qemu_log_mask(LOG_GUEST_ERROR, "%s: channel %d: %s: control 0x%08" PRIx32
                  ", from 0x%08" PRIx32 ", to 0x%08" PRIx32 "\n",
                  pdma_name(s), n, why, task[R_DSCT_CTL], task[R_DSCT_SA],
                  task[R_DSCT_DA]);
    if (flags) {
        s->regs[flags] |= BIT(n);
    }
    pdma_idle(s, n);
}

static void pdma_load(NUC980PDMAState *s, int n)
{
    uint32_t *task = pdma_task(s, n), words[DSCT_REGS];
    uint32_t addr = s->regs[R_SCATBA] + (task[R_DSCT_NEXT] & ~3u);

    if (dma_memory_read(&address_space_memory, addr, words, sizeof(words),
                        MEMTXATTRS_UNSPECIFIED) != MEMTX_OK) {
        pdma_fail(s, n, R_ABTSTS, "no memory for the next task");
        return;
    }
    for (int i = 0; i < DSCT_REGS; i++) {
        task[i] = le32_to_cpu(words[i]);
    }
    s->regs[R_CURSCAT + n] = addr;
    s->loaded |= BIT(n);
    trace_nuc980_pdma_task(pdma_name(s), n, task[R_DSCT_CTL],
                           task[R_DSCT_SA], task[R_DSCT_DA],
                           task[R_DSCT_NEXT]);
    if (pdma_opmode(s, n) == OPMODE_IDLE) {
        pdma_idle(s, n);
    }
}

static void pdma_done(NUC980PDMAState *s, int n)
{
    trace_nuc980_pdma_done(pdma_name(s), n);
    /* guess: the bit keeps the status away, not only the interrupt */
    if (!FIELD_EX32(*pdma_task(s, n), DSCT_CTL, TBINTDIS)) {
        s->regs[R_TDSTS] |= BIT(n);
    }
    if (pdma_opmode(s, n) == OPMODE_SCATTER) {
        pdma_load(s, n);
    } else {
        pdma_idle(s, n);
    }
}

static bool pdma_copy(uint32_t from, uint32_t to, unsigned width)
{
    uint8_t data[4];

    return dma_memory_read(&address_space_memory, from, data, width,
                           MEMTXATTRS_UNSPECIFIED) == MEMTX_OK &&
           dma_memory_write(&address_space_memory, to, data, width,
                            MEMTXATTRS_UNSPECIFIED) == MEMTX_OK;
}

static void pdma_transfer(NUC980PDMAState *s, int n)
{
    uint32_t *task = pdma_task(s, n), ctl = task[R_DSCT_CTL];
    unsigned width = 1 << FIELD_EX32(ctl, DSCT_CTL, TXWIDTH);

    if (FIELD_EX32(ctl, DSCT_CTL, STRIDEEN)) {
        nuc980_unimp_once(s->unimp_seen, pdma_name(s), A_STRIDE);
    }
    if (width > 4) {
        pdma_fail(s, n, 0, "width 3 is reserved");
        return;
    }
    if ((task[R_DSCT_SA] | task[R_DSCT_DA]) & (width - 1)) {
        pdma_fail(s, n, R_ALIGN, "address not aligned to the width");
        return;
    }
    /*
     * One request is one transfer of type single, all of a burst's. A
     * peripheral's burst still heeds its line: BSP has bursts between
     * memories only.
     */
    if (FIELD_EX32(ctl, DSCT_CTL, TXTYPE)) {
        s->swreq &= ~BIT(n);
    }
    if (!pdma_copy(task[R_DSCT_SA], task[R_DSCT_DA], width)) {
        pdma_fail(s, n, R_ABTSTS, "bus error");
        return;
    }
    if (FIELD_EX32(ctl, DSCT_CTL, SAINC) != ADDRESS_FIXED) {
        task[R_DSCT_SA] += width;
    }
    if (FIELD_EX32(ctl, DSCT_CTL, DAINC) != ADDRESS_FIXED) {
        task[R_DSCT_DA] += width;
    }
    if (pdma_source(s, n)) {
        pdma_restart_timeout(s, n);
    }
    if (FIELD_EX32(ctl, DSCT_CTL, TXCNT)) {
        task[R_DSCT_CTL] = ctl - (1 << R_DSCT_CTL_TXCNT_SHIFT);
    } else {
        pdma_done(s, n);
    }
}

/* One transfer, or one task loaded, where a channel asks for it */
static bool pdma_step(NUC980PDMAState *s, int n)
{
    if (!extract32(s->regs[R_CHCTL], n, 1) || !pdma_requested(s, n)) {
        return false;
    }
    switch (pdma_opmode(s, n)) {
    case OPMODE_IDLE:
        return false;
    case OPMODE_SCATTER:
        if (!extract32(s->loaded, n, 1)) {
            pdma_load(s, n);
            return true;
        }
        /* fall through */
    case OPMODE_BASIC:
        pdma_transfer(s, n);
        return true;
    default:
        pdma_fail(s, n, 0, "operation mode 3 is reserved");
        return true;
    }
}

static void pdma_run_after(NUC980PDMAState *s, int64_t ns)
{
    timer_mod(s->run, qemu_clock_get_ns(QEMU_CLOCK_VIRTUAL) + ns);
}

static void pdma_run(void *opaque)
{
    NUC980PDMAState *s = opaque;
    int steps = 0, before;

    do {
        before = steps;
        for (int n = 0; n < NUC980_PDMA_CHANNELS; n++) {
            steps += pdma_step(s, n);
        }
    } while (steps > before && steps < RUN_STEPS);
    if (steps > before) {
        pdma_run_after(s, RUN_PAUSE_NS);
    }
    pdma_update(s);
}

static void pdma_kick(NUC980PDMAState *s)
{
    if (!timer_pending(s->run)) {
        pdma_run_after(s, RUN_DELAY_NS);
    }
}

static void pdma_set_request(void *opaque, int n, int level)
{
    NUC980PDMAState *s = opaque;

    s->requests = deposit64(s->requests, n, 1, !!level);
    if (level) {
        pdma_kick(s);
    }
}

/* Registers */

static uint64_t pdma_read_reg(NUC980PDMAState *s, hwaddr offset)
{
    switch (offset) {
    case A_TRGSTS:
        return pdma_all_requested(s);
    case A_TACTSTS:
        return pdma_all_active(s);
    case A_INTSTS:
        return pdma_intsts(s);
    case 0 ... DSCT_END - 4:
    case A_CURSCAT ... CURSCAT_END - 4:
    case A_CHCTL:
    case A_PRISET:
    case A_INTEN:
    case A_ABTSTS:
    case A_TDSTS:
    case A_ALIGN:
    case A_TOUTPSC:
    case A_TOUTEN:
    case A_TOUTIEN:
    case A_SCATBA:
    case A_TOC0_1 ... A_TOC8_9:
    case A_TOUTPSC2:
    case A_REQSEL0_3 ... A_REQSEL8_11:
        return s->regs[offset / 4];
    case A_STRIDE ... STRIDE_END - 4:
        nuc980_unimp_once(s->unimp_seen, pdma_name(s), offset);
        return s->regs[offset / 4];
    default:
        qemu_log_mask(LOG_GUEST_ERROR, "%s: read of 0x%" HWADDR_PRIx
                      ", no register to read\n", pdma_name(s), offset);
        return 0;
    }
}

static uint64_t pdma_read(void *opaque, hwaddr offset, unsigned size)
{
    NUC980PDMAState *s = opaque;
    uint64_t value = pdma_read_reg(s, offset);

    trace_nuc980_pdma_read(pdma_name(s), offset, value);
    return value;
}

/* guess: a reset channel keeps its task's registers, but for the mode */
static void pdma_reset_channels(NUC980PDMAState *s, uint32_t channels)
{
    s->regs[R_CHCTL] &= ~channels;
    for (int n = 0; n < NUC980_PDMA_CHANNELS; n++) {
        if (extract32(channels, n, 1)) {
            pdma_idle(s, n);
        }
    }
}

static void pdma_write_reg(NUC980PDMAState *s, hwaddr offset, uint32_t value)
{
    uint32_t *reg = &s->regs[offset / 4];
    uint32_t channels = value & CHANNELS;

    switch (offset) {
    case 0 ... DSCT_END - 4:
        *reg = value;
        if (offset % (4 * DSCT_REGS) == A_DSCT_CTL) {
            s->loaded &= ~BIT(offset / (4 * DSCT_REGS));
        }
        break;
    case A_CHCTL:
        *reg = channels;
        pdma_forget(s, ~channels);
        break;
    case A_PAUSE:
        s->regs[R_CHCTL] &= ~channels;
        pdma_forget(s, channels);
        break;
    case A_SWREQ:
        s->swreq |= channels & s->regs[R_CHCTL];
        break;
    case A_PRISET:
        *reg |= channels;
        break;
    case A_PRICLR:
        s->regs[R_PRISET] &= ~channels;
        break;
    case A_INTEN:
    case A_TOUTIEN:
        *reg = channels;
        break;
    case A_INTSTS:
        *reg &= ~(value & R_INTSTS_REQTOF_MASK);
        break;
    case A_ABTSTS:
    case A_TDSTS:
    case A_ALIGN:
        *reg &= ~value;
        break;
    case A_TOUTEN:
        *reg = channels;
        for (int n = 0; n < NUC980_PDMA_CHANNELS; n++) {
            if (!extract32(channels, n, 1)) {
                timer_del(s->timeout[n].timer);
            }
        }
        break;
    case A_SCATBA:
        *reg = value & 0xffff0000;
        break;
    case A_CHRST:
        pdma_reset_channels(s, channels);
        break;
    case A_TOUTPSC:
    case A_TOUTPSC2:
    case A_TOC0_1 ... A_TOC8_9:
    case A_REQSEL0_3 ... A_REQSEL8_11:
        *reg = value;
        break;
    case A_STRIDE ... STRIDE_END - 4:
        nuc980_unimp_once(s->unimp_seen, pdma_name(s), offset);
        *reg = value;
        break;
    default:
        qemu_log_mask(LOG_GUEST_ERROR, "%s: write of 0x%" PRIx32 " to 0x%"
                      HWADDR_PRIx ", no register to write\n", pdma_name(s),
                      value, offset);
    }
}

static void pdma_write(void *opaque, hwaddr offset, uint64_t value,
                       unsigned size)
{
    NUC980PDMAState *s = opaque;

    trace_nuc980_pdma_write(pdma_name(s), offset, value);
    pdma_write_reg(s, offset, value);
    pdma_update(s);
    pdma_kick(s);
}

static const MemoryRegionOps pdma_ops = {
    .read = pdma_read,
    .write = pdma_write,
    .endianness = DEVICE_LITTLE_ENDIAN,
    .valid = { .min_access_size = 4, .max_access_size = 4 },
};

/* Device */

/* guess: all registers are 0; SCATBA must be (the vendor's driver) */
static void pdma_reset(DeviceState *dev)
{
    NUC980PDMAState *s = NUC980_PDMA(dev);

    memset(s->regs, 0, sizeof(s->regs));
    s->loaded = 0;
    pdma_forget(s, CHANNELS);
    timer_del(s->run);
    pdma_update(s);
}

static int pdma_post_load(void *opaque, int version_id)
{
    pdma_update(opaque);
    return 0;
}

static const VMStateDescription vmstate_nuc980_pdma_timeout = {
    .name = TYPE_NUC980_PDMA "-timeout",
    .version_id = 1,
    .minimum_version_id = 1,
    .fields = (VMStateField[]) {
        VMSTATE_TIMER_PTR(timer, NUC980PDMATimeout),
        VMSTATE_END_OF_LIST()
    }
};

static const VMStateDescription vmstate_nuc980_pdma = {
    .name = TYPE_NUC980_PDMA,
    .version_id = 1,
    .minimum_version_id = 1,
    .post_load = pdma_post_load,
    .fields = (VMStateField[]) {
        VMSTATE_CLOCK(hclk, NUC980PDMAState),
        VMSTATE_TIMER_PTR(run, NUC980PDMAState),
        VMSTATE_STRUCT_ARRAY(timeout, NUC980PDMAState, NUC980_PDMA_CHANNELS, 1,
                             vmstate_nuc980_pdma_timeout, NUC980PDMATimeout),
        VMSTATE_UINT32_ARRAY(regs, NUC980PDMAState, NUC980_PDMA_REGS),
        VMSTATE_UINT64(requests, NUC980PDMAState),
        VMSTATE_UINT32(swreq, NUC980PDMAState),
        VMSTATE_UINT32(loaded, NUC980PDMAState),
        VMSTATE_END_OF_LIST()
    }
};

static void pdma_init(Object *obj)
{
    NUC980PDMAState *s = NUC980_PDMA(obj);
    DeviceState *dev = DEVICE(obj);

    memory_region_init_io(&s->iomem, obj, &pdma_ops, s, TYPE_NUC980_PDMA,
                          4 * NUC980_PDMA_REGS);
    sysbus_init_mmio(SYS_BUS_DEVICE(obj), &s->iomem);
    sysbus_init_irq(SYS_BUS_DEVICE(obj), &s->irq);
    qdev_init_gpio_in_named(dev, pdma_set_request, "request",
                            NUC980_PDMA_REQUESTS);
    s->hclk = qdev_init_clock_in(dev, "hclk", pdma_hclk_update, s,
                                 ClockUpdate);
    s->run = timer_new_ns(QEMU_CLOCK_VIRTUAL, pdma_run, s);
    for (int n = 0; n < NUC980_PDMA_CHANNELS; n++) {
        s->timeout[n].pdma = s;
        s->timeout[n].timer = timer_new_ns(QEMU_CLOCK_VIRTUAL, pdma_timeout,
                                           &s->timeout[n]);
    }
}

static void pdma_finalize(Object *obj)
{
    NUC980PDMAState *s = NUC980_PDMA(obj);

    timer_free(s->run);
    for (int n = 0; n < NUC980_PDMA_CHANNELS; n++) {
        timer_free(s->timeout[n].timer);
    }
}

static void pdma_class_init(ObjectClass *klass, void *data)
{
    DeviceClass *dc = DEVICE_CLASS(klass);

    dc->reset = pdma_reset;
    dc->vmsd = &vmstate_nuc980_pdma;
    set_bit(DEVICE_CATEGORY_MISC, dc->categories);
}

static const TypeInfo nuc980_pdma_types[] = {
    {
        .name = TYPE_NUC980_PDMA,
        .parent = TYPE_SYS_BUS_DEVICE,
        .instance_size = sizeof(NUC980PDMAState),
        .instance_init = pdma_init,
        .instance_finalize = pdma_finalize,
        .class_init = pdma_class_init,
    },
};

DEFINE_TYPES(nuc980_pdma_types)
