// SPDX-License-Identifier: GPL-2.0-only
/*
 * Nuvoton NUC980 flash memory interface (FMI) with a raw NAND flash
 *
 * Pages go by DMA through the BCH engine: 8 bits in each step of 512 bytes,
 * the steps' 15 bytes of parity at the end of the spare area. Its bytes 2 and
 * 3 are 0 where a page has been written: the parity of an erased page is not
 * all ones, so that one must be known before it is read. All this is as the
 * vendor's boot loader and kernel have it.
 */

#include <linux/bitfield.h>
#include <linux/bitops.h>
#include <linux/clk.h>
#include <linux/completion.h>
#include <linux/delay.h>
#include <linux/dma-mapping.h>
#include <linux/interrupt.h>
#include <linux/io.h>
#include <linux/iopoll.h>
#include <linux/ktime.h>
#include <linux/log2.h>
#include <linux/module.h>
#include <linux/mtd/mtd.h>
#include <linux/mtd/rawnand.h>
#include <linux/of.h>
#include <linux/platform_device.h>
#include <linux/sizes.h>
#include <linux/slab.h>

#define FMI_DMACTL	0x400
#define FMI_DMASA	0x408
#define FMI_CTL		0x800
#define NAND_CTL	0x8a0
#define NAND_TMCTL	0x8a4
#define NAND_INTEN	0x8a8
#define NAND_INTSTS	0x8ac
#define NAND_CMD	0x8b0
#define NAND_ADDR	0x8b4
#define NAND_DATA	0x8b8
#define NAND_RACTL	0x8bc
#define NAND_ECTL	0x8c0
#define NAND_ECCES(i)	(0x8d0 + 4 * (i))	/* status of four steps */
#define NAND_ECCEA(i)	(0x900 + 4 * (i))	/* addresses of two errors */
#define NAND_ECCED(i)	(0x960 + 4 * (i))	/* wrong bits of four errors */
#define NAND_RA		0xa00			/* spare area */

#define FMI_DMACTL_EN		BIT(0)
#define FMI_DMACTL_RST		BIT(1)
#define FMI_CTL_NAND		BIT(3)
#define NAND_CTL_RST		BIT(0)
#define NAND_CTL_DMA_READ	BIT(1)
#define NAND_CTL_DMA_WRITE	BIT(2)
#define NAND_CTL_SPARE_WRITE	BIT(4)	/* the spare area follows the data */
#define NAND_CTL_PROTECT3	BIT(8)	/* parity covers spare bytes 0 to 2 */
#define NAND_CTL_PAGE		GENMASK(17, 16)	/* 1: 2 KiB, 2: 4 KiB, 3: 8 KiB */
#define NAND_CTL_BCH_T8		BIT(20)
#define NAND_CTL_ECC		BIT(23)
#define NAND_CTL_CS0		BIT(25)	/* low: selected */
#define NAND_CTL_CS1		BIT(26)
#define NAND_INT_DMA		BIT(0)
#define NAND_INT_ECC		BIT(2)
#define NAND_INT_READY		BIT(10)	/* busy no longer */
#define NAND_ADDR_LAST		BIT(31)
#define NAND_ECTL_UNPROTECT	BIT(0)
#define NAND_ECCES_STATUS	GENMASK(1, 0)
#define NAND_ECCES_COUNT	GENMASK(6, 2)
#define NAND_ECCEA_MASK		GENMASK(10, 0)

#define STEP_OK			0
#define STEP_CORRECTABLE	1

/* As the vendor's boot loader has it for all boards */
#define NAND_TMCTL_VENDOR	0x20305

#define STEP_SIZE		512
#define STEP_PARITY		15
#define STEP_STRENGTH		8
#define MAX_STEPS		(SZ_8K / STEP_SIZE)

/* The spare bytes that are 0 where a page has been written */
#define WRITTEN_AT		2
#define WRITTEN_SIZE		2

