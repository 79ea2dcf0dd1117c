# SPDX-License-Identifier: GPL-3.0-or-later
"""A command's answer on the debug UART, where the kernel speaks as well."""

from itertools import cycle, islice

import pytest

from nuc980.twin.linux import Kernel, Linux

ANSWER = "a line that is long enough to be broken in the middle"
MESSAGES = 60
STATUSES, MOST_COMMANDS = range(100, 200), 1000


@pytest.fixture(scope="module")
def kernel(kernel: Kernel) -> Kernel:
    return kernel.without_services()


def test_what_a_busy_host_makes_the_kernel_say_is_not_the_answer(linux: Linux) -> None:
    """A program writes it here: what the kernel writes itself may come behind the answer."""
    for said in ("ttyS ttyS8: 2 input overrun(s)", "sched: RT throttling activated"):
        message = f"[    7.654321] {said}"
        assert linux.run(f"echo '{message}'; echo it is read") == "it is read"
        assert f"\n{message}" in linux.log


def test_what_the_kernel_says_in_between_is_not_the_answer(linux: Linux) -> None:
    """Its messages break into lines and into the mark of a command's end."""
    linux.run("while :; do echo '<3>the kernel speaks' > /dev/kmsg; sleep 0.02; done > /dev/null 2>&1 &")
    for number in islice(cycle(STATUSES), MOST_COMMANDS):
        status, output = linux.try_to(f"echo '{ANSWER}'; exit {number}")
        assert status == number
        assert ANSWER in output.splitlines()
        if linux.log.count("the kernel speaks") > MESSAGES:
            return
    pytest.fail("the kernel did not speak in between")
