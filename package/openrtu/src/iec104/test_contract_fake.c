/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The contract with the map that tests hold in their hand. */
#include "iec104/test_contract.h"

struct map *contract_begin(void)
{
	fake_begin();
	return &fake;
}

void contract_end(void)
{
}

void contract_publish(uint32_t point, int32_t value, uint8_t quality)
{
	struct map_update update = {.point = point,
				    .sample = {.value.i = value, .quality = quality, .time_ns = now}};

	map_publish(&fake, &update, 1);
}

void contract_end_owner(void)
{
	fake.dead[map_owner(&fake, CONTRACT_POINT)] = true;
}

void contract_answer(uint32_t id)
{
	answer(id, MAP_EXECUTING, MAP_RESULT_NONE);
}

int64_t contract_now(void)
{
	return now;
}