/* 2 KiB take 0.2 ms; more is for a thread of the interrupt that must wait. */
#define DMA_TIMEOUT_MS		1000
#define RESET_TIMEOUT_US	1000
/* A flash has a page at hand in 25 us: a thread of the interrupt takes longer. */
#define READ_US			30
/* Of what no interrupt has told in time */
#define POLL_US			100

/* What to change in a page once the DMA no longer writes to it */
struct correction {
	u16 offset;
	u8 bits;
};

struct page_errors {
	u32 done;		/* one bit a step */
	unsigned int bitflips;	/* in all */
	unsigned int max_bitflips;	/* in one step */
	unsigned int corrections;
	struct correction correction[MAX_STEPS * STEP_STRENGTH];
};

struct nuc980_nand {
	struct nand_controller controller;
	struct nand_chip chip;
	struct device *dev;
	void __iomem *base;
	int irq;
	struct completion event;
	u32 ctl;		/* NAND_CTL while the chip is selected */
	struct page_errors errors;
};

static struct nuc980_nand *to_nuc980(struct nand_chip *chip)
{
	return container_of(chip, struct nuc980_nand, chip);
}

static void nuc980_nand_select(struct nuc980_nand *nand)
{
	writel(nand->ctl, nand->base + NAND_CTL);
}

static void nuc980_nand_deselect(struct nuc980_nand *nand)
{
	writel(nand->ctl | NAND_CTL_CS0, nand->base + NAND_CTL);
}

/* The flags stay for who waits for them. */
static irqreturn_t nuc980_nand_irq(int irq, void *data)
{
	struct nuc980_nand *nand = data;

	if (!(readl(nand->base + NAND_INTSTS) & readl(nand->base + NAND_INTEN)))
		return IRQ_NONE;

	writel(0, nand->base + NAND_INTEN);
	complete(&nand->event);

	return IRQ_HANDLED;
}

/*
 * Where ticks are late, as on an emulated board, a completion's time counts
 * from the last one and may end at once. What is left by the clock is polled.
 */
static int nuc980_nand_wait(struct nuc980_nand *nand, u32 flags,
			    unsigned int timeout_ms)
{
	ktime_t end = ktime_add_ms(ktime_get(), timeout_ms);
	u32 status;
	s64 left_us;

	reinit_completion(&nand->event);
	writel(flags, nand->base + NAND_INTEN);
	if (!wait_for_completion_timeout(&nand->event,
					 msecs_to_jiffies(timeout_ms))) {
		writel(0, nand->base + NAND_INTEN);
		synchronize_irq(nand->irq);
	}

	left_us = ktime_us_delta(end, ktime_get());
	return readl_poll_timeout(nand->base + NAND_INTSTS, status,
				  status & flags, POLL_US, max(left_us, 1LL));
}

static int nuc980_nand_wait_ready(struct nuc980_nand *nand,
				  unsigned int timeout_ms)
{
	u32 status;

	if (!readl_poll_timeout_atomic(nand->base + NAND_INTSTS, status,
				       status & NAND_INT_READY, 1, READ_US))
		return 0;

	return nuc980_nand_wait(nand, NAND_INT_READY, timeout_ms);
}

static int nuc980_nand_reset(struct nuc980_nand *nand)
{
	u32 ctl;
	int ret;

	writel(FMI_DMACTL_EN | FMI_DMACTL_RST, nand->base + FMI_DMACTL);
	ret = readl_poll_timeout(nand->base + FMI_DMACTL, ctl,
				 !(ctl & FMI_DMACTL_RST), 1, RESET_TIMEOUT_US);
	if (ret)
		return ret;

	writel(nand->ctl | NAND_CTL_CS0 | NAND_CTL_RST, nand->base + NAND_CTL);
	return readl_poll_timeout(nand->base + NAND_CTL, ctl,
				  !(ctl & NAND_CTL_RST), 1, RESET_TIMEOUT_US);
}

