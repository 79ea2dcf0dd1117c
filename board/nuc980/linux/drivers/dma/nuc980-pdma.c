// SPDX-License-Identifier: GPL-2.0-only
/*
 * Nuvoton NUC980 peripheral DMA
 *
 * Two controllers of ten channels. At each request of its peripheral a channel
 * moves one byte, half word or word. It does so by tasks of four words, which
 * it loads from memory one after the other: a chain, or a ring.
 */

#include <linux/bitfield.h>
#include <linux/clk.h>
#include <linux/dma-mapping.h>
#include <linux/dma/nuc980-pdma.h>
#include <linux/interrupt.h>
#include <linux/iopoll.h>
#include <linux/module.h>
#include <linux/of.h>
#include <linux/platform_device.h>
#include <linux/slab.h>

#include "virt-dma.h"

/* A channel's current task */
#define PDMA_CTL(n)		(16 * (n))
#define PDMA_NEXT(n)		(16 * (n) + 0x0c)
/* Where the current task was loaded from */
#define PDMA_CURSCAT(n)		(0x100 + 4 * (n))
/* A bit for each channel */
#define PDMA_CHCTL		0x400
#define PDMA_PAUSE		0x404
#define PDMA_INTEN		0x418
#define PDMA_INTSTS		0x41c
#define   PDMA_INTSTS_REQTOF		GENMASK(17, 8)
#define PDMA_ABTSTS		0x420
#define PDMA_TDSTS		0x424
#define PDMA_ALIGN		0x428
#define PDMA_TACTSTS		0x42c
#define PDMA_TOUTEN		0x434
#define PDMA_TOUTIEN		0x438
#define PDMA_CHRST		0x460
/* What the address of a next task counts from */
#define PDMA_SCATBA		0x43c
/* Several channels in each */
#define PDMA_TOUTPSC(n)		((n) < 8 ? 0x430 : 0x470)
#define   PDMA_TOUTPSC_SHIFT(n)		((n) % 8 * 4)
#define   PDMA_TOUTPSC_MASK		GENMASK(2, 0)
#define PDMA_TOC(n)		(0x440 + (n) / 2 * 4)
#define   PDMA_TOC_SHIFT(n)		((n) % 2 * 16)
#define   PDMA_TOC_MASK			GENMASK(15, 0)
#define PDMA_REQSEL(n)		(0x480 + (n) / 4 * 4)
#define   PDMA_REQSEL_SHIFT(n)		((n) % 4 * 8)
#define   PDMA_REQSEL_MASK		GENMASK(6, 0)

#define TASK_MODE		GENMASK(1, 0)
#define   TASK_MODE_IDLE		0
#define   TASK_MODE_LAST		1
#define   TASK_MODE_MORE		2
#define TASK_SINGLE		BIT(2)
#define TASK_SRC_FIXED		GENMASK(9, 8)
#define TASK_DST_FIXED		GENMASK(11, 10)
#define TASK_WIDTH		GENMASK(13, 12)
#define TASK_COUNT		GENMASK(31, 16)

#define PDMA_BLOCKS		2
#define PDMA_BLOCK_SIZE		0x1000
#define PDMA_CHANNELS		10
#define PDMA_ALL		GENMASK(PDMA_CHANNELS - 1, 0)
#define PDMA_TASKS		32
#define PDMA_TASK_COUNT		65536
#define PDMA_STOP_US		100

struct nuc980_pdma_task {
	__le32 ctl;
	__le32 src;
	__le32 dst;
	__le32 next;
};

/**
 * struct nuc980_pdma_desc - a transfer
 * @vd: its virtual descriptor
 * @direction: DMA_MEM_TO_DEV or DMA_DEV_TO_MEM
 * @device: bus address of the peripheral's register
 * @ctl: what the control words of all tasks have in common
 * @cyclic: the tasks are a ring
 * @count: number of tasks, at most PDMA_TASKS
 * @tasks: what start copies to the channel's table
 */
