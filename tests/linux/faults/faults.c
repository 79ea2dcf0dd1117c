// SPDX-License-Identifier: GPL-2.0-only
/*
 * One fault of each kind that the debug kernel must notice; the parameter says
 * which. The module is never loaded to the end.
 */

#include <linux/dma-mapping.h>
#include <linux/module.h>
#include <linux/mutex.h>
#include <linux/platform_device.h>
#include <linux/slab.h>
#include <linux/spinlock.h>
#include <linux/timer.h>

#define SIZE	64

static char *fault;
module_param(fault, charp, 0);

static DEFINE_MUTEX(first);
static DEFINE_MUTEX(second);
static DEFINE_RAW_SPINLOCK(spinning);
static DEFINE_SPINLOCK(sleeping);

/* The mapping ends twice */
static void fault_dma(void)
{
	struct platform_device *pdev;
	void *memory = kmalloc(SIZE, GFP_KERNEL);
	dma_addr_t addr;

	pdev = platform_device_register_simple("faults", -1, NULL, 0);
	if (memory && !IS_ERR(pdev) &&
	    !dma_coerce_mask_and_coherent(&pdev->dev, DMA_BIT_MASK(32))) {
		addr = dma_map_single(&pdev->dev, memory, SIZE, DMA_TO_DEVICE);
		if (!dma_mapping_error(&pdev->dev, addr)) {
			dma_unmap_single(&pdev->dev, addr, SIZE, DMA_TO_DEVICE);
			dma_unmap_single(&pdev->dev, addr, SIZE, DMA_TO_DEVICE);
		}
	}
	platform_device_unregister(pdev);
	kfree(memory);
}

static void fault_order(void)
{
	mutex_lock(&first);
	mutex_lock(&second);
	mutex_unlock(&second);
	mutex_unlock(&first);

	mutex_lock(&second);
	mutex_lock(&first);
	mutex_unlock(&first);
	mutex_unlock(&second);
}

/* On PREEMPT_RT the inner one sleeps */
static void fault_nesting(void)
{
	raw_spin_lock(&spinning);
	spin_lock(&sleeping);
	spin_unlock(&sleeping);
	raw_spin_unlock(&spinning);
}

static void fault_sleep(void)
{
	preempt_disable();
	might_sleep();
	preempt_enable();
}

/* Written after it was freed; the cache's check finds it */
static void fault_freed(void)
{
	struct kmem_cache *cache = kmem_cache_create("faults", SIZE, 0, 0, NULL);
	u8 *memory = kmem_cache_alloc(cache, GFP_KERNEL);

	kmem_cache_free(cache, memory);
	memory[SIZE / 2] = 1;
	kmem_cache_destroy(cache);
}

static void fault_timer_expired(struct timer_list *timer)
{
}

/* Freed while it runs */
static void fault_timer(void)
{
	struct timer_list *timer = kmalloc(sizeof(*timer), GFP_KERNEL);

	timer_setup(timer, fault_timer_expired, 0);
	mod_timer(timer, jiffies + HZ);
	kfree(timer);
}

static const struct {
	const char *name;
	void (*make)(void);
} faults[] = {
	{ "dma", fault_dma },
	{ "order", fault_order },
	{ "nesting", fault_nesting },
	{ "sleep", fault_sleep },
	{ "freed", fault_freed },
	{ "timer", fault_timer },
};

static int __init faults_init(void)
{
	unsigned int i;

	for (i = 0; i < ARRAY_SIZE(faults); i++) {
		if (fault && !strcmp(fault, faults[i].name)) {
			faults[i].make();
			return -ECANCELED;
		}
	}
	return -EINVAL;
}
module_init(faults_init);

MODULE_DESCRIPTION("Faults for the tests of the debug kernel");
MODULE_LICENSE("GPL");