static void nuc980_nand_send_addresses(struct nuc980_nand *nand,
				       const u8 *addresses, unsigned int count)
{
	unsigned int i;

	for (i = 0; i < count; i++)
		writel(addresses[i] | (i == count - 1 ? NAND_ADDR_LAST : 0),
		       nand->base + NAND_ADDR);
}

static void nuc980_nand_read_data(struct nuc980_nand *nand, u8 *buf,
				  unsigned int len)
{
	while (len--)
		*buf++ = readl(nand->base + NAND_DATA);
}

static void nuc980_nand_write_data(struct nuc980_nand *nand, const u8 *buf,
				   unsigned int len)
{
	while (len--)
		writel(*buf++, nand->base + NAND_DATA);
}

static int nuc980_nand_exec_instr(struct nuc980_nand *nand,
				  const struct nand_op_instr *instr)
{
	switch (instr->type) {
	case NAND_OP_CMD_INSTR:
		/* What is waited for is that the flash is ready after this. */
		writel(NAND_INT_READY, nand->base + NAND_INTSTS);
		writel(instr->ctx.cmd.opcode, nand->base + NAND_CMD);
		return 0;
	case NAND_OP_ADDR_INSTR:
		nuc980_nand_send_addresses(nand, instr->ctx.addr.addrs,
					   instr->ctx.addr.naddrs);
		return 0;
	case NAND_OP_DATA_IN_INSTR:
		nuc980_nand_read_data(nand, instr->ctx.data.buf.in,
				      instr->ctx.data.len);
		return 0;
	case NAND_OP_DATA_OUT_INSTR:
		nuc980_nand_write_data(nand, instr->ctx.data.buf.out,
				       instr->ctx.data.len);
		return 0;
	case NAND_OP_WAITRDY_INSTR:
		return nuc980_nand_wait_ready(nand,
					      instr->ctx.waitrdy.timeout_ms);
	}

	return -EINVAL;
}

static int nuc980_nand_exec_op(struct nand_chip *chip,
			       const struct nand_operation *op, bool check_only)
{
	struct nuc980_nand *nand = to_nuc980(chip);
	unsigned int i;
	int ret = 0;

	if (check_only)
		return 0;

	nuc980_nand_select(nand);
	for (i = 0; i < op->ninstrs && !ret; i++) {
		ret = nuc980_nand_exec_instr(nand, &op->instrs[i]);
		ndelay(op->instrs[i].delay_ns);
	}
	nuc980_nand_deselect(nand);

	return ret;
}

/* Of the wrong bytes only those of the data are read by anyone. */
static void note_step_errors(struct nuc980_nand *nand, unsigned int step,
			     unsigned int count)
{
	struct page_errors *errors = &nand->errors;
	unsigned int i, bitflips = 0;

	for (i = 0; i < count; i++) {
		u32 address = readl(nand->base + NAND_ECCEA(i / 2)) >>
			      (16 * (i % 2)) & NAND_ECCEA_MASK;
		u8 bits = readl(nand->base + NAND_ECCED(i / 4)) >> (8 * (i % 4));

		bitflips += hweight8(bits);
		if (address < STEP_SIZE)
			errors->correction[errors->corrections++] =
				(struct correction) {
					step * STEP_SIZE + address, bits
				};
	}

	errors->done |= BIT(step);
	errors->bitflips += bitflips;
	errors->max_bitflips = max(errors->max_bitflips, bitflips);
}

/*
 * The controller stops after each step with errors until it is told to go on.
 * Nothing says whether it forgets the status of a step then.
 */
static int note_errors(struct nuc980_nand *nand)
{
	unsigned int step;

	for (step = 0; step < nand->chip.ecc.steps; step++) {
		u32 es = readl(nand->base + NAND_ECCES(step / 4)) >>
			 (8 * (step % 4));
		unsigned int count = FIELD_GET(NAND_ECCES_COUNT, es);

		if (FIELD_GET(NAND_ECCES_STATUS, es) == STEP_OK ||
		    nand->errors.done & BIT(step))
			continue;
		if (FIELD_GET(NAND_ECCES_STATUS, es) != STEP_CORRECTABLE ||
		    count > STEP_STRENGTH)
			return -EBADMSG;

		note_step_errors(nand, step, count);
	}

	return 0;
}

