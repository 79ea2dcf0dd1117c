# SPDX-License-Identifier: GPL-3.0-or-later
"""A command's answer on the debug UART, where the kernel speaks as well."""

from nuc980.twin.linux import Linux

ANSWER = "a line that is long enough to be broken in the middle"
COMMANDS = 60


def test_what_the_kernel_says_in_between_is_not_the_answer(linux: Linux) -> None:
    """Its messages break into lines and into the mark of a command's end."""
    linux.run("while :; do echo '<3>the kernel speaks' > /dev/kmsg; sleep 0.02; done > /dev/null 2>&1 &")
    answers = [linux.try_to(f"echo '{ANSWER}'; exit {number}") for number in range(100, 100 + COMMANDS)]
    assert [status for status, _ in answers] == list(range(100, 100 + COMMANDS))
    assert all(ANSWER in output.splitlines() for _, output in answers)
    assert linux.log.count("the kernel speaks") > COMMANDS
