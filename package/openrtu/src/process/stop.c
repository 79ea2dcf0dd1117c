/* SPDX-License-Identifier: GPL-3.0-or-later */
#include <signal.h>
#include <sys/signalfd.h>

#include "process/module.h"

int module_stop_fd(void)
{
	sigset_t signals;

	sigemptyset(&signals);
	sigaddset(&signals, SIGTERM);
	sigaddset(&signals, SIGINT);
	sigprocmask(SIG_BLOCK, &signals, NULL);
	return signalfd(-1, &signals, SFD_CLOEXEC);
}