static void correct_errors(struct nuc980_nand *nand, u8 *buf)
{
	unsigned int i;

	for (i = 0; i < nand->errors.corrections; i++)
		buf[nand->errors.correction[i].offset] ^=
			nand->errors.correction[i].bits;
}

static int nuc980_nand_run_dma(struct nuc980_nand *nand)
{
	unsigned int stops;
	u32 status;
	int ret;

	for (stops = 0; stops <= nand->chip.ecc.steps; stops++) {
		ret = nuc980_nand_wait(nand, NAND_INT_DMA | NAND_INT_ECC,
				       DMA_TIMEOUT_MS);
		if (ret)
			return ret;

		status = readl(nand->base + NAND_INTSTS);
		if (!(status & NAND_INT_ECC))
			return 0;

		ret = note_errors(nand);
		writel(NAND_INT_ECC, nand->base + NAND_INTSTS);
		if (ret)
			return ret;
	}

	return -EIO;
}

/*
 * A page's data between buf and the flash, after the address, before the rest;
 * ctl is a direction, and whether with ECC.
 */
static int nuc980_nand_dma(struct nuc980_nand *nand, void *buf, u32 ctl)
{
	enum dma_data_direction direction = ctl & NAND_CTL_DMA_READ ?
					    DMA_FROM_DEVICE : DMA_TO_DEVICE;
	unsigned int size = nand_to_mtd(&nand->chip)->writesize;
	dma_addr_t address = dma_map_single(nand->dev, buf, size, direction);
	int ret;

	if (dma_mapping_error(nand->dev, address))
		return -ENOMEM;

	writel(FMI_DMACTL_EN, nand->base + FMI_DMACTL);
	writel(address, nand->base + FMI_DMASA);
	writel(NAND_INT_DMA | NAND_INT_ECC, nand->base + NAND_INTSTS);
	writel(nand->ctl | ctl, nand->base + NAND_CTL);
	ret = nuc980_nand_run_dma(nand);
	if (ret)
		nuc980_nand_reset(nand);
	nuc980_nand_deselect(nand);

	dma_unmap_single(nand->dev, address, size, direction);

	return ret;
}

static void nuc980_nand_load_spare(struct nuc980_nand *nand)
{
	__iowrite32_copy(nand->base + NAND_RA, nand->chip.oob_poi,
			 nand_to_mtd(&nand->chip)->oobsize / 4);
}

/* Most of the 16 bits decide: some may have turned over. */
static bool nuc980_nand_is_written(const u8 *spare)
{
	return hweight8(spare[WRITTEN_AT]) + hweight8(spare[WRITTEN_AT + 1]) <=
	       8 * WRITTEN_SIZE / 2;
}

/* The data of the page that the flash has at hand, as it is */
static int nuc980_nand_read_as_is(struct nand_chip *chip, u8 *buf)
{
	int ret = nand_change_read_column_op(chip, 0, NULL, 0, false);

	return ret ? ret : nuc980_nand_dma(to_nuc980(chip), buf,
					   NAND_CTL_DMA_READ);
}

/*
 * A page that is not marked as written is erased, or its writing was cut off.
 * Then there are more zeros in a step than could be corrected.
 */
static int nuc980_nand_read_erased(struct nand_chip *chip, u8 *buf)
{
	struct mtd_info *mtd = nand_to_mtd(chip);
	u8 *parity = chip->oob_poi + mtd->oobsize - chip->ecc.total;
	int step, bitflips, max_bitflips = 0, ret;

	ret = nuc980_nand_read_as_is(chip, buf);
	if (ret)
		return ret;

	for (step = 0; step < chip->ecc.steps; step++) {
		bitflips = nand_check_erased_ecc_chunk(buf + step * STEP_SIZE,
						       STEP_SIZE,
						       parity + step * STEP_PARITY,
						       STEP_PARITY,
						       chip->oob_poi + WRITTEN_AT,
						       step ? 0 : WRITTEN_SIZE,
						       STEP_STRENGTH);
		if (bitflips < 0) {
			mtd->ecc_stats.failed++;
			continue;
		}
		mtd->ecc_stats.corrected += bitflips;
		max_bitflips = max(max_bitflips, bitflips);
	}

	return max_bitflips;
}

