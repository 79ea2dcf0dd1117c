// SPDX-License-Identifier: GPL-2.0-only
/*
 * Nuvoton NUC980 pin controller
 *
 * A pin has a field of four bits that says which peripheral it belongs to, 0 is
 * GPIO. Nothing else is set here: pulls are registers of the GPIO block, and
 * act on GPIO lines.
 */

#include <linux/bits.h>
#include <linux/init.h>
#include <linux/io.h>
#include <linux/of.h>
#include <linux/pinctrl/pinctrl.h>
#include <linux/pinctrl/pinmux.h>
#include <linux/platform_device.h>
#include <linux/seq_file.h>
#include <linux/slab.h>
#include <linux/spinlock.h>

#include "../core.h"
#include "../pinctrl-utils.h"
#include "../pinmux.h"
#include "pinctrl-nuc980-pins.h"

#define NUC980_BANKS		7
#define NUC980_BANK_PINS	16

/* Eight pins a register, and pins are numbered without a gap */
#define SYS_MFP(pin)		(0x70 + 4 * ((pin) / 8))
#define SYS_MFP_SHIFT(pin)	(4 * ((pin) % 8))
#define SYS_MFP_MASK		GENMASK(3, 0)
#define SYS_MFP_GPIO		0

/* Of a pin in nuvoton,pins; the driver of the vendor has no use for the last */
enum { CELL_BANK, CELL_PIN, CELL_FUNCTION, CELL_UNUSED, CELLS };

struct nuc980_pinctrl {
	struct pinctrl_dev *pctldev;
	void __iomem *base;
	spinlock_t lock;	/* a pin's register is that of seven others */
};

struct nuc980_group {
	const struct device_node *np;
	u32 functions[];	/* one for each pin */
};

static const char *nuc980_function_name(struct pinctrl_dev *pctldev,
					unsigned int pin, u32 function)
{
	const char *const *names = pin_desc_get(pctldev, pin)->drv_data;

	return function < NUC980_FUNCTIONS ? names[function] : NULL;
}

static u32 nuc980_read_mux(struct nuc980_pinctrl *pc, unsigned int pin)
{
	u32 mfp = readl(pc->base + SYS_MFP(pin));

	return mfp >> SYS_MFP_SHIFT(pin) & SYS_MFP_MASK;
}

static void nuc980_write_mux(struct nuc980_pinctrl *pc, unsigned int pin,
			     u32 function)
{
	void __iomem *reg = pc->base + SYS_MFP(pin);
	unsigned long flags;
	u32 mfp;

	spin_lock_irqsave(&pc->lock, flags);
	mfp = readl(reg) & ~(SYS_MFP_MASK << SYS_MFP_SHIFT(pin));
	writel(mfp | function << SYS_MFP_SHIFT(pin), reg);
	spin_unlock_irqrestore(&pc->lock, flags);
}

static void nuc980_pin_dbg_show(struct pinctrl_dev *pctldev,
				struct seq_file *s, unsigned int pin)
{
	u32 function = nuc980_read_mux(pinctrl_dev_get_drvdata(pctldev), pin);
	const char *name = nuc980_function_name(pctldev, pin, function);

	seq_printf(s, "%s (%u)", name ?: "no function", function);
}

static struct group_desc *nuc980_find_group(struct pinctrl_dev *pctldev,
					    const struct device_node *np)
{
	int i;

	for (i = 0; i < pinctrl_generic_get_group_count(pctldev); i++) {
		struct group_desc *desc = pinctrl_generic_get_group(pctldev, i);
		struct nuc980_group *group = desc->data;

		if (group->np == np)
			return desc;
	}

	return NULL;
}

