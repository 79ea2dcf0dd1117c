/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "web/users.h"

#include <stdlib.h>
#include <string.h>

#include "web/hex.h"

enum { NAME, ROLE, ALGORITHM, N, R, P, SALT, HASH, SECRET, WORDS };

/* The installer's are those of IEC 62351-8: who sets a gateway up commands nothing by that. */
static const char *const roles[] = {[WEB_VIEWER] = "viewer",
				    [WEB_OPERATOR] = "operator",
				    [WEB_ENGINEER] = "engineer",
				    [WEB_INSTALLER] = "installer"};
static const unsigned rights[] = {
    [WEB_OPERATOR] = WEB_COMMANDS, [WEB_ENGINEER] = WEB_COMMANDS, [WEB_INSTALLER] = WEB_SETS_UP};

const char *web_role_name(uint8_t role)
{
	return role < sizeof(roles) / sizeof(roles[0]) ? roles[role] : "?";
}

bool web_role_may(uint8_t role, enum web_right right)
{
	return role < sizeof(rights) / sizeof(rights[0]) && (rights[role] & right) == right;
}

static bool split(char *line, const char *words[WORDS])
{
	unsigned count = 0;
	char *rest = NULL;

	for (char *word = strtok_r(line, " \t\r\n", &rest); word != NULL;
	     word = strtok_r(NULL, " \t\r\n", &rest)) {
		if (count == WORDS)
			return false;
		words[count++] = word;
	}
	return count >= SECRET;
}

static bool read_number(const char *text, uint32_t most, uint32_t *out)
{
	char *end;
	const unsigned long number = strtoul(text, &end, 10);

	*out = (uint32_t)number;
	return text[0] >= '0' && text[0] <= '9' && *end == '\0' && number >= 1 && number <= most;
}

static bool read_role(const char *text, uint8_t *out)
{
	for (uint8_t i = 0; i < sizeof(roles) / sizeof(roles[0]); i++)
		if (strcmp(text, roles[i]) == 0) {
			*out = i;
			return true;
		}
	return false;
}

/* N a power of two (RFC 7914, 2); what a gateway can give for a login. */
static bool is_bearable(const struct web_user *user)
{
	const uint64_t memory = UINT64_C(128) * user->n * user->r;

	return user->n > 1 && (user->n & (user->n - 1)) == 0 && memory <= WEB_MEMORY_MAX &&
	       memory * user->p <= (uint64_t)WEB_MEMORY_MAX * WEB_EFFORT_MAX;
}

bool web_user_read(char line[WEB_LINE_SIZE], struct web_user *out)
{
	const char *words[WORDS] = {NULL};

	memset(out, 0, sizeof(*out));
	if (!split(line, words) || strlen(words[NAME]) >= WEB_USER_SIZE ||
	    strcmp(words[ALGORITHM], "scrypt") != 0)
		return false;
	snprintf(out->name, sizeof(out->name), "%s", words[NAME]);
	out->salt_size = web_hex_read(words[SALT], out->salt, sizeof(out->salt));
	if (words[SECRET] != NULL)
		out->secret_size = web_secret_read(words[SECRET], out->secret);
	if (words[SECRET] != NULL && out->secret_size == 0)
		return false;
	return read_role(words[ROLE], &out->role) && read_number(words[N], WEB_MEMORY_MAX, &out->n) &&
	       read_number(words[R], 64, &out->r) && read_number(words[P], 64, &out->p) && is_bearable(out) &&
	       out->salt_size >= 8 && web_hex_read(words[HASH], out->hash, WEB_HASH_SIZE) == WEB_HASH_SIZE;
}

bool web_user_find(FILE *file, const char *name, struct web_user *out, unsigned *wrong)
{
	char line[WEB_LINE_SIZE];
	struct web_user user;

	*wrong = 0;
	memset(out, 0, sizeof(*out));
	while (fgets(line, sizeof(line), file) != NULL) {
		if (line[0] == '#' || line[strspn(line, " \t\r\n")] == '\0')
			continue;
		if (!web_user_read(line, &user)) {
			++*wrong;
			continue;
		}
		*out = user;
		if (strcmp(user.name, name) == 0)
			return true;
	}
	return false;
}
