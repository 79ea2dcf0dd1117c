// SPDX-License-Identifier: GPL-2.0-or-later
/*
 * Nuvoton NUC980 ETIMER as time base: 24 bits at the full rate of its clock
 */

#include <common.h>
#include <dm.h>
#include <timer.h>
#include <asm/io.h>
#include <linux/bitops.h>

#define ETIMER_CTL	0x00
#define ETIMER_PRECNT	0x04
#define ETIMER_CMPR	0x08
#define ETIMER_IER	0x0c
#define ETIMER_DR	0x14

#define ETIMER_CTL_EN		BIT(0)
#define ETIMER_CTL_PERIODIC	BIT(4)	/* from 0 again after CMPR */
#define ETIMER_MASK		GENMASK(23, 0)

struct nuc980_timer {
	void __iomem *base;
	u64 count;
};

/*
 * The counter wraps every 1.4 s at 12 MHz. Whoever waits reads it far more
 * often; time in which nobody reads, as at an idle prompt, may be lost.
 */
static u64 notrace nuc980_timer_get_count(struct udevice *dev)
{
	struct nuc980_timer *priv = dev_get_priv(dev);
	u32 now = readl(priv->base + ETIMER_DR);

	priv->count += (now - (u32)priv->count) & ETIMER_MASK;

	return priv->count;
}

static int nuc980_timer_probe(struct udevice *dev)
{
	struct nuc980_timer *priv = dev_get_priv(dev);

	priv->base = dev_read_addr_ptr(dev);
	if (!priv->base)
		return -EINVAL;

	writel(0, priv->base + ETIMER_CTL);
	writel(0, priv->base + ETIMER_IER);
	writel(0, priv->base + ETIMER_PRECNT);
	writel(ETIMER_MASK, priv->base + ETIMER_CMPR);
	writel(ETIMER_CTL_EN | ETIMER_CTL_PERIODIC, priv->base + ETIMER_CTL);

	return 0;
}

static const struct timer_ops nuc980_timer_ops = {
	.get_count = nuc980_timer_get_count,
};

static const struct udevice_id nuc980_timer_ids[] = {
	{ .compatible = "nuvoton,nuc980-timer" },
	{ }
};

U_BOOT_DRIVER(nuc980_timer) = {
	.name = "nuc980_timer",
	.id = UCLASS_TIMER,
	.of_match = nuc980_timer_ids,
	.priv_auto = sizeof(struct nuc980_timer),
	.probe = nuc980_timer_probe,
	.ops = &nuc980_timer_ops,
};