struct nuc980_pdma_desc {
	struct virt_dma_desc vd;
	enum dma_transfer_direction direction;
	dma_addr_t device;
	u32 ctl;
	bool cyclic;
	unsigned int count;
	struct nuc980_pdma_task tasks[];
};

/**
 * struct nuc980_pdma_chan - a channel
 * @vc: its virtual channel, whose lock protects what follows @table_dma
 * @block: the controller it belongs to
 * @number: which of the controller's channels it is
 * @table: the tasks that the hardware loads
 * @table_dma: the same, bus address
 * @request: number of the peripheral's request line
 * @config: what the next transfer is prepared with
 * @timeout: the request time-out is in use
 * @desc: the transfer that runs
 */
struct nuc980_pdma_chan {
	struct virt_dma_chan vc;
	struct nuc980_pdma_block *block;
	unsigned int number;
	struct nuc980_pdma_task *table;
	dma_addr_t table_dma;
	u32 request;
	struct dma_slave_config config;
	bool timeout;
	struct nuc980_pdma_desc *desc;
};

/**
 * struct nuc980_pdma_block - a controller
 * @dev: the device of both
 * @base: its registers
 * @hclk: what the time-outs count, Hz
 * @lock: below the lock of a channel
 * @irq: its interrupt
 * @chans: its channels
 */
struct nuc980_pdma_block {
	struct device *dev;
	void __iomem *base;
	unsigned long hclk;
	/* protects the registers that several channels share */
	spinlock_t lock;
	int irq;
	struct nuc980_pdma_chan chans[PDMA_CHANNELS];
};

struct nuc980_pdma {
	struct dma_device dma;
	struct nuc980_pdma_block blocks[PDMA_BLOCKS];
};

static struct nuc980_pdma_chan *to_nuc980_chan(struct dma_chan *chan)
{
	return container_of(chan, struct nuc980_pdma_chan, vc.chan);
}

static struct nuc980_pdma_desc *to_nuc980_desc(struct virt_dma_desc *vd)
{
	return container_of(vd, struct nuc980_pdma_desc, vd);
}

static u32 nuc980_pdma_read(struct nuc980_pdma_chan *chan, unsigned int offset)
{
	return readl(chan->block->base + offset);
}

static void nuc980_pdma_write(struct nuc980_pdma_chan *chan,
			      unsigned int offset, u32 value)
{
	writel(value, chan->block->base + offset);
}

/* For the registers that channels share, with the controller's lock held */
static void nuc980_pdma_change(struct nuc980_pdma_chan *chan,
			       unsigned int offset, u32 mask, u32 value)
{
	u32 old = nuc980_pdma_read(chan, offset);

	nuc980_pdma_write(chan, offset, (old & ~mask) | value);
}

/*
 * The counter starts with the next request that is served. So what came before
 * this must be asked for after it.
 */
static void nuc980_pdma_rearm(struct nuc980_pdma_chan *chan)
{
	u32 bit = BIT(chan->number);

	nuc980_pdma_change(chan, PDMA_TOUTEN, bit, 0);
	nuc980_pdma_write(chan, PDMA_INTSTS,
			  FIELD_PREP(PDMA_INTSTS_REQTOF, bit));
	if (chan->timeout)
		nuc980_pdma_change(chan, PDMA_TOUTEN, bit, bit);
}

