// SPDX-License-Identifier: GPL-2.0-or-later
/*
 * Nuvoton NUC980 flash memory interface (FMI) with a raw NAND flash
 *
 * Pages go by DMA through the BCH engine: 8 bits in each field of 512 bytes,
 * the fields' 15 bytes of parity at the end of the spare area. Its bytes 2 and
 * 3 are 0 where a page has been written: the parity of an erased page is not
 * all ones, so that one must be known before it is read. All this is as the
 * vendor's U-Boot and Linux have it.
 */

#include <common.h>
#include <dm.h>
#include <malloc.h>
#include <nand.h>
#include <dm/device_compat.h>
#include <asm/io.h>
#include <asm/unaligned.h>
#include <linux/bitfield.h>
#include <linux/bitops.h>
#include <linux/delay.h>
#include <linux/dma-mapping.h>
#include <linux/err.h>
#include <linux/iopoll.h>
#include <linux/log2.h>
#include <linux/mtd/rawnand.h>
#include <linux/sizes.h>

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
#define NAND_ECCES(i)	(0x8d0 + 4 * (i))	/* status of four fields */
#define NAND_ECCEA(i)	(0x900 + 4 * (i))	/* addresses of two errors */
#define NAND_ECCED(i)	(0x960 + 4 * (i))	/* wrong bits of four errors */
#define NAND_RA(i)	(0xa00 + (i))		/* spare area */

#define FMI_DMACTL_EN		BIT(0)
#define FMI_DMACTL_RST		BIT(1)
#define FMI_DMACTL_BUSY		BIT(9)
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
#define NAND_INT_READY		BIT(18)
#define NAND_ADDR_LAST		BIT(31)
#define NAND_ECTL_UNPROTECT	BIT(0)
#define NAND_ECCES_STATUS	GENMASK(1, 0)
#define NAND_ECCES_COUNT	GENMASK(6, 2)
#define NAND_ECCEA_MASK		GENMASK(10, 0)

#define FIELD_OK		0
#define FIELD_CORRECTABLE	1

/* As the vendor's U-Boot has it for all boards */
#define NAND_TMCTL_VENDOR	0x20305

#define FIELD_SIZE		512
#define FIELD_PARITY		15
#define FIELD_STRENGTH		8
#define MAX_FIELDS		(NAND_MAX_PAGESIZE / FIELD_SIZE)

#define NO_ADDRESS		-1

/* 2 KiB take 0.2 ms. */
#define DMA_TIMEOUT_US		100000

struct nuc980_nand {
	struct nand_chip chip;
	struct nand_ecclayout layout;
	void __iomem *base;
	u32 page_ctl;		/* NAND_CTL for pages with ECC */
	int address;		/* not sent yet: it may be the last */
};

/* What to change in a page once the DMA no longer writes to it */
struct correction {
	u16 offset;
	u8 bits;
};

struct page_errors {
	u32 done;		/* one bit a field */
	int bitflips;		/* in all */
	int max_bitflips;	/* in one field */
	int corrections;
	struct correction correction[MAX_FIELDS * FIELD_STRENGTH];
};

static struct nuc980_nand *to_nuc980(struct mtd_info *mtd)
{
	return container_of(mtd_to_nand(mtd), struct nuc980_nand, chip);
}

static void nuc980_nand_select_chip(struct mtd_info *mtd, int cs)
{
	struct nuc980_nand *nand = to_nuc980(mtd);

	if (cs < 0)
		setbits_le32(nand->base + NAND_CTL, NAND_CTL_CS0);
	else
		clrbits_le32(nand->base + NAND_CTL, NAND_CTL_CS0);
}

static int nuc980_nand_dev_ready(struct mtd_info *mtd)
{
	return !!(readl(to_nuc980(mtd)->base + NAND_INTSTS) & NAND_INT_READY);
}

