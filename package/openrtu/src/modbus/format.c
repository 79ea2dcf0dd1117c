/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modbus/format.h"

#include <stddef.h>

#define ROW(number, name, registers, coding, one)                                                            \
	[MODBUS_FORMAT_##number] = {name, registers, MODBUS_##coding, one},

const struct modbus_format_row modbus_formats[MODBUS_FORMATS] = {
    [MODBUS_FORMAT_BIT] = {NULL, 1, MODBUS_NO_NUMBER, 1},
    [MODBUS_FORMAT_VTI] = {NULL, 1, MODBUS_NO_NUMBER, 1},
    MODBUS_FILE_FORMATS(ROW)};
