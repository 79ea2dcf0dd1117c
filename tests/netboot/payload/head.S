/* SPDX-License-Identifier: GPL-3.0-or-later */
/* As a kernel is entered: r0 is 0, r1 the machine's number, r2 the device tree; MMU and caches are off. */

	.section .start, "ax"
	.global	start
start:
	msr	cpsr_c, #0xd3 /* SVC mode, no interrupts */
	ldr	sp, =stack

	ldr	r4, =bss
	ldr	r5, =bss_end
	mov	r6, #0
1:	cmp	r4, r5
	strlo	r6, [r4], #4
	blo	1b

	bl	kernel
2:	b	2b
