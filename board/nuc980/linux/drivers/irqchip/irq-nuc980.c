// SPDX-License-Identifier: GPL-2.0-only
/*
 * Nuvoton NUC980 advanced interrupt controller: 63 sources, source 0 is none
 */

#include <linux/io.h>
#include <linux/irq.h>
#include <linux/irqchip.h>
#include <linux/irqdomain.h>
#include <linux/of_address.h>

#include <asm/exception.h>

#define AIC_SRCCTL(n)		(4 * (n))	/* four sources in each */
#define AIC_IRQNUM		0x120
#define AIC_INTEN(half)		(0x130 + 4 * (half))
#define AIC_INTDIS(half)	(0x138 + 4 * (half))
#define AIC_EOIS		0x150

#define AIC_SOURCES		64

/*
 * For each of four sources: high level, and the lowest priority, which is an
 * IRQ; 0 would be the FIQ.
 */
#define AIC_SRCCTL_HIGH_LEVEL	0x47474747

static void __iomem *aic_base;
static struct irq_domain *aic_domain;

static void __exception_irq_entry nuc980_aic_handle_irq(struct pt_regs *regs)
{
	u32 source;

	while ((source = readl_relaxed(aic_base + AIC_IRQNUM)))
		generic_handle_domain_irq(aic_domain, source);
}

static void nuc980_aic_mask(struct irq_data *d)
{
	writel_relaxed(BIT(d->hwirq % 32),
		       aic_base + AIC_INTDIS(d->hwirq / 32));
}

static void nuc980_aic_unmask(struct irq_data *d)
{
	writel_relaxed(BIT(d->hwirq % 32), aic_base + AIC_INTEN(d->hwirq / 32));
}

/*
 * The source is masked by then. To end its service now lets the others in
 * while its handler waits for its thread.
 */
static void nuc980_aic_ack(struct irq_data *d)
{
	writel_relaxed(1, aic_base + AIC_EOIS);
}

/*
 * The device trees call all sources "high level", and that is what has been
 * tried.
 */
static int nuc980_aic_set_type(struct irq_data *d, unsigned int type)
{
	return type == IRQ_TYPE_LEVEL_HIGH ? 0 : -EINVAL;
}

static struct irq_chip nuc980_aic_chip = {
	.name		= "AIC",
	.irq_mask	= nuc980_aic_mask,
	.irq_unmask	= nuc980_aic_unmask,
	.irq_ack	= nuc980_aic_ack,
	.irq_set_type	= nuc980_aic_set_type,
};

static int nuc980_aic_map(struct irq_domain *d, unsigned int virq,
			  irq_hw_number_t source)
{
	if (!source || source >= AIC_SOURCES)
		return -EINVAL;
	irq_set_chip_and_handler(virq, &nuc980_aic_chip, handle_level_irq);
	return 0;
}

/*
 * The first cell is the source, the second its type; the third, 1, means
 * nothing.
 */
static const struct irq_domain_ops nuc980_aic_domain_ops = {
	.map		= nuc980_aic_map,
	.xlate		= irq_domain_xlate_onetwocell,
};

static int __init nuc980_aic_init(struct device_node *node,
				  struct device_node *parent)
{
	int i;

	aic_base = of_iomap(node, 0);
	if (!aic_base)
		return -ENOMEM;
	aic_domain = irq_domain_add_linear(node, AIC_SOURCES,
					   &nuc980_aic_domain_ops, NULL);
	if (!aic_domain) {
		iounmap(aic_base);
		return -ENOMEM;
	}

	writel_relaxed(U32_MAX, aic_base + AIC_INTDIS(0));
	writel_relaxed(U32_MAX, aic_base + AIC_INTDIS(1));
	for (i = 0; i < AIC_SOURCES / 4; i++)
		writel_relaxed(AIC_SRCCTL_HIGH_LEVEL, aic_base + AIC_SRCCTL(i));
	set_handle_irq(nuc980_aic_handle_irq);
	return 0;
}

IRQCHIP_DECLARE(nuc980_aic, "nuvoton,nuc980-aic", nuc980_aic_init);
