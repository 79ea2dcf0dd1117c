/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * The NAND flash as the vendor's driver uses it: identifier, a block erased, a page written with parity of BCH T8 and
 * read again; then one bit of the flash is turned, and the controller must say which.
 */
#include "board.h"

#define PAGE     2048
#define SPARE    64
#define PARITY   60 /* the end of the spare bytes: 4 fields of 512 bytes, 15 each */
#define ROW      (64 * 20 + 3)
#define LAST     BIT(31)
#define PREPARED (NAND_CTL_2K | NAND_CTL_T8 | NAND_CTL_ECC | NAND_CTL_SPARE | NAND_CTL_3B)

static uint8_t out[PAGE] __attribute__((aligned(4))), in[PAGE] __attribute__((aligned(4)));
static volatile uint32_t done, ecc_events, fields;

static void serve(void)
{
	const uint32_t status = NAND_INTSTS;

	if (status & NAND_ECC_EVENT) {
		ecc_events++;
		fields = NAND_ECCSTS(0);
	}
	if (status & NAND_DONE)
		done++;
	NAND_INTSTS = status & (NAND_DONE | NAND_ECC_EVENT);
}

static void command(uint32_t code)
{
	NAND_INTSTS = NAND_READY;
	NAND_CMD = code;
}

static void wait_ready(void)
{
	while (!(NAND_INTSTS & NAND_READY))
		;
	NAND_INTSTS = NAND_READY;
}

static void at(uint32_t column)
{
	NAND_ADDR = column & 0xff;
	NAND_ADDR = column >> 8;
	NAND_ADDR = ROW & 0xff;
	NAND_ADDR = ROW >> 8 | LAST;
}

static void transfer(uint8_t *memory, uint32_t direction)
{
	const uint32_t before = done;

	FMI_DMACTL = 3;
	FMI_DMACTL = 1;
	FMI_DMASA = (uint32_t)(uintptr_t)memory;
	NAND_CTL |= direction;
	while (done == before)
		;
}

static uint32_t status(void)
{
	command(0x70);
	return NAND_DATA;
}

static void identify(void)
{
	command(0xff);
	wait_ready();
	command(0x90);
	NAND_ADDR = LAST;
	say("id");
	for (unsigned i = 0; i < 4; i++)
		say(" %x", NAND_DATA & 0xff);
	say("\n");
}

static void erase(void)
{
	NAND_ECTL = 1;
	command(0x60);
	NAND_ADDR = ROW & 0xff;
	NAND_ADDR = ROW >> 8 | LAST;
	command(0xd0);
	wait_ready();
	say("erased, status %x\n", status());
}

static void spare_clear(void)
{
	for (unsigned i = 0; i < SPARE / 4; i++)
		NAND_RA(i) = 0xffffffff;
	NAND_RA(0) = 0x0000ffff; /* bytes 2 and 3 mark a written page */
}

static void write(void)
{
	spare_clear();
	NAND_ECTL = 1;
	command(0x80);
	at(0);
	transfer(out, NAND_CTL_WRITE);
	command(0x10);
	wait_ready();
	say("written, status %x\n", status());
}

/* As the driver reads: the spare bytes first, into the controller's buffer, then the data. */
static void read(void)
{
	uint32_t word = 0, wrong = 0;

	NAND_ECTL = 0;
	command(0x00);
	at(PAGE);
	command(0x30);
	wait_ready();
	for (unsigned i = 0; i < SPARE; i++) {
		word |= (NAND_DATA & 0xff) << i % 4 * 8;
		if (i % 4 == 3) {
			NAND_RA(i / 4) = word;
			word = 0;
		}
	}
	command(0x00);
	at(0);
	command(0x30);
	wait_ready();
	ecc_events = fields = 0;
	transfer(in, NAND_CTL_READ);
	for (unsigned i = 0; i < PAGE; i++)
		wrong += in[i] != out[i];
	say("read, wrong bytes %u, ecc events %u, fields %x\n", wrong, ecc_events, fields);
}

/* One bit of byte 700 to 0, by programming the page once more past the parity unit. */
static void turn_a_bit(void)
{
	NAND_ECTL = 1;
	command(0x80);
	at(700);
	NAND_DATA = out[700] & (out[700] - 1);
	command(0x10);
	wait_ready();
}

void probe(void)
{
	for (unsigned pin = 1; pin < 16; pin++)
		pin_select('C', pin, 3);
	for (unsigned i = 0; i < PAGE; i++)
		out[i] = (uint8_t)(i * 7 + i / 256 + 1);
	FMI_CTL = BIT(3);
	NAND_CTL = NAND_CTL_RST;
	NAND_CTL = PREPARED | NAND_CTL_CS1;
	NAND_RACTL = SPARE;
	NAND_INTEN = NAND_DONE | NAND_ECC_EVENT;
	irq_handle(IRQ_FMI, serve);
	interrupts_on();
	identify();
	erase();
	write();
	read();
	turn_a_bit();
	read();
	erase();
}
