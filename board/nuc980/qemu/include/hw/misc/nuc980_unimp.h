/*
 * Nuvoton NUC980: one log line for each register that is not modelled
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#ifndef HW_MISC_NUC980_UNIMP_H
#define HW_MISC_NUC980_UNIMP_H

#include "exec/hwaddr.h"
#include "qemu/bitops.h"
#include "qemu/log.h"

/*
 * Logs the first access to a register that is not modelled. 'seen' is a
 * DECLARE_BITMAP(seen, SIZE / 4) of the device, 'offset' counts bytes from
 * its first register. A run that logs nothing yet remembers nothing.
 */
static inline void nuc980_unimp_once(unsigned long *seen, const char *device,
                                     hwaddr offset)
{
    if (qemu_loglevel_mask(LOG_UNIMP) && !test_and_set_bit(offset / 4, seen)) {
        qemu_log("%s: register 0x%" HWADDR_PRIx " is not modelled\n", device,
                 offset);
    }
}

#endif /* HW_MISC_NUC980_UNIMP_H */
