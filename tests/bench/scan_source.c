/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A module on libopenrtu all of whose points have another value after each scan. */
#include <openrtu.h>
#include <stddef.h>

int main(int argc, char **argv)
{
	struct openrtu *rtu = openrtu_attach(argc, argv);
	double value = 0;

	if (rtu == NULL)
		return 1;
	while (openrtu_wait(rtu)) {
		openrtu_scan_begin(rtu);
		value++;
		for (int i = 0; i < openrtu_point_count(rtu); i++)
			openrtu_write(rtu, i, value + i);
		openrtu_scan_end(rtu);
	}
	openrtu_detach(rtu);
	return 0;
}
