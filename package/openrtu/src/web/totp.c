/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "web/totp.h"

#include <stdio.h>
#include <string.h>

#define BITS 5 /* of a letter */

uint8_t web_secret_read(const char *text, uint8_t out[WEB_TOTP_MAX])
{
	static const char letters[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZ234567";
	uint8_t size = 0;
	uint32_t bits = 0;
	unsigned count = 0;

	for (; *text != '\0'; text++) {
		const char *letter = strchr(letters, *text);

		if (letter == NULL)
			return 0;
		bits = bits << BITS | (uint32_t)(letter - letters);
		count += BITS;
		if (count < 8)
			continue;
		if (size == WEB_TOTP_MAX)
			return 0;
		count -= 8;
		out[size++] = (uint8_t)(bits >> count);
	}
	return size >= WEB_TOTP_LEAST ? size : 0;
}

void web_code_of(const uint8_t mac[WEB_MAC_SIZE], char out[WEB_CODE_SIZE])
{
	const uint8_t *at = &mac[mac[WEB_MAC_SIZE - 1] & 0x0f];
	const uint32_t number =
	    (uint32_t)(at[0] & 0x7f) << 24 | (uint32_t)at[1] << 16 | (uint32_t)at[2] << 8 | at[3];

	snprintf(out, WEB_CODE_SIZE, "%06u", (unsigned)(number % 1000000));
}

bool web_step_use(struct web_used used[WEB_STEPS_MAX], uint64_t user, uint64_t step)
{
	struct web_used *place = &used[0];

	for (unsigned i = 0; i < WEB_STEPS_MAX; i++) {
		if (used[i].user == user && used[i].step >= step)
			return false;
		if (used[i].step < place->step)
			place = &used[i];
	}
	for (unsigned i = 0; i < WEB_STEPS_MAX; i++)
		if (used[i].user == user)
			place = &used[i];
	*place = (struct web_used){.user = user, .step = step};
	return true;
}