static int nuc980_nand_read_page(struct nand_chip *chip, u8 *buf,
				 int oob_required, int page)
{
	struct nuc980_nand *nand = to_nuc980(chip);
	struct mtd_info *mtd = nand_to_mtd(chip);
	int ret;

	/* The BCH engine needs the parity before the data. */
	ret = nand_read_page_op(chip, page, mtd->writesize, chip->oob_poi,
				mtd->oobsize);
	if (ret)
		return ret;
	if (!nuc980_nand_is_written(chip->oob_poi))
		return nuc980_nand_read_erased(chip, buf);
	nuc980_nand_load_spare(nand);

	ret = nand_change_read_column_op(chip, 0, NULL, 0, false);
	if (ret)
		return ret;
	memset(&nand->errors, 0, sizeof(nand->errors));
	ret = nuc980_nand_dma(nand, buf, NAND_CTL_DMA_READ | NAND_CTL_ECC);
	if (ret == -EBADMSG) {
		/* The DMA has stopped there, and the caller wants all. */
		mtd->ecc_stats.failed++;
		ret = nuc980_nand_read_as_is(chip, buf);
	}
	if (ret)
		return ret;

	correct_errors(nand, buf);
	mtd->ecc_stats.corrected += nand->errors.bitflips;

	return nand->errors.max_bitflips;
}

static int nuc980_nand_write_page(struct nand_chip *chip, const u8 *buf,
				  int oob_required, int page)
{
	struct nuc980_nand *nand = to_nuc980(chip);
	struct mtd_info *mtd = nand_to_mtd(chip);
	int ret;

	/* The controller puts the parity in. */
	memset(chip->oob_poi + WRITTEN_AT, 0, WRITTEN_SIZE);
	memset(chip->oob_poi + mtd->oobsize - chip->ecc.total, 0xff,
	       chip->ecc.total);
	nuc980_nand_load_spare(nand);

	ret = nand_prog_page_begin_op(chip, page, 0, NULL, 0);
	if (ret)
		return ret;
	ret = nuc980_nand_dma(nand, (void *)buf,
			      NAND_CTL_DMA_WRITE | NAND_CTL_ECC);
	if (ret)
		return ret;

	return nand_prog_page_end_op(chip);
}

/*
 * A worn block may not take the mark. UBI would then never write again to the
 * whole flash, for nothing: the tables have the block.
 */
static int nuc980_nand_mark_bad(struct nand_chip *chip, loff_t offset)
{
	static const u8 mark;
	int ret;

	nand_select_target(chip, 0);
	ret = nand_prog_page_op(chip, offset >> chip->page_shift,
				nand_to_mtd(chip)->writesize + chip->badblockpos,
				&mark, sizeof(mark));
	nand_deselect_target(chip);

	return chip->bbt_options & NAND_BBT_USE_FLASH ? 0 : ret;
}

static int nuc980_ooblayout_ecc(struct mtd_info *mtd, int section,
				struct mtd_oob_region *region)
{
	struct nand_chip *chip = mtd_to_nand(mtd);

	if (section)
		return -ERANGE;

	region->offset = mtd->oobsize - chip->ecc.total;
	region->length = chip->ecc.total;

	return 0;
}

/* The bad block mark, the mark of a written page, and what nobody uses */
static int nuc980_ooblayout_free(struct mtd_info *mtd, int section,
				 struct mtd_oob_region *region)
{
	return -ERANGE;
}

