/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * libFuzzer on the file of users, which comes from outside: no user is read whose hash takes more memory or time than a gateway
 * has, and every text ends.
 */
#include <string.h>

#include "fuzz/target.h"
#include "web/users.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	struct web_user user;
	unsigned wrong;
	FILE *file;

	if (size == 0)
		return 0;
	file = fmemopen((void *)(uintptr_t)data, size, "r");
	CHECK(file != NULL);
	if (web_user_find(file, "a", &user, &wrong)) {
		CHECK(strcmp(user.name, "a") == 0 && user.role <= WEB_INSTALLER);
		CHECK(user.n > 1 && user.r > 0 && user.p > 0 && user.salt_size >= 8);
		CHECK(user.secret_size == 0 ||
		      (user.secret_size >= WEB_TOTP_LEAST && user.secret_size <= WEB_TOTP_MAX));
		CHECK(user.salt_size <= WEB_SALT_MAX && UINT64_C(128) * user.n * user.r <= WEB_MEMORY_MAX);
	}
	CHECK(wrong <= size);
	fclose(file);
	return 0;
}