static void nuc980_pdma_set_timeout(struct nuc980_pdma_chan *chan,
				    u32 timeout_ns)
{
	struct nuc980_pdma_block *block = chan->block;
	unsigned int n = chan->number, prescale = 0;
	u64 cycles = DIV_ROUND_UP_ULL((u64)timeout_ns * block->hclk,
				      NSEC_PER_SEC);
	u32 ticks = cycles / 256 + 1;
	unsigned long flags;

	while (ticks > PDMA_TOC_MASK) {
		ticks = DIV_ROUND_UP(ticks, 2);
		prescale++;
	}
	chan->timeout = timeout_ns;
	spin_lock_irqsave(&block->lock, flags);
	nuc980_pdma_change(chan, PDMA_TOUTPSC(n),
			   PDMA_TOUTPSC_MASK << PDMA_TOUTPSC_SHIFT(n),
			   prescale << PDMA_TOUTPSC_SHIFT(n));
	nuc980_pdma_change(chan, PDMA_TOC(n),
			   PDMA_TOC_MASK << PDMA_TOC_SHIFT(n),
			   ticks << PDMA_TOC_SHIFT(n));
	nuc980_pdma_rearm(chan);
	spin_unlock_irqrestore(&block->lock, flags);
}

static void nuc980_pdma_enable(struct nuc980_pdma_chan *chan)
{
	unsigned int n = chan->number;
	unsigned long flags;

	spin_lock_irqsave(&chan->block->lock, flags);
	nuc980_pdma_change(chan, PDMA_REQSEL(n),
			   PDMA_REQSEL_MASK << PDMA_REQSEL_SHIFT(n),
			   chan->request << PDMA_REQSEL_SHIFT(n));
	nuc980_pdma_change(chan, PDMA_CHCTL, BIT(n), BIT(n));
	nuc980_pdma_rearm(chan);
	spin_unlock_irqrestore(&chan->block->lock, flags);
}

static void nuc980_pdma_start_next(struct nuc980_pdma_chan *chan)
{
	struct virt_dma_desc *vd = vchan_next_desc(&chan->vc);

	if (!vd) {
		chan->desc = NULL;
		return;
	}
	list_del(&vd->node);
	chan->desc = to_nuc980_desc(vd);
	memcpy(chan->table, chan->desc->tasks,
	       chan->desc->count * sizeof(*chan->table));
	nuc980_pdma_enable(chan);
	nuc980_pdma_write(chan, PDMA_NEXT(chan->number), chan->table_dma);
	nuc980_pdma_write(chan, PDMA_CTL(chan->number), TASK_MODE_MORE);
}

/* Nothing of what ran is left behind, its events neither */
static void nuc980_pdma_stop(struct nuc980_pdma_chan *chan)
{
	u32 bit = BIT(chan->number), active;
	unsigned long flags;

	nuc980_pdma_write(chan, PDMA_PAUSE, bit);
	readl_poll_timeout_atomic(chan->block->base + PDMA_TACTSTS, active,
				  !(active & bit), 1, PDMA_STOP_US);
	spin_lock_irqsave(&chan->block->lock, flags);
	nuc980_pdma_write(chan, PDMA_CHRST, bit);
	nuc980_pdma_change(chan, PDMA_TOUTEN, bit, 0);
	spin_unlock_irqrestore(&chan->block->lock, flags);
	nuc980_pdma_write(chan, PDMA_TDSTS, bit);
	nuc980_pdma_write(chan, PDMA_ABTSTS, bit);
	nuc980_pdma_write(chan, PDMA_ALIGN, bit);
	nuc980_pdma_write(chan, PDMA_INTSTS,
			  FIELD_PREP(PDMA_INTSTS_REQTOF, bit));
}

static void nuc980_pdma_done(struct nuc980_pdma_chan *chan)
{
	u32 ctl = nuc980_pdma_read(chan, PDMA_CTL(chan->number));

	if (chan->desc->cyclic) {
		vchan_cyclic_callback(&chan->desc->vd);
	} else if (FIELD_GET(TASK_MODE, ctl) == TASK_MODE_IDLE) {
		vchan_cookie_complete(&chan->desc->vd);
		nuc980_pdma_start_next(chan);
	}
}

static void nuc980_pdma_failed(struct nuc980_pdma_chan *chan)
{
	nuc980_pdma_stop(chan);
	chan->vc.cyclic = NULL;
	chan->desc->vd.tx_result.result = DMA_TRANS_ABORTED;
	vchan_cookie_complete(&chan->desc->vd);
	nuc980_pdma_start_next(chan);
}

