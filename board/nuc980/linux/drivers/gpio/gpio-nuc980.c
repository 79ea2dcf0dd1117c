// SPDX-License-Identifier: GPL-2.0-only
/*
 * Nuvoton NUC980 GPIO
 *
 * Seven banks of up to 16 pins behind one device. The device trees count 32
 * lines a bank: PB0 is line 32.
 */

#include <linux/bitmap.h>
#include <linux/bits.h>
#include <linux/clk.h>
#include <linux/gpio/driver.h>
#include <linux/io.h>
#include <linux/irq.h>
#include <linux/irqchip/chained_irq.h>
#include <linux/module.h>
#include <linux/of.h>
#include <linux/pinctrl/pinconf-generic.h>
#include <linux/platform_device.h>
#include <linux/spinlock.h>

#define NUC980_BANKS		7
#define NUC980_BANK_LINES	32
#define NUC980_BANK_PINS	16	/* the pin controller counts these */
#define NUC980_LINES		(NUC980_BANKS * NUC980_BANK_LINES)

#define GPIO_BANK(bank)		(0x40 * (bank))
#define GPIO_MODE		0x00	/* two bits a pin */
#define GPIO_MODE_INPUT		0
#define GPIO_MODE_OUTPUT	1
#define GPIO_INTTYPE		0x18	/* set: level, else edge */
#define GPIO_INTEN		0x1c
#define GPIO_INTEN_LOW(pin)	BIT(pin)
#define GPIO_INTEN_HIGH(pin)	BIT((pin) + 16)
#define GPIO_INTSRC		0x20	/* cleared by writing ones */
#define GPIO_PUSEL		0x30	/* two bits a pin */
#define GPIO_PUSEL_NONE		0
#define GPIO_PUSEL_UP		1
#define GPIO_PUSEL_DOWN		2

/* A word for each pin: its level when read, its output when written */
#define GPIO_PDIO(bank, pin)	(0x800 + 0x40 * (bank) + 4 * (pin))

#define TWO_BITS(pin)		(GENMASK(1, 0) << (2 * (pin)))

struct nuc980_gpio;

struct nuc980_gpio_bank {
	struct nuc980_gpio *gpio;
	void __iomem *base;
	unsigned int first_line;
};

struct nuc980_gpio {
	struct gpio_chip chip;
	void __iomem *base;
	struct nuc980_gpio_bank bank[NUC980_BANKS];
	void *handler_data[NUC980_BANKS];
	unsigned int irq[NUC980_BANKS];
	/*
	 * Of the registers that a bank's pins share. Raw: interrupts are masked
	 * under the raw lock of their descriptor.
	 */
	raw_spinlock_t lock;
};

/* Lines without a name are no pins */
static const char *const nuc980_gpio_names[NUC980_LINES] = {
	[32 * 0] = "PA0", "PA1", "PA2", "PA3", "PA4", "PA5", "PA6", "PA7",
		   "PA8", "PA9", "PA10", "PA11", "PA12", "PA13", "PA14", "PA15",
	[32 * 1] = "PB0", "PB1", "PB2", "PB3", "PB4", "PB5", "PB6", "PB7",
		   "PB8", "PB9", "PB10", "PB11", "PB12", "PB13",
	[32 * 2] = "PC0", "PC1", "PC2", "PC3", "PC4", "PC5", "PC6", "PC7",
		   "PC8", "PC9", "PC10", "PC11", "PC12", "PC13", "PC14", "PC15",
	[32 * 3] = "PD0", "PD1", "PD2", "PD3", "PD4", "PD5", "PD6", "PD7",
		   "PD8", "PD9", "PD10", "PD11", "PD12", "PD13", "PD14", "PD15",
	[32 * 4] = "PE0", "PE1", "PE2", "PE3", "PE4", "PE5", "PE6", "PE7",
		   "PE8", "PE9", "PE10", "PE11", "PE12",
	[32 * 5] = "PF0", "PF1", "PF2", "PF3", "PF4", "PF5", "PF6", "PF7",
		   "PF8", "PF9", "PF10", "PF11", "PF12",
	[32 * 6] = "PG0", "PG1", "PG2", "PG3", "PG4", "PG5", "PG6", "PG7",
		   "PG8", "PG9", "PG10", "PG11", "PG12", "PG13", "PG14", "PG15",
};