static const struct mtd_ooblayout_ops nuc980_ooblayout_ops = {
	.ecc = nuc980_ooblayout_ecc,
	.free = nuc980_ooblayout_free,
};

/* Between identification and the rest of the scan: the geometry is known. */
static int nuc980_nand_attach_chip(struct nand_chip *chip)
{
	struct nuc980_nand *nand = to_nuc980(chip);
	struct mtd_info *mtd = nand_to_mtd(chip);
	unsigned int steps = mtd->writesize / STEP_SIZE;

	if (chip->ecc.engine_type != NAND_ECC_ENGINE_TYPE_ON_HOST)
		return 0;

	if (chip->ecc.strength != STEP_STRENGTH ||
	    chip->ecc.size != STEP_SIZE || mtd->writesize < SZ_2K ||
	    mtd->writesize > SZ_8K ||
	    mtd->oobsize < steps * STEP_PARITY + WRITTEN_AT + WRITTEN_SIZE) {
		dev_err(nand->dev,
			"no ECC of %d bits in %d bytes for pages of %d + %d bytes\n",
			chip->ecc.strength, chip->ecc.size, mtd->writesize,
			mtd->oobsize);
		return -EINVAL;
	}

	chip->ecc.steps = steps;
	chip->ecc.bytes = STEP_PARITY;
	chip->ecc.total = steps * STEP_PARITY;
	chip->ecc.read_page = nuc980_nand_read_page;
	chip->ecc.write_page = nuc980_nand_write_page;
	mtd_set_ooblayout(mtd, &nuc980_ooblayout_ops);

	nand->ctl |= FIELD_PREP(NAND_CTL_PAGE, ilog2(mtd->writesize) - 10) |
		     NAND_CTL_SPARE_WRITE | NAND_CTL_PROTECT3 |
		     NAND_CTL_BCH_T8;
	nuc980_nand_deselect(nand);
	/* Behind the size of the page, which sets it too */
	writel(mtd->oobsize, nand->base + NAND_RACTL);

	return 0;
}

static const struct nand_controller_ops nuc980_nand_ops = {
	.attach_chip = nuc980_nand_attach_chip,
	.exec_op = nuc980_nand_exec_op,
};

static int nuc980_nand_init(struct nuc980_nand *nand)
{
	writel(FMI_CTL_NAND, nand->base + FMI_CTL);
	writel(NAND_TMCTL_VENDOR, nand->base + NAND_TMCTL);
	writel(0, nand->base + NAND_INTEN);
	writel(NAND_ECTL_UNPROTECT, nand->base + NAND_ECTL);
	nand->ctl = NAND_CTL_CS1;

	return nuc980_nand_reset(nand);
}

static void nuc980_nand_init_chip(struct nuc980_nand *nand)
{
	struct nand_chip *chip = &nand->chip;
	struct mtd_info *mtd = nand_to_mtd(chip);

	nand_controller_init(&nand->controller);
	nand->controller.ops = &nuc980_nand_ops;

	chip->controller = &nand->controller;
	nand_set_flash_node(chip, nand->dev->of_node);
	/* nuc980_nand_scan() looks for bad blocks itself. */
	chip->options = NAND_NO_SUBPAGE_WRITE | NAND_USES_DMA |
			NAND_SKIP_BBTSCAN;
	chip->buf_align = dma_get_cache_alignment();
	chip->legacy.block_markbad = nuc980_nand_mark_bad;
	/* All of the spare area is taken: the tables are in pages. */
	chip->bbt_options = NAND_BBT_NO_OOB;

	mtd->dev.parent = nand->dev;
	/* As in the vendor's command lines with mtdparts= */
	mtd->name = "nand0";
}

static int nuc980_nand_get_clocks(struct device *dev)
{
	static const char * const names[] = { NULL, "nand" };
	unsigned int i;

	for (i = 0; i < ARRAY_SIZE(names); i++) {
		struct clk *clk = devm_clk_get_enabled(dev, names[i]);

		if (IS_ERR(clk))
			return dev_err_probe(dev, PTR_ERR(clk),
					     "no clock %s\n",
					     names[i] ? names[i] : "fmi");
	}

	return 0;
}

