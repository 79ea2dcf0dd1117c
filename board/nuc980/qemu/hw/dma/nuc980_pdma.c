/*
 * Nuvoton NUC980 peripheral DMA controller
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#include "qemu/osdep.h"
#include "exec/address-spaces.h"
#include "hw/irq.h"
#include "hw/qdev-clock.h"
#include "qemu/log.h"
#include "qemu/module.h"
#include "sysemu/dma.h"
#include "hw/dma/nuc980_pdma.h"

static void pdma_irq(NUC980PDMAState *p)
{
    qemu_set_irq(p->irq, (p->tdsts & p->inten) ||
                 ((p->intsts >> 8) & p->toutien));
}

/* Is the peripheral that drives this channel asking for a transfer? */
static bool pdma_request(NUC980PDMAState *p, int n)
{
    int src = (p->reqsel[n / 4] >> (8 * (n % 4))) & 0xff;

    if (src == 0) {
        return p->ch[n].swreq;
    }
    return src < 64 && ((p->requests >> src) & 1);
}

static void pdma_load(NUC980PDMAState *p, NUC980PDMAChannel *c)
{
    uint32_t d[4];

    c->cur = p->scatba + c->next;
    dma_memory_read(&address_space_memory, c->cur, d, sizeof(d),
                    MEMTXATTRS_UNSPECIFIED);
    c->ctl = le32_to_cpu(d[0]);
    c->sa = le32_to_cpu(d[1]);
    c->da = le32_to_cpu(d[2]);
    c->next = le32_to_cpu(d[3]);
    c->loaded = true;
}

static void pdma_run_chan(NUC980PDMAState *p, int n)
{
    NUC980PDMAChannel *c = &p->ch[n];

    while ((p->chctl & (1 << n)) && (c->ctl & 3) && pdma_request(p, n)) {
        int width;
        uint8_t buf[4];

        if ((c->ctl & 3) == 2 && !c->loaded) {
            pdma_load(p, c);
            continue;
        }
        width = 1 << ((c->ctl >> 12) & 3);
        dma_memory_read(&address_space_memory, c->sa, buf, MIN(width, 4),
                        MEMTXATTRS_UNSPECIFIED);
        dma_memory_write(&address_space_memory, c->da, buf, MIN(width, 4),
                         MEMTXATTRS_UNSPECIFIED);
        if (((c->ctl >> 8) & 3) != 3) {
            c->sa += width;
        }
        if (((c->ctl >> 10) & 3) != 3) {
            c->da += width;
        }
        if ((p->touten & (1 << n)) && p->reqsel[n / 4]) {
            int psc = n < 8 ? (p->psc >> (4 * n)) : (p->psc2 >> (4 * (n - 8)));
            int cnt = (p->toc[n / 2] >> (16 * (n & 1))) & 0xffff;

            timer_mod(c->to, qemu_clock_get_ns(QEMU_CLOCK_VIRTUAL) +
                      muldiv64((uint64_t)cnt << (8 + (psc & 7)),
                               NANOSECONDS_PER_SECOND, clock_get_hz(p->hclk)));
        }
        if (c->ctl >> 16) {
            c->ctl -= 1 << 16;
            continue;
        }
        /* task complete */
        if (!(c->ctl & (1 << 7))) {
            p->tdsts |= 1 << n;
        }
        if ((c->ctl & 3) == 2) {
            pdma_load(p, c);
        } else {
            c->ctl &= ~3;
            c->loaded = false;
            c->swreq = false;
        }
    }
}

static void pdma_run(void *opaque)
{
    NUC980PDMAState *p = opaque;

    for (int n = 0; n < NUC980_PDMA_CHANNELS; n++) {
        pdma_run_chan(p, n);
    }
    pdma_irq(p);
}

/* Requests come from inside a UART's register access, which must not nest. */
static void pdma_kick(NUC980PDMAState *p)
{
    timer_mod(p->run, qemu_clock_get_ns(QEMU_CLOCK_VIRTUAL));
}

static void pdma_set_request(void *opaque, int n, int level)
{
    NUC980PDMAState *p = opaque;

    p->requests = deposit64(p->requests, n, 1, !!level);
    if (level) {
        pdma_kick(p);
    }
}

static void pdma_timeout(void *opaque)
{
    NUC980PDMAChannel *c = opaque;
    NUC980PDMAState *p = c->p;
    int n = c - p->ch;

    if (p->touten & (1 << n)) {
        p->intsts |= 1 << (8 + n);
        pdma_irq(p);
    }
}

static uint64_t pdma_read(void *opaque, hwaddr a, unsigned size)
{
    NUC980PDMAState *p = opaque;

    if (a < NUC980_PDMA_CHANNELS * 16) {
        NUC980PDMAChannel *c = &p->ch[a / 16];
        switch (a & 15) {
        case 0: return c->ctl;
        case 4: return c->sa;
        case 8: return c->da;
        default: return c->next;
        }
    }
    switch (a) {
    case 0x100 ... 0x124: return p->ch[(a - 0x100) / 4].cur;
    case 0x400: return p->chctl;
    case 0x418: return p->inten;
    case 0x41c: return p->intsts | (p->tdsts & p->inten ? 2 : 0);
    case 0x424: return p->tdsts;
    case 0x430: return p->psc;
    case 0x434: return p->touten;
    case 0x438: return p->toutien;
    case 0x43c: return p->scatba;
    case 0x440 ... 0x450: return p->toc[(a - 0x440) / 4];
    case 0x470: return p->psc2;
    case 0x480 ... 0x48c: return p->reqsel[(a - 0x480) / 4];
    }
    return 0;
}