static struct nuc980_gpio_bank *nuc980_bank(struct gpio_chip *chip,
					    unsigned int line)
{
	struct nuc980_gpio *gpio = gpiochip_get_data(chip);

	return &gpio->bank[line / NUC980_BANK_LINES];
}

static void __iomem *nuc980_pdio(struct gpio_chip *chip, unsigned int line)
{
	struct nuc980_gpio *gpio = gpiochip_get_data(chip);

	return gpio->base + GPIO_PDIO(line / NUC980_BANK_LINES,
				      line % NUC980_BANK_LINES);
}

static void nuc980_update(struct nuc980_gpio_bank *bank, unsigned int reg,
			  u32 mask, u32 value)
{
	unsigned long flags;

	raw_spin_lock_irqsave(&bank->gpio->lock, flags);
	writel((readl(bank->base + reg) & ~mask) | value, bank->base + reg);
	raw_spin_unlock_irqrestore(&bank->gpio->lock, flags);
}

/* Of the registers that have two bits for each pin */
static void nuc980_update_pair(struct gpio_chip *chip, unsigned int line,
			       unsigned int reg, u32 value)
{
	unsigned int pin = line % NUC980_BANK_LINES;

	nuc980_update(nuc980_bank(chip, line), reg, TWO_BITS(pin),
		      value << (2 * pin));
}

static int nuc980_gpio_get_direction(struct gpio_chip *chip, unsigned int line)
{
	u32 modes = readl(nuc980_bank(chip, line)->base + GPIO_MODE);

	if (modes & TWO_BITS(line % NUC980_BANK_LINES))
		return GPIO_LINE_DIRECTION_OUT;

	return GPIO_LINE_DIRECTION_IN;
}

static int nuc980_gpio_direction_input(struct gpio_chip *chip,
				       unsigned int line)
{
	nuc980_update_pair(chip, line, GPIO_MODE, GPIO_MODE_INPUT);

	return 0;
}

static int nuc980_gpio_get(struct gpio_chip *chip, unsigned int line)
{
	return readl(nuc980_pdio(chip, line)) & 1;
}

static void nuc980_gpio_set(struct gpio_chip *chip, unsigned int line,
			    int value)
{
	writel(!!value, nuc980_pdio(chip, line));
}

/* The level comes first, so that the pin never shows another */
static int nuc980_gpio_direction_output(struct gpio_chip *chip,
					unsigned int line, int value)
{
	nuc980_gpio_set(chip, line, value);
	nuc980_update_pair(chip, line, GPIO_MODE, GPIO_MODE_OUTPUT);

	return 0;
}

static int nuc980_gpio_set_config(struct gpio_chip *chip, unsigned int line,
				  unsigned long config)
{
	u32 pull;

	switch (pinconf_to_config_param(config)) {
	case PIN_CONFIG_BIAS_DISABLE:
		pull = GPIO_PUSEL_NONE;
		break;
	case PIN_CONFIG_BIAS_PULL_UP:
		pull = GPIO_PUSEL_UP;
		break;
	case PIN_CONFIG_BIAS_PULL_DOWN:
		pull = GPIO_PUSEL_DOWN;
		break;
	default:
		return -ENOTSUPP;
	}

	nuc980_update_pair(chip, line, GPIO_PUSEL, pull);

	return 0;
}

static int nuc980_gpio_init_valid_mask(struct gpio_chip *chip,
				       unsigned long *valid_mask,
				       unsigned int nlines)
{
	unsigned int line;

	for (line = 0; line < nlines; line++)
		__assign_bit(line, valid_mask, nuc980_gpio_names[line]);

	return 0;
}

/* The device trees say nothing of the pin controller: the chip has but one */
static int nuc980_gpio_add_pin_ranges(struct gpio_chip *chip)
{
	struct device_node *np;
	struct pinctrl_dev *pctldev;
	int bank, ret;

	np = of_find_compatible_node(NULL, NULL, "nuvoton,nuc980-pinctrl");
	pctldev = of_pinctrl_get(np);
	of_node_put(np);
	if (!pctldev)
		return -EPROBE_DEFER;

	for (bank = 0; bank < NUC980_BANKS; bank++) {
		ret = gpiochip_add_pin_range(chip,
					     pinctrl_dev_get_devname(pctldev),
					     bank * NUC980_BANK_LINES,
					     bank * NUC980_BANK_PINS,
					     NUC980_BANK_PINS);
		if (ret)
			return ret;
	}

	return 0;
}