/* The controller wants the last address marked: send each when the next comes. */
static void nuc980_nand_cmd_ctrl(struct mtd_info *mtd, int byte,
				 unsigned int ctrl)
{
	struct nuc980_nand *nand = to_nuc980(mtd);

	if (nand->address != NO_ADDRESS) {
		writel(nand->address | (ctrl & NAND_ALE ? 0 : NAND_ADDR_LAST),
		       nand->base + NAND_ADDR);
		nand->address = NO_ADDRESS;
	}

	if (byte == NAND_CMD_NONE)
		return;
	if (ctrl & NAND_CLE)
		writel(byte & 0xff, nand->base + NAND_CMD);
	else if (ctrl & NAND_ALE)
		nand->address = byte & 0xff;
}

static u8 nuc980_nand_read_byte(struct mtd_info *mtd)
{
	return readl(to_nuc980(mtd)->base + NAND_DATA);
}

static void nuc980_nand_read_buf(struct mtd_info *mtd, u8 *buf, int len)
{
	while (len--)
		*buf++ = nuc980_nand_read_byte(mtd);
}

static void nuc980_nand_write_buf(struct mtd_info *mtd, const u8 *buf, int len)
{
	while (len--)
		writel(*buf++, to_nuc980(mtd)->base + NAND_DATA);
}

/* Of the wrong bytes only those of the data are read by anyone. */
static void note_field_errors(struct nuc980_nand *nand, int field, int count,
			      struct page_errors *errors)
{
	int i;

	errors->bitflips += count;
	errors->max_bitflips = max(errors->max_bitflips, count);

	for (i = 0; i < count; i++) {
		u32 address = readl(nand->base + NAND_ECCEA(i / 2)) >>
			      (16 * (i % 2)) & NAND_ECCEA_MASK;
		u8 bits = readl(nand->base + NAND_ECCED(i / 4)) >> (8 * (i % 4));

		if (address < FIELD_SIZE)
			errors->correction[errors->corrections++] =
				(struct correction) {
					field * FIELD_SIZE + address, bits
				};
	}
}

/*
 * The controller stops after each field with errors until it is told to go on.
 * Nothing says whether it forgets the status of a field then.
 */
static int note_errors(struct nuc980_nand *nand, struct page_errors *errors)
{
	int field;

	for (field = 0; field < nand->chip.ecc.steps; field++) {
		u32 es = readl(nand->base + NAND_ECCES(field / 4)) >>
			 (8 * (field % 4));
		int count = FIELD_GET(NAND_ECCES_COUNT, es);

		if (FIELD_GET(NAND_ECCES_STATUS, es) == FIELD_OK ||
		    errors->done & BIT(field))
			continue;
		if (FIELD_GET(NAND_ECCES_STATUS, es) != FIELD_CORRECTABLE ||
		    count > FIELD_STRENGTH)
			return -EBADMSG;

		errors->done |= BIT(field);
		note_field_errors(nand, field, count, errors);
	}

	return 0;
}

static void nuc980_nand_reset(struct nuc980_nand *nand)
{
	u32 ctl;

	writel(FMI_DMACTL_EN | FMI_DMACTL_RST, nand->base + FMI_DMACTL);
	readl_poll_timeout(nand->base + FMI_DMACTL, ctl,
			   !(ctl & FMI_DMACTL_RST), 1000);
	setbits_le32(nand->base + NAND_CTL, NAND_CTL_RST);
	readl_poll_timeout(nand->base + NAND_CTL, ctl, !(ctl & NAND_CTL_RST),
			   1000);
}

static int nuc980_nand_dma(struct nuc980_nand *nand, dma_addr_t page,
			   u32 direction, struct page_errors *errors)
{
	int ret, stops = 0;
	u32 status;

	writel(FMI_DMACTL_EN, nand->base + FMI_DMACTL);
	writel(page, nand->base + FMI_DMASA);
	writel(NAND_INT_DMA | NAND_INT_ECC, nand->base + NAND_INTSTS);
	writel(nand->page_ctl | direction, nand->base + NAND_CTL);

	/* It stops at each field with errors, and in the end. */
	do {
		ret = readl_poll_timeout(nand->base + NAND_INTSTS, status,
					 status & (NAND_INT_DMA | NAND_INT_ECC),
					 DMA_TIMEOUT_US);
		if (!ret && (status & NAND_INT_ECC)) {
			ret = note_errors(nand, errors);
			writel(NAND_INT_ECC, nand->base + NAND_INTSTS);
			if (stops++ > nand->chip.ecc.steps)
				ret = -EIO;
		}
	} while (!ret && (status & NAND_INT_ECC));

	if (ret)
		nuc980_nand_reset(nand);

	return ret;
}

