/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * Not <termios.h>: any baud rate needs struct termios2, which it hides; and its tcsetattr fails on a pseudo-terminal that
 * does not take the parity.
 */
#ifndef MODULES_TERMIOS2_H
#define MODULES_TERMIOS2_H

#include <asm/termbits.h>
#include <sys/ioctl.h>

#ifndef TCGETS2 /* as <asm-generic/ioctls.h> has them, which musl's <sys/ioctl.h> leaves out */
#define TCGETS2 _IOR('T', 0x2A, struct termios2)
#define TCSETS2 _IOW('T', 0x2B, struct termios2)
#endif

#endif