static void nuc980_gpio_irq_ack(struct irq_data *d)
{
	struct gpio_chip *chip = irq_data_get_irq_chip_data(d);
	irq_hw_number_t line = irqd_to_hwirq(d);

	writel(BIT(line % NUC980_BANK_LINES),
	       nuc980_bank(chip, line)->base + GPIO_INTSRC);
}

static void nuc980_gpio_irq_mask(struct irq_data *d)
{
	struct gpio_chip *chip = irq_data_get_irq_chip_data(d);
	irq_hw_number_t line = irqd_to_hwirq(d);
	unsigned int pin = line % NUC980_BANK_LINES;

	nuc980_update(nuc980_bank(chip, line), GPIO_INTEN,
		      GPIO_INTEN_LOW(pin) | GPIO_INTEN_HIGH(pin), 0);
	gpiochip_disable_irq(chip, line);
}

static void nuc980_gpio_irq_unmask(struct irq_data *d)
{
	struct gpio_chip *chip = irq_data_get_irq_chip_data(d);
	irq_hw_number_t line = irqd_to_hwirq(d);
	unsigned int pin = line % NUC980_BANK_LINES;
	u32 type = irqd_get_trigger_type(d);
	u32 enable = 0;

	if (type & (IRQ_TYPE_EDGE_FALLING | IRQ_TYPE_LEVEL_LOW))
		enable |= GPIO_INTEN_LOW(pin);
	if (type & (IRQ_TYPE_EDGE_RISING | IRQ_TYPE_LEVEL_HIGH))
		enable |= GPIO_INTEN_HIGH(pin);

	gpiochip_enable_irq(chip, line);
	nuc980_update(nuc980_bank(chip, line), GPIO_INTEN, 0, enable);
}

static int nuc980_gpio_irq_set_type(struct irq_data *d, unsigned int type)
{
	struct gpio_chip *chip = irq_data_get_irq_chip_data(d);
	irq_hw_number_t line = irqd_to_hwirq(d);
	u32 bit = BIT(line % NUC980_BANK_LINES);

	switch (type) {
	case IRQ_TYPE_EDGE_FALLING:
	case IRQ_TYPE_EDGE_RISING:
	case IRQ_TYPE_EDGE_BOTH:
		nuc980_update(nuc980_bank(chip, line), GPIO_INTTYPE, bit, 0);
		irq_set_handler_locked(d, handle_edge_irq);
		return 0;
	case IRQ_TYPE_LEVEL_LOW:
	case IRQ_TYPE_LEVEL_HIGH:
		nuc980_update(nuc980_bank(chip, line), GPIO_INTTYPE, 0, bit);
		irq_set_handler_locked(d, handle_level_irq);
		return 0;
	default:
		return -EINVAL;
	}
}

static const struct irq_chip nuc980_gpio_irq_chip = {
	.name = "nuc980-gpio",
	.irq_ack = nuc980_gpio_irq_ack,
	.irq_mask = nuc980_gpio_irq_mask,
	.irq_unmask = nuc980_gpio_irq_unmask,
	.irq_set_type = nuc980_gpio_irq_set_type,
	.flags = IRQCHIP_IMMUTABLE | IRQCHIP_SET_TYPE_MASKED,
	GPIOCHIP_IRQ_RESOURCE_HELPERS,
};

static void nuc980_gpio_irq_handler(struct irq_desc *desc)
{
	struct nuc980_gpio_bank *bank = irq_desc_get_handler_data(desc);
	struct irq_domain *domain = bank->gpio->chip.irq.domain;
	struct irq_chip *parent = irq_desc_get_chip(desc);
	unsigned long pending;
	unsigned int pin;

	chained_irq_enter(parent, desc);

	pending = readl(bank->base + GPIO_INTSRC);
	for_each_set_bit(pin, &pending, NUC980_BANK_PINS)
		generic_handle_domain_irq(domain, bank->first_line + pin);

	chained_irq_exit(parent, desc);
}