static int nuc980_dt_node_to_map(struct pinctrl_dev *pctldev,
				 struct device_node *np,
				 struct pinctrl_map **map,
				 unsigned int *num_maps)
{
	struct group_desc *group = nuc980_find_group(pctldev, np);
	unsigned int reserved = 0;
	int ret;

	if (!group) {
		dev_err(pctldev->dev, "%pOF: not a valid group of pins\n", np);
		return -EINVAL;
	}

	*map = NULL;
	*num_maps = 0;

	ret = pinctrl_utils_reserve_map(pctldev, map, &reserved, num_maps, 1);
	if (ret)
		return ret;

	return pinctrl_utils_add_map_mux(pctldev, map, &reserved, num_maps,
					 group->name, np->parent->name);
}

static const struct pinctrl_ops nuc980_pinctrl_ops = {
	.get_groups_count = pinctrl_generic_get_group_count,
	.get_group_name = pinctrl_generic_get_group_name,
	.get_group_pins = pinctrl_generic_get_group_pins,
	.pin_dbg_show = nuc980_pin_dbg_show,
	.dt_node_to_map = nuc980_dt_node_to_map,
	.dt_free_map = pinctrl_utils_free_map,
};

static int nuc980_set_mux(struct pinctrl_dev *pctldev, unsigned int function,
			  unsigned int selector)
{
	struct group_desc *desc = pinctrl_generic_get_group(pctldev, selector);
	struct nuc980_group *group = desc->data;
	int i;

	for (i = 0; i < desc->num_pins; i++) {
		int pin = desc->pins[i];

		if (!nuc980_function_name(pctldev, pin, group->functions[i])) {
			dev_err(pctldev->dev, "%s: %s has no function %u\n",
				desc->name, pin_get_name(pctldev, pin),
				group->functions[i]);
			return -EINVAL;
		}
	}

	for (i = 0; i < desc->num_pins; i++)
		nuc980_write_mux(pinctrl_dev_get_drvdata(pctldev),
				 desc->pins[i], group->functions[i]);

	return 0;
}

static int nuc980_gpio_request_enable(struct pinctrl_dev *pctldev,
				      struct pinctrl_gpio_range *range,
				      unsigned int pin)
{
	nuc980_write_mux(pinctrl_dev_get_drvdata(pctldev), pin, SYS_MFP_GPIO);

	return 0;
}

static const struct pinmux_ops nuc980_pinmux_ops = {
	.get_functions_count = pinmux_generic_get_function_count,
	.get_function_name = pinmux_generic_get_function_name,
	.get_function_groups = pinmux_generic_get_function_groups,
	.set_mux = nuc980_set_mux,
	.gpio_request_enable = nuc980_gpio_request_enable,
	.strict = true,
};

static struct pinctrl_desc nuc980_pinctrl_desc = {
	.name = "nuc980-pinctrl",
	.pins = nuc980_pins,
	.npins = ARRAY_SIZE(nuc980_pins),
	.pctlops = &nuc980_pinctrl_ops,
	.pmxops = &nuc980_pinmux_ops,
	.owner = THIS_MODULE,
};

static int nuc980_read_pins(struct pinctrl_dev *pctldev,
			    const struct device_node *np, int npins, int *pins,
			    u32 *functions)
{
	int i, k;

	for (i = 0; i < npins; i++) {
		u32 cell[CELLS];

		for (k = 0; k < CELLS; k++)
			of_property_read_u32_index(np, "nuvoton,pins",
						   CELLS * i + k, &cell[k]);

		pins[i] = NUC980_BANK_PINS * cell[CELL_BANK] + cell[CELL_PIN];
		functions[i] = cell[CELL_FUNCTION];

		if (cell[CELL_BANK] >= NUC980_BANKS ||
		    cell[CELL_PIN] >= NUC980_BANK_PINS ||
		    !pin_desc_get(pctldev, pins[i])) {
			dev_err(pctldev->dev, "%pOF: there is no pin <%u %u>\n",
				np, cell[CELL_BANK], cell[CELL_PIN]);
			return -EINVAL;
		}
	}

	return 0;
}

