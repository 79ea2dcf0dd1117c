/* SPDX-License-Identifier: GPL-3.0-or-later */
/* From the reset state of the processor to begin(), and from its interrupts to board.c and back. */

#define MODE_FIQ 0x11
#define MODE_IRQ 0x12
#define MODE_SVC 0x13
#define MASKED	 0xc0 /* no IRQ, no FIQ */

	.section .start, "ax"
	.global	start
start:
	msr	cpsr_c, #MASKED | MODE_FIQ
	ldr	sp, =fiq_stack
	msr	cpsr_c, #MASKED | MODE_IRQ
	ldr	sp, =irq_stack
	msr	cpsr_c, #MASKED | MODE_SVC
	ldr	sp, =stack

	ldr	r0, =vectors /* the processor looks for them at 0 */
	mov	r1, #0
	mov	r2, #64
1:	ldr	r3, [r0], #4
	str	r3, [r1], #4
	subs	r2, r2, #4
	bne	1b

	ldr	r0, =bss
	ldr	r1, =bss_end
	mov	r2, #0
2:	cmp	r0, r1
	strlo	r2, [r0], #4
	blo	2b

	bl	begin
3:	b	3b

vectors:
	.rept	8
	ldr	pc, [pc, #24]
	.endr
	.word	start, undefined, stray, prefetch, data, stray, irq, fiq

undefined:
	ldr	r0, =undefined_text
	b	fault
prefetch:
	ldr	r0, =prefetch_text
	b	fault
data:
	ldr	r0, =data_text
	b	fault
stray:
	ldr	r0, =stray_text
fault:	/* a fault's own modes have no stack: say it on that of begin() */
	sub	r1, lr, #4
	msr	cpsr_c, #MASKED | MODE_SVC
	b	died

undefined_text:
	.asciz	"undefined instruction"
prefetch_text:
	.asciz	"prefetch abort"
data_text:
	.asciz	"data abort"
stray_text:
	.asciz	"stray exception"
	.balign	4

/* In SVC mode and on its stack, so that a handler may let further interrupts in. */
irq:
	sub	lr, lr, #4
	stmfd	sp!, {r0-r3, r12, lr}
	mrs	r0, spsr
	stmfd	sp!, {r0, r1}
	mrs	r0, cpsr
	eor	r0, r0, #MODE_IRQ ^ MODE_SVC
	msr	cpsr_c, r0
	and	r1, sp, #4
	sub	sp, sp, r1
	stmfd	sp!, {r1, lr}
	bl	serve_irq
	ldmfd	sp!, {r1, lr}
	add	sp, sp, r1
	mrs	r0, cpsr
	eor	r0, r0, #MODE_IRQ ^ MODE_SVC
	msr	cpsr_c, r0
	ldmfd	sp!, {r0, r1}
	msr	spsr_cxsf, r0
	ldmfd	sp!, {r0-r3, r12, pc}^

fiq:
	sub	lr, lr, #4
	stmfd	sp!, {r0-r3, r12, lr}
	bl	serve_fiq
	ldmfd	sp!, {r0-r3, r12, pc}^