/* The ring runs on: only the callback learns how far it is */
static void nuc980_pdma_late(struct nuc980_pdma_chan *chan)
{
	spin_lock(&chan->block->lock);
	nuc980_pdma_rearm(chan);
	spin_unlock(&chan->block->lock);
	if (chan->desc->cyclic)
		vchan_cyclic_callback(&chan->desc->vd);
}

/* The events of a channel are read under its lock: stop removes them under it */
static void nuc980_pdma_serve(struct nuc980_pdma_chan *chan)
{
	u32 bit = BIT(chan->number), done, failed, late;

	spin_lock(&chan->vc.lock);
	late = FIELD_GET(PDMA_INTSTS_REQTOF,
			 nuc980_pdma_read(chan, PDMA_INTSTS));
	done = nuc980_pdma_read(chan, PDMA_TDSTS);
	failed = nuc980_pdma_read(chan, PDMA_ABTSTS) |
		 nuc980_pdma_read(chan, PDMA_ALIGN);
	if (!chan->desc)
		nuc980_pdma_stop(chan);
	if (chan->desc && late & bit)
		nuc980_pdma_late(chan);
	if (chan->desc && done & bit) {
		nuc980_pdma_write(chan, PDMA_TDSTS, bit);
		nuc980_pdma_done(chan);
	}
	if (chan->desc && failed & bit)
		nuc980_pdma_failed(chan);
	spin_unlock(&chan->vc.lock);
}

static irqreturn_t nuc980_pdma_interrupt(int irq, void *data)
{
	struct nuc980_pdma_block *block = data;
	u32 failed = readl(block->base + PDMA_ABTSTS) |
		     readl(block->base + PDMA_ALIGN);
	unsigned long events = failed | readl(block->base + PDMA_TDSTS) |
			       FIELD_GET(PDMA_INTSTS_REQTOF,
					 readl(block->base + PDMA_INTSTS));
	unsigned int n;

	for_each_set_bit(n, &events, PDMA_CHANNELS)
		nuc980_pdma_serve(&block->chans[n]);
	if (failed)
		dev_err_ratelimited(block->dev, "bus error, channels %#x\n",
				    failed);
	return IRQ_RETVAL(events);
}

static size_t nuc980_pdma_task_bytes(u32 ctl)
{
	return (FIELD_GET(TASK_COUNT, ctl) + 1) << FIELD_GET(TASK_WIDTH, ctl);
}

static size_t nuc980_pdma_bytes(struct nuc980_pdma_desc *desc,
				unsigned int first)
{
	size_t bytes = 0;
	unsigned int i;

	for (i = first; i < desc->count; i++)
		bytes += nuc980_pdma_task_bytes(le32_to_cpu(desc->tasks[i].ctl));
	return bytes;
}

static size_t nuc980_pdma_residue(struct nuc980_pdma_chan *chan)
{
	unsigned int n = chan->number;
	u32 ctl, from;

	/* Both change when a task is loaded: two equal looks */
	do {
		from = nuc980_pdma_read(chan, PDMA_CURSCAT(n));
		ctl = nuc980_pdma_read(chan, PDMA_CTL(n));
	} while (from != nuc980_pdma_read(chan, PDMA_CURSCAT(n)) ||
		 ctl != nuc980_pdma_read(chan, PDMA_CTL(n)));

	if (FIELD_GET(TASK_MODE, ctl) == TASK_MODE_IDLE)
		return 0;
	/* The first task is loaded with the first request */
	if (!(ctl & TASK_SINGLE))
		return nuc980_pdma_bytes(chan->desc, 0);
	return nuc980_pdma_task_bytes(ctl) +
	       nuc980_pdma_bytes(chan->desc, (from - chan->table_dma) /
				 sizeof(*chan->table) + 1);
}