/* What a boot loader has left on would have no handler here */
static int nuc980_gpio_irq_init_hw(struct gpio_chip *chip)
{
	struct nuc980_gpio *gpio = gpiochip_get_data(chip);
	int i;

	for (i = 0; i < NUC980_BANKS; i++) {
		writel(0, gpio->bank[i].base + GPIO_INTEN);
		writel(GENMASK(15, 0), gpio->bank[i].base + GPIO_INTSRC);
	}

	return 0;
}

static int nuc980_gpio_init_irq(struct platform_device *pdev,
				struct nuc980_gpio *gpio)
{
	struct gpio_irq_chip *girq = &gpio->chip.irq;
	int i, irq;

	for (i = 0; i < NUC980_BANKS; i++) {
		irq = platform_get_irq(pdev, i);
		if (irq < 0)
			return irq;
		gpio->irq[i] = irq;
		gpio->handler_data[i] = &gpio->bank[i];
	}

	gpio_irq_chip_set_chip(girq, &nuc980_gpio_irq_chip);
	girq->handler = handle_bad_irq;
	girq->default_type = IRQ_TYPE_NONE;
	girq->parent_handler = nuc980_gpio_irq_handler;
	girq->parent_handler_data_array = gpio->handler_data;
	girq->per_parent_data = true;
	girq->parents = gpio->irq;
	girq->num_parents = NUC980_BANKS;
	girq->init_hw = nuc980_gpio_irq_init_hw;

	return 0;
}

static int nuc980_gpio_probe(struct platform_device *pdev)
{
	struct device *dev = &pdev->dev;
	struct nuc980_gpio *gpio;
	struct clk *clk;
	int i, ret;

	gpio = devm_kzalloc(dev, sizeof(*gpio), GFP_KERNEL);
	if (!gpio)
		return -ENOMEM;

	raw_spin_lock_init(&gpio->lock);

	gpio->base = devm_platform_ioremap_resource(pdev, 0);
	if (IS_ERR(gpio->base))
		return PTR_ERR(gpio->base);

	clk = devm_clk_get_enabled(dev, NULL);
	if (IS_ERR(clk))
		return dev_err_probe(dev, PTR_ERR(clk), "no clock\n");

	for (i = 0; i < NUC980_BANKS; i++) {
		gpio->bank[i].gpio = gpio;
		gpio->bank[i].base = gpio->base + GPIO_BANK(i);
		gpio->bank[i].first_line = i * NUC980_BANK_LINES;
	}

	gpio->chip = (struct gpio_chip) {
		.label = dev_name(dev),
		.parent = dev,
		.owner = THIS_MODULE,
		.base = -1,
		.ngpio = NUC980_LINES,
		.names = nuc980_gpio_names,
		.init_valid_mask = nuc980_gpio_init_valid_mask,
		.add_pin_ranges = nuc980_gpio_add_pin_ranges,
		.request = gpiochip_generic_request,
		.free = gpiochip_generic_free,
		.get_direction = nuc980_gpio_get_direction,
		.direction_input = nuc980_gpio_direction_input,
		.direction_output = nuc980_gpio_direction_output,
		.get = nuc980_gpio_get,
		.set = nuc980_gpio_set,
		.set_config = nuc980_gpio_set_config,
	};

	ret = nuc980_gpio_init_irq(pdev, gpio);
	if (ret)
		return ret;

	return devm_gpiochip_add_data(dev, &gpio->chip, gpio);
}

static const struct of_device_id nuc980_gpio_of_match[] = {
	{ .compatible = "nuvoton,nuc980-gpio" },
	{ }
};
MODULE_DEVICE_TABLE(of, nuc980_gpio_of_match);

static struct platform_driver nuc980_gpio_driver = {
	.driver = {
		.name = "nuc980-gpio",
		.of_match_table = nuc980_gpio_of_match,
	},
	.probe = nuc980_gpio_probe,
};
module_platform_driver(nuc980_gpio_driver);

MODULE_DESCRIPTION("Nuvoton NUC980 GPIO");
MODULE_LICENSE("GPL");
