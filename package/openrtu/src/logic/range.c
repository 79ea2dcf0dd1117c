/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "logic/logic.h"

const struct logic_range logic_ranges[LOGIC_TYPES] = {
    [LOGIC_BOOL] = {0, 1},
    [LOGIC_SINT] = {INT8_MIN, INT8_MAX},
    [LOGIC_INT] = {INT16_MIN, INT16_MAX},
    [LOGIC_DINT] = {INT32_MIN, INT32_MAX},
    [LOGIC_LINT] = {INT64_MIN, INT64_MAX},
    [LOGIC_USINT] = {0, UINT8_MAX},
    [LOGIC_UINT] = {0, UINT16_MAX},
    [LOGIC_UDINT] = {0, UINT32_MAX},
    [LOGIC_BYTE] = {0, UINT8_MAX},
    [LOGIC_WORD] = {0, UINT16_MAX},
    [LOGIC_DWORD] = {0, UINT32_MAX},
    [LOGIC_TIME] = {INT64_MIN, INT64_MAX},
    [LOGIC_DT] = {INT64_MIN, INT64_MAX},
};