static void nuc980_nand_load_spare(struct nuc980_nand *nand, const u8 *spare,
				   int len)
{
	int i;

	for (i = 0; i < len; i += 4)
		writel(get_unaligned_le32(spare + i), nand->base + NAND_RA(i));
}

static int nuc980_nand_read_page(struct mtd_info *mtd, struct nand_chip *chip,
				 u8 *buf, int oob_required, int page)
{
	struct nuc980_nand *nand = to_nuc980(mtd);
	struct page_errors errors = { 0 };
	dma_addr_t address;
	int i, ret;

	/* The BCH engine needs the parity before the data. */
	ret = nand_read_oob_op(chip, page, 0, chip->oob_poi, mtd->oobsize);
	if (ret)
		return ret;
	if (chip->oob_poi[2] && chip->oob_poi[3]) {
		memset(buf, 0xff, mtd->writesize);
		return 0;
	}
	nuc980_nand_load_spare(nand, chip->oob_poi, mtd->oobsize);

	ret = nand_read_page_op(chip, page, 0, NULL, 0);
	if (ret)
		return ret;
	address = dma_map_single(buf, mtd->writesize, DMA_FROM_DEVICE);
	ret = nuc980_nand_dma(nand, address, NAND_CTL_DMA_READ, &errors);
	dma_unmap_single(address, mtd->writesize, DMA_FROM_DEVICE);
	if (ret == -EBADMSG) {
		mtd->ecc_stats.failed++;
		return 0;
	}
	if (ret)
		return ret;

	for (i = 0; i < errors.corrections; i++)
		buf[errors.correction[i].offset] ^= errors.correction[i].bits;
	mtd->ecc_stats.corrected += errors.bitflips;

	return errors.max_bitflips;
}

static int nuc980_nand_write_page(struct mtd_info *mtd, struct nand_chip *chip,
				  const u8 *buf, int oob_required, int page)
{
	struct nuc980_nand *nand = to_nuc980(mtd);

	/* The controller puts the parity in. */
	chip->oob_poi[2] = 0;
	chip->oob_poi[3] = 0;
	memset(chip->oob_poi + mtd->oobsize - chip->ecc.total, 0xff,
	       chip->ecc.total);
	nuc980_nand_load_spare(nand, chip->oob_poi, mtd->oobsize);

	return nuc980_nand_dma(nand, dma_map_single((void *)buf, mtd->writesize,
						    DMA_TO_DEVICE),
			       NAND_CTL_DMA_WRITE, NULL);
}

static bool nuc980_nand_has_tables(struct mtd_info *mtd)
{
	bool found = false;
	size_t len;
	int i, ret;
	u8 *buf;

	buf = malloc(mtd->writesize);
	if (!buf)
		return false;

	for (i = 1; i <= NAND_BBT_SCAN_MAXBLOCKS && !found; i++) {
		ret = mtd_read(mtd, mtd->size - i * mtd->erasesize,
			       mtd->writesize, &len, buf);
		found = (!ret || mtd_is_bitflip(ret)) &&
			(!memcmp(buf, "Bbt0", 4) || !memcmp(buf, "1tbB", 4));
	}
	free(buf);

	return found;
}

/*
 * Tables of bad blocks are used where there are any, and none are made: the
 * last blocks may hold something else that nobody has kept.
 */
static int nuc980_nand_scan_bbt(struct mtd_info *mtd)
{
	struct nand_chip *chip = mtd_to_nand(mtd);

	if (nuc980_nand_has_tables(mtd))
		chip->bbt_options |= NAND_BBT_USE_FLASH;
	else
		chip->bbt_options &= ~NAND_BBT_USE_FLASH;

	return nand_default_bbt(mtd);
}