static bool nuc980_nand_has_tables(struct mtd_info *mtd)
{
	bool found = false;
	size_t len;
	int i, ret;
	u8 *buf;

	buf = kmalloc(mtd->writesize, GFP_KERNEL);
	if (!buf)
		return false;

	for (i = 1; i <= NAND_BBT_SCAN_MAXBLOCKS && !found; i++) {
		ret = mtd_read(mtd, mtd->size - i * mtd->erasesize,
			       mtd->writesize, &len, buf);
		found = (!ret || mtd_is_bitflip(ret)) &&
			(!memcmp(buf, "Bbt0", 4) || !memcmp(buf, "1tbB", 4));
	}
	kfree(buf);

	return found;
}

/*
 * Tables of bad blocks are used where there are any, whatever the device tree
 * says: a worn block may be known to them alone. None are made unless it has
 * nand-on-flash-bbt: the last blocks may hold something else that nobody has
 * kept.
 */
static int nuc980_nand_scan(struct nand_chip *chip)
{
	int ret;

	ret = nand_scan(chip, 1);
	if (ret)
		return ret;

	if (nuc980_nand_has_tables(nand_to_mtd(chip)))
		chip->bbt_options |= NAND_BBT_USE_FLASH;
	ret = nand_create_bbt(chip);
	if (ret)
		nand_cleanup(chip);

	return ret;
}

static int nuc980_nand_probe(struct platform_device *pdev)
{
	struct device *dev = &pdev->dev;
	struct nuc980_nand *nand;
	int ret;

	nand = devm_kzalloc(dev, sizeof(*nand), GFP_KERNEL);
	if (!nand)
		return -ENOMEM;
	nand->dev = dev;
	init_completion(&nand->event);
	platform_set_drvdata(pdev, nand);

	nand->base = devm_platform_ioremap_resource(pdev, 0);
	if (IS_ERR(nand->base))
		return PTR_ERR(nand->base);
	nand->irq = platform_get_irq(pdev, 0);
	if (nand->irq < 0)
		return nand->irq;
	ret = nuc980_nand_get_clocks(dev);
	if (ret)
		return ret;
	ret = dma_set_mask_and_coherent(dev, DMA_BIT_MASK(32));
	if (ret)
		return ret;

	ret = nuc980_nand_init(nand);
	if (ret)
		return dev_err_probe(dev, ret, "the controller stays in reset\n");
	ret = devm_request_irq(dev, nand->irq, nuc980_nand_irq, 0,
			       dev_name(dev), nand);
	if (ret)
		return ret;

	nuc980_nand_init_chip(nand);
	ret = nuc980_nand_scan(&nand->chip);
	if (ret)
		return ret;
	ret = mtd_device_register(nand_to_mtd(&nand->chip), NULL, 0);
	if (ret)
		nand_cleanup(&nand->chip);

	return ret;
}

static int nuc980_nand_remove(struct platform_device *pdev)
{
	struct nuc980_nand *nand = platform_get_drvdata(pdev);

	WARN_ON(mtd_device_unregister(nand_to_mtd(&nand->chip)));
	nand_cleanup(&nand->chip);

	return 0;
}

static const struct of_device_id nuc980_nand_of_match[] = {
	{ .compatible = "nuvoton,nuc980-fmi" },
	{ }
};
MODULE_DEVICE_TABLE(of, nuc980_nand_of_match);

static struct platform_driver nuc980_nand_driver = {
	.probe = nuc980_nand_probe,
	.remove = nuc980_nand_remove,
	.driver = {
		.name = "nuc980-nand",
		.of_match_table = nuc980_nand_of_match,
	},
};
module_platform_driver(nuc980_nand_driver);

MODULE_DESCRIPTION("Nuvoton NUC980 raw NAND flash controller");
MODULE_LICENSE("GPL");