static void pdma_write(void *opaque, hwaddr a, uint64_t v, unsigned size)
{
    NUC980PDMAState *p = opaque;

    if (a < NUC980_PDMA_CHANNELS * 16) {
        NUC980PDMAChannel *c = &p->ch[a / 16];
        switch (a & 15) {
        case 0:
            c->ctl = v;
            c->loaded = (v & 3) == 1;
            break;
        case 4: c->sa = v; break;
        case 8: c->da = v; break;
        default: c->next = v; break;
        }
    } else {
        switch (a) {
        case 0x400: p->chctl = v; break;
        case 0x404: p->chctl &= ~v; break;          /* PAUSE */
        case 0x408:                                 /* SWREQ */
            for (int n = 0; n < NUC980_PDMA_CHANNELS; n++) {
                p->ch[n].swreq |= (v >> n) & 1;
            }
            break;
        case 0x418: p->inten = v; break;
        case 0x41c: p->intsts &= ~(v & 0x3ff00); break;
        case 0x424: p->tdsts &= ~v; break;
        case 0x430: p->psc = v; break;
        case 0x434:
            for (int n = 0; n < NUC980_PDMA_CHANNELS; n++) {
                if ((p->touten & ~v) & (1 << n)) {
                    timer_del(p->ch[n].to);
                }
            }
            p->touten = v;
            break;
        case 0x438: p->toutien = v; break;
        case 0x43c: p->scatba = v; break;
        case 0x440 ... 0x450: p->toc[(a - 0x440) / 4] = v; break;
        case 0x460:                                 /* CHRST */
            for (int n = 0; n < NUC980_PDMA_CHANNELS; n++) {
                if (v & (1 << n)) {
                    p->ch[n].ctl = 0;
                    p->ch[n].loaded = p->ch[n].swreq = false;
                    p->chctl &= ~(1 << n);
                    timer_del(p->ch[n].to);
                }
            }
            break;
        case 0x470: p->psc2 = v; break;
        case 0x480 ... 0x48c: p->reqsel[(a - 0x480) / 4] = v; break;
        }
    }
    pdma_irq(p);
    pdma_kick(p);
}

static const MemoryRegionOps pdma_ops = {
    .read = pdma_read, .write = pdma_write,
    .endianness = DEVICE_LITTLE_ENDIAN,
    .valid = { .min_access_size = 4, .max_access_size = 4 },
};

static void pdma_reset(DeviceState *dev)
{
    NUC980PDMAState *p = NUC980_PDMA(dev);

    for (int n = 0; n < NUC980_PDMA_CHANNELS; n++) {
        NUC980PDMAChannel *c = &p->ch[n];
        c->ctl = c->sa = c->da = c->next = c->cur = 0;
        c->loaded = c->swreq = false;
        timer_del(c->to);
    }
    p->chctl = p->inten = p->intsts = p->tdsts = 0;
    p->psc = p->psc2 = p->touten = p->toutien = p->scatba = 0;
    memset(p->toc, 0, sizeof(p->toc));
    memset(p->reqsel, 0, sizeof(p->reqsel));
}

static void pdma_init(Object *obj)
{
    NUC980PDMAState *p = NUC980_PDMA(obj);

    memory_region_init_io(&p->iomem, obj, &pdma_ops, p, "nuc980-pdma", 0x1000);
    sysbus_init_mmio(SYS_BUS_DEVICE(obj), &p->iomem);
    sysbus_init_irq(SYS_BUS_DEVICE(obj), &p->irq);
    qdev_init_gpio_in_named(DEVICE(obj), pdma_set_request, "request", 64);
    p->hclk = qdev_init_clock_in(DEVICE(obj), "hclk", NULL, NULL, 0);
    p->run = timer_new_ns(QEMU_CLOCK_VIRTUAL, pdma_run, p);
    for (int n = 0; n < NUC980_PDMA_CHANNELS; n++) {
        p->ch[n].p = p;
        p->ch[n].to = timer_new_ns(QEMU_CLOCK_VIRTUAL, pdma_timeout, &p->ch[n]);
    }
}

static void pdma_class_init(ObjectClass *k, void *data)
{
    DEVICE_CLASS(k)->reset = pdma_reset;
}

static const TypeInfo nuc980_pdma_types[] = {
    {
        .name = TYPE_NUC980_PDMA,
        .parent = TYPE_SYS_BUS_DEVICE,
        .instance_size = sizeof(NUC980PDMAState),
        .instance_init = pdma_init,
        .class_init = pdma_class_init,
    },
};

DEFINE_TYPES(nuc980_pdma_types)