static void nuc980_nand_init(struct nuc980_nand *nand)
{
	writel(FMI_CTL_NAND, nand->base + FMI_CTL);
	writel(NAND_TMCTL_VENDOR, nand->base + NAND_TMCTL);
	writel(NAND_CTL_CS0 | NAND_CTL_CS1, nand->base + NAND_CTL);
	writel(0, nand->base + NAND_INTEN);
	writel(NAND_ECTL_UNPROTECT, nand->base + NAND_ECTL);
	nuc980_nand_reset(nand);
}

/* Between identification and the rest of the scan: the geometry is known. */
static int nuc980_nand_init_ecc(struct nuc980_nand *nand)
{
	struct nand_chip *chip = &nand->chip;
	struct mtd_info *mtd = nand_to_mtd(chip);
	int parity = mtd->writesize / FIELD_SIZE * FIELD_PARITY;

	if (chip->ecc.strength != FIELD_STRENGTH ||
	    chip->ecc.size != FIELD_SIZE || mtd->writesize < SZ_2K ||
	    mtd->writesize > SZ_8K || mtd->oobsize < parity + 4) {
		pr_err("%s: no ECC of %d bits in %d bytes for pages of %d + %d bytes\n",
		       __func__, chip->ecc.strength, chip->ecc.size,
		       mtd->writesize, mtd->oobsize);
		return -EINVAL;
	}

	nand->layout.eccbytes = parity;
	chip->ecc.layout = &nand->layout;
	chip->ecc.mode = NAND_ECC_HW;
	chip->ecc.bytes = FIELD_PARITY;
	chip->ecc.read_page = nuc980_nand_read_page;
	chip->ecc.write_page = nuc980_nand_write_page;

	nand->page_ctl = FIELD_PREP(NAND_CTL_PAGE, ilog2(mtd->writesize) - 10) |
			 NAND_CTL_SPARE_WRITE | NAND_CTL_PROTECT3 |
			 NAND_CTL_BCH_T8 | NAND_CTL_ECC | NAND_CTL_CS1;
	writel(mtd->oobsize, nand->base + NAND_RACTL);

	return 0;
}

static int nuc980_nand_probe(struct udevice *dev)
{
	struct nuc980_nand *nand = dev_get_priv(dev);
	struct nand_chip *chip = &nand->chip;
	struct mtd_info *mtd = nand_to_mtd(chip);
	int ret;

	nand->base = dev_read_addr_ptr(dev);
	if (!nand->base)
		return -EINVAL;
	nand->address = NO_ADDRESS;

	nand_set_flash_node(chip, dev_ofnode(dev));
	chip->select_chip = nuc980_nand_select_chip;
	chip->cmd_ctrl = nuc980_nand_cmd_ctrl;
	chip->dev_ready = nuc980_nand_dev_ready;
	chip->read_byte = nuc980_nand_read_byte;
	chip->read_buf = nuc980_nand_read_buf;
	chip->write_buf = nuc980_nand_write_buf;
	chip->scan_bbt = nuc980_nand_scan_bbt;
	chip->options = NAND_NO_SUBPAGE_WRITE | NAND_USE_BOUNCE_BUFFER;
	chip->buf_align = ARCH_DMA_MINALIGN;
	/* All of the spare area is parity: the tables are in pages. */
	chip->bbt_options = NAND_BBT_NO_OOB;

	nuc980_nand_init(nand);
	ret = nand_scan_ident(mtd, 1, NULL);
	if (ret)
		return ret;
	ret = nuc980_nand_init_ecc(nand);
	if (ret)
		return ret;
	ret = nand_scan_tail(mtd);
	if (ret)
		return ret;

	return nand_register(0, mtd);
}

static const struct udevice_id nuc980_nand_ids[] = {
	{ .compatible = "nuvoton,nuc980-fmi" },
	{ }
};

U_BOOT_DRIVER(nuc980_nand) = {
	.name = "nuc980_nand",
	.id = UCLASS_MTD,
	.of_match = nuc980_nand_ids,
	.priv_auto = sizeof(struct nuc980_nand),
	.probe = nuc980_nand_probe,
};

void board_nand_init(void)
{
	struct udevice *dev;
	int ret;

	ret = uclass_get_device_by_driver(UCLASS_MTD, DM_DRIVER_GET(nuc980_nand),
					  &dev);
	if (ret && ret != -ENODEV)
		pr_err("NAND: error %d\n", ret);
}