/* Returns the name of the group, which is unique as that of a node is not */
static const char *nuc980_add_group(struct pinctrl_dev *pctldev,
				    const struct device_node *np)
{
	struct device *dev = pctldev->dev;
	struct nuc980_group *group;
	const char *name;
	int npins, ret;
	int *pins;

	npins = of_property_count_elems_of_size(np, "nuvoton,pins",
						CELLS * sizeof(u32));
	if (npins <= 0) {
		dev_err(dev, "%pOF: no nuvoton,pins with %d cells for each\n",
			np, CELLS);
		return ERR_PTR(-EINVAL);
	}

	name = devm_kasprintf(dev, GFP_KERNEL, "%pOFn.%pOFn", np->parent, np);
	pins = devm_kcalloc(dev, npins, sizeof(*pins), GFP_KERNEL);
	group = devm_kzalloc(dev, struct_size(group, functions, npins),
			     GFP_KERNEL);
	if (!name || !pins || !group)
		return ERR_PTR(-ENOMEM);

	group->np = np;
	ret = nuc980_read_pins(pctldev, np, npins, pins, group->functions);
	if (ret)
		return ERR_PTR(ret);

	ret = pinctrl_generic_add_group(pctldev, name, pins, npins, group);

	return ret < 0 ? ERR_PTR(ret) : name;
}

/* A group that is wrong is left out, and only the device that wants it fails */
static int nuc980_add_function(struct pinctrl_dev *pctldev,
			       struct device_node *np)
{
	struct device_node *child;
	unsigned int ngroups = 0;
	const char **groups;
	int ret;

	groups = devm_kcalloc(pctldev->dev, of_get_child_count(np),
			      sizeof(*groups), GFP_KERNEL);
	if (!groups)
		return -ENOMEM;

	for_each_child_of_node(np, child) {
		const char *name = nuc980_add_group(pctldev, child);

		if (name == ERR_PTR(-ENOMEM)) {
			of_node_put(child);
			return -ENOMEM;
		}
		if (!IS_ERR(name))
			groups[ngroups++] = name;
	}

	ret = pinmux_generic_add_function(pctldev, np->name, groups, ngroups,
					  NULL);

	return min(ret, 0);
}

static int nuc980_pinctrl_probe(struct platform_device *pdev)
{
	struct device *dev = &pdev->dev;
	struct nuc980_pinctrl *pc;
	struct device_node *child;
	int ret;

	pc = devm_kzalloc(dev, sizeof(*pc), GFP_KERNEL);
	if (!pc)
		return -ENOMEM;

	spin_lock_init(&pc->lock);

	pc->base = devm_platform_ioremap_resource(pdev, 0);
	if (IS_ERR(pc->base))
		return PTR_ERR(pc->base);

	ret = devm_pinctrl_register_and_init(dev, &nuc980_pinctrl_desc, pc,
					     &pc->pctldev);
	if (ret)
		return dev_err_probe(dev, ret, "cannot register\n");

	for_each_child_of_node(dev->of_node, child) {
		ret = nuc980_add_function(pc->pctldev, child);
		if (ret) {
			of_node_put(child);
			return ret;
		}
	}

	return pinctrl_enable(pc->pctldev);
}

static const struct of_device_id nuc980_pinctrl_of_match[] = {
	{ .compatible = "nuvoton,nuc980-pinctrl" },
	{ }
};

static struct platform_driver nuc980_pinctrl_driver = {
	.driver = {
		.name = "nuc980-pinctrl",
		.of_match_table = nuc980_pinctrl_of_match,
		.suppress_bind_attrs = true,
	},
	.probe = nuc980_pinctrl_probe,
};

/* Before the devices come into being: a console that waits is a late one */
static int __init nuc980_pinctrl_init(void)
{
	return platform_driver_register(&nuc980_pinctrl_driver);
}
arch_initcall(nuc980_pinctrl_init);
