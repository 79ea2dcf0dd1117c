// SPDX-License-Identifier: GPL-2.0-or-later
/*
 * Nuvoton NUC980 pin multiplexer
 *
 * A pin group is a node with cells of four in its property nuvoton,pins: bank
 * (0 is A), pin, function, and one that is not used.
 */

#include <common.h>
#include <dm.h>
#include <dm/device_compat.h>
#include <dm/pinctrl.h>
#include <asm/io.h>
#include <linux/bitops.h>

#define SYS_PWRON		0x04
#define SYS_PWRON_JTAGSEL	BIT(4)

/* Four bits a pin, eight pins a register, two registers a bank */
#define SYS_MFP(bank, pin)	(0x70 + 8 * (bank) + 4 * ((pin) / 8))
#define SYS_MFP_SHIFT(pin)	(4 * ((pin) % 8))
#define SYS_MFP_PINS(l, h)	GENMASK(SYS_MFP_SHIFT(h) + 3, SYS_MFP_SHIFT(l))

#define BANKS			7
#define PINS			16
#define FUNCTIONS		16

enum { BANK_A, BANK_G = 6 };

struct nuc980_pinctrl {
	void __iomem *base;
};

static int nuc980_pinctrl_set_state(struct udevice *dev, struct udevice *config)
{
	struct nuc980_pinctrl *priv = dev_get_priv(dev);
	ofnode node = dev_ofnode(config);
	u32 cell[4];
	int i, size;

	size = ofnode_read_size(node, "nuvoton,pins");
	if (size <= 0 || size % sizeof(cell))
		return -EINVAL;

	for (i = 0; i < size / sizeof(u32); i += ARRAY_SIZE(cell)) {
		int k;

		for (k = 0; k < ARRAY_SIZE(cell); k++)
			ofnode_read_u32_index(node, "nuvoton,pins", i + k,
					      &cell[k]);

		if (cell[0] >= BANKS || cell[1] >= PINS || cell[2] >= FUNCTIONS) {
			dev_err(dev, "%s: no pin <%u %u %u>\n", config->name,
				cell[0], cell[1], cell[2]);
			return -EINVAL;
		}

		clrsetbits_le32(priv->base + SYS_MFP(cell[0], cell[1]),
				(FUNCTIONS - 1) << SYS_MFP_SHIFT(cell[1]),
				cell[2] << SYS_MFP_SHIFT(cell[1]));
	}

	return 0;
}

static int nuc980_pinctrl_probe(struct udevice *dev)
{
	struct nuc980_pinctrl *priv = dev_get_priv(dev);

	priv->base = dev_read_addr_ptr(dev);

	return priv->base ? 0 : -EINVAL;
}

/*
 * The vendor's U-Boot leaves every pin a GPIO but those of JTAG when it starts
 * Linux, so that nothing depends on what a boot loader used. A device tree that
 * forgets a pin must fail with this one as it does with that one.
 */
static int nuc980_pinctrl_remove(struct udevice *dev)
{
	struct nuc980_pinctrl *priv = dev_get_priv(dev);
	bool jtag_on_g = readl(priv->base + SYS_PWRON) & SYS_PWRON_JTAGSEL;
	int bank, pin;

	/* The console loses its pins too: let its last line out first. */
	flush();

	for (bank = 0; bank < BANKS; bank++) {
		for (pin = 0; pin < PINS; pin += 8) {
			u32 keep = 0;

			if (jtag_on_g && bank == BANK_G && pin == 8)
				keep = SYS_MFP_PINS(11, 15);
			if (!jtag_on_g && bank == BANK_A && pin == 0)
				keep = SYS_MFP_PINS(2, 6);

			clrbits_le32(priv->base + SYS_MFP(bank, pin), ~keep);
		}
	}

	return 0;
}

static const struct pinctrl_ops nuc980_pinctrl_ops = {
	.set_state = nuc980_pinctrl_set_state,
};

static const struct udevice_id nuc980_pinctrl_ids[] = {
	{ .compatible = "nuvoton,nuc980-pinctrl" },
	{ }
};

U_BOOT_DRIVER(nuc980_pinctrl) = {
	.name = "nuc980_pinctrl",
	.id = UCLASS_PINCTRL,
	.of_match = nuc980_pinctrl_ids,
	.priv_auto = sizeof(struct nuc980_pinctrl),
	.probe = nuc980_pinctrl_probe,
	.remove = nuc980_pinctrl_remove,
	.ops = &nuc980_pinctrl_ops,
	/* Removed before Linux starts, after all others */
	.flags = DM_FLAG_OS_PREPARE | DM_FLAG_VITAL,
};
