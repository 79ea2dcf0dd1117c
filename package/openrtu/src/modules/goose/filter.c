/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "modules/goose/filter.h"

#include <linux/filter.h>
#include <sys/socket.h>

#define ACCEPT      UINT32_MAX
#define PROGRAM_MAX (2 * GOOSE_SUBSCRIBED_MAX + 2)

int goose_filter(int fd, const struct map_config *config, uint32_t silenced)
{
	const struct goose_subscription *subscriptions = goose_subscriptions(config);
	struct sock_filter code[PROGRAM_MAX];
	struct sock_fprog program = {.filter = code};

	code[program.len++] = (struct sock_filter)BPF_STMT(BPF_LD | BPF_H | BPF_ABS, GOOSE_APP_ID_AT);
	for (uint32_t i = 0; i < map_record_count(config, GOOSE_SUBSCRIPTIONS); i++) {
		if (silenced >> i & 1)
			continue;
		code[program.len++] = (struct sock_filter)BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K,
								   subscriptions[i].stream.app_id, 0, 1);
		code[program.len++] = (struct sock_filter)BPF_STMT(BPF_RET | BPF_K, ACCEPT);
	}
	code[program.len++] = (struct sock_filter)BPF_STMT(BPF_RET | BPF_K, 0);
	return setsockopt(fd, SOL_SOCKET, SO_ATTACH_FILTER, &program, sizeof(program));
}