static enum dma_status nuc980_pdma_tx_status(struct dma_chan *dma_chan,
					     dma_cookie_t cookie,
					     struct dma_tx_state *state)
{
	struct nuc980_pdma_chan *chan = to_nuc980_chan(dma_chan);
	enum dma_status status = dma_cookie_status(dma_chan, cookie, state);
	struct virt_dma_desc *vd;
	unsigned long flags;

	if (status == DMA_COMPLETE || !state)
		return status;

	spin_lock_irqsave(&chan->vc.lock, flags);
	vd = vchan_find_desc(&chan->vc, cookie);
	if (vd)
		dma_set_residue(state, nuc980_pdma_bytes(to_nuc980_desc(vd), 0));
	else if (chan->desc && chan->desc->vd.tx.cookie == cookie)
		dma_set_residue(state, nuc980_pdma_residue(chan));
	spin_unlock_irqrestore(&chan->vc.lock, flags);
	return status;
}

static struct nuc980_pdma_desc *
nuc980_pdma_new_desc(struct nuc980_pdma_chan *chan,
		     enum dma_transfer_direction direction, size_t count)
{
	bool to_device = direction == DMA_MEM_TO_DEV;
	enum dma_slave_buswidth width = to_device ? chan->config.dst_addr_width :
						    chan->config.src_addr_width;
	struct nuc980_pdma_desc *desc;

	if (!is_slave_direction(direction) || !width || count > PDMA_TASKS)
		return NULL;
	desc = kzalloc(struct_size(desc, tasks, count), GFP_NOWAIT);
	if (!desc)
		return NULL;
	desc->direction = direction;
	desc->device = to_device ? chan->config.dst_addr : chan->config.src_addr;
	desc->ctl = TASK_SINGLE | (to_device ? TASK_DST_FIXED : TASK_SRC_FIXED) |
		    FIELD_PREP(TASK_MODE, TASK_MODE_MORE) |
		    FIELD_PREP(TASK_WIDTH, ilog2(width));
	return desc;
}

/* False where the memory is none that a task can have */
static bool nuc980_pdma_add_task(struct nuc980_pdma_chan *chan,
				 struct nuc980_pdma_desc *desc,
				 dma_addr_t memory, size_t bytes)
{
	bool to_device = desc->direction == DMA_MEM_TO_DEV;
	unsigned int shift = FIELD_GET(TASK_WIDTH, desc->ctl);
	unsigned int n = desc->count;
	struct nuc980_pdma_task *task = &desc->tasks[n];

	if (!bytes || bytes >> shift > PDMA_TASK_COUNT ||
	    !IS_ALIGNED(memory | bytes, 1 << shift))
		return false;
	task->ctl = cpu_to_le32(desc->ctl |
				FIELD_PREP(TASK_COUNT, (bytes >> shift) - 1));
	task->src = cpu_to_le32(to_device ? memory : desc->device);
	task->dst = cpu_to_le32(to_device ? desc->device : memory);
	task->next = cpu_to_le32(chan->table_dma + (n + 1) * sizeof(*task));
	desc->count++;
	return true;
}

static struct dma_async_tx_descriptor *
nuc980_pdma_prep_slave_sg(struct dma_chan *dma_chan, struct scatterlist *sgl,
			  unsigned int sg_len,
			  enum dma_transfer_direction direction,
			  unsigned long flags, void *context)
{
	struct nuc980_pdma_chan *chan = to_nuc980_chan(dma_chan);
	struct nuc980_pdma_desc *desc;
	struct scatterlist *sg;
	unsigned int i;

	desc = nuc980_pdma_new_desc(chan, direction, sg_len);
	if (!desc)
		return NULL;
	for_each_sg(sgl, sg, sg_len, i) {
		if (!nuc980_pdma_add_task(chan, desc, sg_dma_address(sg),
					  sg_dma_len(sg))) {
			kfree(desc);
			return NULL;
		}
	}
	le32p_replace_bits(&desc->tasks[desc->count - 1].ctl, TASK_MODE_LAST,
			   TASK_MODE);
	return vchan_tx_prep(&chan->vc, &desc->vd, flags);
}

