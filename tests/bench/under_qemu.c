/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * PROGRAM, of the board, under QEMU, as rtud starts a module: by a descriptor that is closed when it runs, so that it can be
 * no script. SYSROOT has its libraries, PLUGIN counts its instructions.
 */
#include <unistd.h>

#define WORDS_MAX 32

int main(int argc, char **argv)
{
	char *words[WORDS_MAX] = {"qemu-arm", "-cpu", "arm926", "-L", SYSROOT, "-plugin", PLUGIN, PROGRAM};
	int count = 8;

	for (int i = 1; i < argc && count < WORDS_MAX - 1; i++)
		words[count++] = argv[i];
	execvp(words[0], words);
	return 127;
}
