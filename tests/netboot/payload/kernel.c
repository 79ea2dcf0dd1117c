/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Prints what a Linux prints from its banner to its login, with what it finds in its device tree. On request of the
 * command line, or of the tree's /chosen/payload, it ends otherwise: payload=oops, panic, noroot, hang, reset, mute;
 * slow takes seconds before the login; cuts says U-Boot's last words, cut off at each of their characters, and after
 * each the kernel's first.
 */
#include "kernel.h"

#include <stdarg.h>
#include <stdbool.h>

static void put_number(uint32_t value, unsigned base, unsigned width)
{
	char digits[10];
	unsigned n = 0;

	do {
		digits[n++] = "0123456789abcdef"[value % base];
		value /= base;
	} while (value || n < width);
	while (n)
		put(digits[--n]);
}

/* Knows %s, %u, and %x, which is of two digits at least. */
static void say(const char *format, ...) __attribute__((format(printf, 1, 2)));

static void say(const char *format, ...)
{
	va_list values;

	va_start(values, format);
	for (; *format; format++) {
		if (*format == '\n')
			put('\r');
		if (*format != '%') {
			put(*format);
			continue;
		}
		switch (*++format) {
		case 's':
			for (const char *text = va_arg(values, const char *); *text; text++)
				put(*text);
			break;
		case 'u':
			put_number(va_arg(values, uint32_t), 10, 1);
			break;
		case 'x':
			put_number(va_arg(values, uint32_t), 16, 2);
			break;
		}
	}
	va_end(values);
}

static bool holds(const char *text, const char *word)
{
	for (; *text; text++) {
		const char *a = text, *b = word;

		while (*b && *a == *b) {
			a++;
			b++;
		}
		if (!*b)
			return true;
	}
	return false;
}

static const char *text_of(const void *tree, const char *path, const char *name)
{
	uint32_t size;
	const char *text = tree_property(tree, path, name, &size);

	return text ? text : "";
}

static void show_ethernet(const void *tree, unsigned port)
{
	const char alias[] = {'e', 't', 'h', 'e', 'r', 'n', 'e', 't', (char)('0' + port), '\0'};
	const char *path = text_of(tree, "/aliases", alias);
	uint32_t size;
	const uint8_t *mac = tree_property(tree, path, "local-mac-address", &size);

	if (!*path || !mac || size != 6)
		say("[    0.310000] eth%u: no address\n", port);
	else
		say("[    0.310000] eth%u: %x:%x:%x:%x:%x:%x\n", port, mac[0], mac[1], mac[2], mac[3], mac[4],
		    mac[5]);
}

static void show_trace(void)
{
	say("[    0.420000] CPU: 0 PID: 1 Comm: swapper Not tainted 5.10.140-payload #1\n"
	    "[    0.420000] [<c00104e4>] (unwind_backtrace) from [<c000e3a8>] (show_stack+0x10/0x14)\n"
	    "[    0.420000] [<c000e3a8>] (show_stack) from [<c04ff010>] (panic+0xe0/0x2e4)\n");
}

static void panic(const char *why)
{
	say("[    0.420000] Kernel panic - not syncing: %s\n", why);
	show_trace();
	say("[    0.430000] ---[ end Kernel panic - not syncing: %s ]---\n", why);
}

static void oops(void)
{
	say("[    0.420000] 8<--- cut here ---\n"
	    "[    0.420000] Unable to handle kernel NULL pointer dereference at virtual address 00000000\n"
	    "[    0.420000] Internal error: Oops: 5 [#1] ARM\n");
	show_trace();
	say("[    0.430000] ---[ end trace 0123456789abcdef ]---\n");
}

static void cuts(void)
{
	static const char words[] = "\n\rStarting kernel ...\n\r\n\r";

	for (unsigned kept = 0; kept < sizeof(words); kept++) {
		say("<cut>");
		for (unsigned n = 0; n < sizeof(words) - 1; n++) {
			if (n == kept)
				close_console();
			put(words[n]);
		}
		open_console();
		say("[    0.000000] Booting Linux on physical CPU 0x0\n");
	}
	say("<end of cuts>\n");
}

/* U-Boot puts its own arguments into a tree, but leaves the rest of it alone. */
static bool asked(const void *tree, const char *end)
{
	return holds(text_of(tree, "/chosen", "bootargs"), end) ||
	       holds(text_of(tree, "/chosen", "payload"), end);
}

/* From head.S; it halts when this returns. */
void kernel(uint32_t zero, uint32_t machine, const void *tree);

void kernel(uint32_t zero, uint32_t machine, const void *tree)
{
	const char *arguments = text_of(tree, "/chosen", "bootargs");

	if (zero != 0 || asked(tree, "payload=mute"))
		return; /* to an endless loop */
	open_console();
	if (asked(tree, "payload=cuts"))
		return cuts();
	say("[    0.000000] Booting Linux on physical CPU 0x0\n"
	    "[    0.000000] Linux version 5.10.140-payload (bare metal) #1 PREEMPT_RT\n"
	    "[    0.000000] CPU: ARM926EJ-S [41069265] revision 5 (ARMv5TEJ), cr=00053177\n"
	    "[    0.000000] OF: fdt: Machine model: %s\n"
	    "[    0.000000] Machine number: %x\n"
	    "[    0.000000] Kernel command line: %s\n",
	    text_of(tree, "/", "model"), machine, arguments);
	for (unsigned port = 0; port < 2; port++)
		show_ethernet(tree, port);
	if (asked(tree, "payload=oops"))
		return oops();
	if (asked(tree, "payload=panic"))
		return panic("Attempted to kill init! exitcode=0x0000000b");
	if (asked(tree, "payload=noroot"))
		return panic("VFS: Unable to mount root fs on unknown-block(0,0)");
	if (asked(tree, "payload=hang"))
		return;
	if (asked(tree, "payload=reset"))
		return restart();
	if (asked(tree, "payload=slow"))
		wait_seconds(4);
	say("[    0.500000] Run /init as init process\n\n\nnuc980 login: ");
}