static struct dma_async_tx_descriptor *
nuc980_pdma_prep_dma_cyclic(struct dma_chan *dma_chan, dma_addr_t memory,
			    size_t bytes, size_t period,
			    enum dma_transfer_direction direction,
			    unsigned long flags)
{
	struct nuc980_pdma_chan *chan = to_nuc980_chan(dma_chan);
	struct nuc980_pdma_desc *desc;
	size_t at;

	if (!period || !bytes || bytes % period)
		return NULL;
	desc = nuc980_pdma_new_desc(chan, direction, bytes / period);
	if (!desc)
		return NULL;
	for (at = 0; at < bytes; at += period) {
		if (!nuc980_pdma_add_task(chan, desc, memory + at, period)) {
			kfree(desc);
			return NULL;
		}
	}
	desc->tasks[desc->count - 1].next = cpu_to_le32(chan->table_dma);
	desc->cyclic = true;
	return vchan_tx_prep(&chan->vc, &desc->vd, flags);
}

static int nuc980_pdma_config(struct dma_chan *dma_chan,
			      struct dma_slave_config *config)
{
	struct nuc980_pdma_chan *chan = to_nuc980_chan(dma_chan);
	const struct nuc980_pdma_config *own = config->peripheral_config;
	unsigned long flags;

	if (own && config->peripheral_size != sizeof(*own))
		return -EINVAL;

	spin_lock_irqsave(&chan->vc.lock, flags);
	chan->config = *config;
	if (own) {
		nuc980_pdma_set_timeout(chan, own->timeout_ns);
		if (chan->desc && chan->desc->cyclic)
			vchan_cyclic_callback(&chan->desc->vd);
	}
	spin_unlock_irqrestore(&chan->vc.lock, flags);
	return 0;
}

static void nuc980_pdma_issue_pending(struct dma_chan *dma_chan)
{
	struct nuc980_pdma_chan *chan = to_nuc980_chan(dma_chan);
	unsigned long flags;

	spin_lock_irqsave(&chan->vc.lock, flags);
	if (vchan_issue_pending(&chan->vc) && !chan->desc)
		nuc980_pdma_start_next(chan);
	spin_unlock_irqrestore(&chan->vc.lock, flags);
}

static int nuc980_pdma_terminate_all(struct dma_chan *dma_chan)
{
	struct nuc980_pdma_chan *chan = to_nuc980_chan(dma_chan);
	unsigned long flags;
	LIST_HEAD(head);

	spin_lock_irqsave(&chan->vc.lock, flags);
	if (chan->desc) {
		nuc980_pdma_stop(chan);
		vchan_terminate_vdesc(&chan->desc->vd);
		chan->desc = NULL;
	}
	vchan_get_all_descriptors(&chan->vc, &head);
	spin_unlock_irqrestore(&chan->vc.lock, flags);
	vchan_dma_desc_free_list(&chan->vc, &head);
	return 0;
}

static void nuc980_pdma_synchronize(struct dma_chan *dma_chan)
{
	vchan_synchronize(&to_nuc980_chan(dma_chan)->vc);
}

static void nuc980_pdma_free_chan_resources(struct dma_chan *dma_chan)
{
	struct nuc980_pdma_chan *chan = to_nuc980_chan(dma_chan);

	vchan_free_chan_resources(&chan->vc);
	chan->timeout = false;
}

static void nuc980_pdma_free_desc(struct virt_dma_desc *vd)
{
	kfree(to_nuc980_desc(vd));
}

static bool nuc980_pdma_filter(struct dma_chan *dma_chan, void *request)
{
	to_nuc980_chan(dma_chan)->request = (uintptr_t)request;
	return true;
}

/* The device trees name no channels */
static const struct dma_slave_map nuc980_pdma_map[] = {
	{ "b0070000.serial", "tx", (void *)4 },
	{ "b0070000.serial", "rx", (void *)5 },
	{ "b0071000.serial", "tx", (void *)6 },
	{ "b0071000.serial", "rx", (void *)7 },
	{ "b0072000.serial", "tx", (void *)8 },
	{ "b0072000.serial", "rx", (void *)9 },
	{ "b0073000.serial", "tx", (void *)10 },
	{ "b0073000.serial", "rx", (void *)11 },
	{ "b0074000.serial", "tx", (void *)12 },
	{ "b0074000.serial", "rx", (void *)13 },
	{ "b0075000.serial", "tx", (void *)14 },
	{ "b0075000.serial", "rx", (void *)15 },
	{ "b0076000.serial", "tx", (void *)16 },
	{ "b0076000.serial", "rx", (void *)17 },
	{ "b0077000.serial", "tx", (void *)18 },
	{ "b0077000.serial", "rx", (void *)19 },
	{ "b0078000.serial", "tx", (void *)26 },
	{ "b0078000.serial", "rx", (void *)27 },
	{ "b0079000.serial", "tx", (void *)28 },
	{ "b0079000.serial", "rx", (void *)29 },
};

static void nuc980_pdma_init_dma(struct dma_device *dma, struct device *dev)
{
	dma->dev = dev;
	dma->directions = BIT(DMA_MEM_TO_DEV) | BIT(DMA_DEV_TO_MEM);
	dma->src_addr_widths = BIT(DMA_SLAVE_BUSWIDTH_1_BYTE) |
			       BIT(DMA_SLAVE_BUSWIDTH_2_BYTES) |
			       BIT(DMA_SLAVE_BUSWIDTH_4_BYTES);
	dma->dst_addr_widths = dma->src_addr_widths;
	dma->residue_granularity = DMA_RESIDUE_GRANULARITY_BURST;
	dma->max_sg_burst = PDMA_TASKS;
	dma->device_free_chan_resources = nuc980_pdma_free_chan_resources;
	dma->device_config = nuc980_pdma_config;
	dma->device_prep_slave_sg = nuc980_pdma_prep_slave_sg;
	dma->device_prep_dma_cyclic = nuc980_pdma_prep_dma_cyclic;
	dma->device_issue_pending = nuc980_pdma_issue_pending;
	dma->device_tx_status = nuc980_pdma_tx_status;
	dma->device_terminate_all = nuc980_pdma_terminate_all;
	dma->device_synchronize = nuc980_pdma_synchronize;
	dma->filter.fn = nuc980_pdma_filter;
	dma->filter.map = nuc980_pdma_map;
	dma->filter.mapcnt = ARRAY_SIZE(nuc980_pdma_map);
	dma_cap_set(DMA_SLAVE, dma->cap_mask);
	dma_cap_set(DMA_CYCLIC, dma->cap_mask);
	dma_cap_set(DMA_PRIVATE, dma->cap_mask);
	INIT_LIST_HEAD(&dma->channels);
}

static int nuc980_pdma_init_block(struct platform_device *pdev,
				  struct nuc980_pdma_block *block,
				  unsigned int number)
{
	struct device *dev = block->dev;
	struct clk *clk;

	clk = devm_clk_get_enabled(dev, number ? "pdma1" : NULL);
	if (IS_ERR(clk))
		return dev_err_probe(dev, PTR_ERR(clk), "no clock %u\n", number);
	block->hclk = clk_get_rate(clk);
	spin_lock_init(&block->lock);

	writel(PDMA_ALL, block->base + PDMA_CHRST);
	writel(0, block->base + PDMA_TOUTEN);
	writel(PDMA_ALL, block->base + PDMA_TDSTS);
	writel(PDMA_ALL, block->base + PDMA_ABTSTS);
	writel(PDMA_ALL, block->base + PDMA_ALIGN);
	writel(PDMA_INTSTS_REQTOF, block->base + PDMA_INTSTS);
	writel(0, block->base + PDMA_SCATBA);
	writel(PDMA_ALL, block->base + PDMA_INTEN);
	writel(PDMA_ALL, block->base + PDMA_TOUTIEN);

	block->irq = platform_get_irq(pdev, number);
	if (block->irq < 0)
		return block->irq;
	return devm_request_irq(dev, block->irq, nuc980_pdma_interrupt, 0,
				dev_name(dev), block);
}

static void nuc980_pdma_init_chan(struct nuc980_pdma *pdma, unsigned int i,
				  struct nuc980_pdma_task *tables,
				  dma_addr_t tables_dma)
{
	/* Both controllers share the load */
	struct nuc980_pdma_block *block = &pdma->blocks[i % PDMA_BLOCKS];
	struct nuc980_pdma_chan *chan = &block->chans[i / PDMA_BLOCKS];

	chan->block = block;
	chan->number = i / PDMA_BLOCKS;
	chan->table = tables + i * PDMA_TASKS;
	chan->table_dma = tables_dma + i * PDMA_TASKS * sizeof(*tables);
	chan->vc.desc_free = nuc980_pdma_free_desc;
	vchan_init(&chan->vc, &pdma->dma);
}

static int nuc980_pdma_probe(struct platform_device *pdev)
{
	struct device *dev = &pdev->dev;
	struct nuc980_pdma_task *tables;
	struct nuc980_pdma *pdma;
	dma_addr_t tables_dma;
	void __iomem *base;
	unsigned int i;
	int ret;

	pdma = devm_kzalloc(dev, sizeof(*pdma), GFP_KERNEL);
	if (!pdma)
		return -ENOMEM;
	base = devm_platform_ioremap_resource(pdev, 0);
	if (IS_ERR(base))
		return PTR_ERR(base);
	tables = dmam_alloc_coherent(dev, PDMA_BLOCKS * PDMA_CHANNELS *
				     PDMA_TASKS * sizeof(*tables), &tables_dma,
				     GFP_KERNEL);
	if (!tables)
		return -ENOMEM;

	nuc980_pdma_init_dma(&pdma->dma, dev);
	for (i = 0; i < PDMA_BLOCKS * PDMA_CHANNELS; i++)
		nuc980_pdma_init_chan(pdma, i, tables, tables_dma);
	for (i = 0; i < PDMA_BLOCKS; i++) {
		pdma->blocks[i].dev = dev;
		pdma->blocks[i].base = base + i * PDMA_BLOCK_SIZE;
		ret = nuc980_pdma_init_block(pdev, &pdma->blocks[i], i);
		if (ret)
			return ret;
	}
	platform_set_drvdata(pdev, pdma);
	return dma_async_device_register(&pdma->dma);
}

static int nuc980_pdma_remove(struct platform_device *pdev)
{
	struct nuc980_pdma *pdma = platform_get_drvdata(pdev);
	struct nuc980_pdma_chan *chan;

	dma_async_device_unregister(&pdma->dma);
	devm_free_irq(&pdev->dev, pdma->blocks[0].irq, &pdma->blocks[0]);
	devm_free_irq(&pdev->dev, pdma->blocks[1].irq, &pdma->blocks[1]);
	list_for_each_entry(chan, &pdma->dma.channels, vc.chan.device_node)
		tasklet_kill(&chan->vc.task);
	return 0;
}

static const struct of_device_id nuc980_pdma_of_match[] = {
	{ .compatible = "nuvoton,nuc980-dma" },
	{ }
};
MODULE_DEVICE_TABLE(of, nuc980_pdma_of_match);

static struct platform_driver nuc980_pdma_driver = {
	.probe = nuc980_pdma_probe,
	.remove = nuc980_pdma_remove,
	.driver = {
		.name = "nuc980-pdma",
		.of_match_table = nuc980_pdma_of_match,
	},
};
module_platform_driver(nuc980_pdma_driver);

MODULE_DESCRIPTION("Nuvoton NUC980 peripheral DMA");
MODULE_AUTHOR("The OpenRTU authors");
MODULE_LICENSE("GPL");
