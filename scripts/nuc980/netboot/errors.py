# SPDX-License-Identifier: GPL-3.0-or-later
"""What can go wrong between a host and a board: a class per symptom, with its cause and the next step."""

from __future__ import annotations

from nuc980.errors import ToolError as NetbootError
from nuc980.errors import UnusableInput

# ---- the serial port, before a byte is sent


class PortMissing(UnusableInput):
    """No port of this name."""

    cause = "the adapter is not plugged in, or got another name"
    next_step = "name one of the ports that are there; the names in /dev/serial/by-id do not change"


class PortForbidden(UnusableInput):
    """This user may not open the port."""

    cause = "serial ports belong to a group (dialout on Debian)"
    next_step = "sudo usermod -aG dialout $USER, then log out and in again"


class PortBusy(UnusableInput):
    """Another program has the port."""

    cause = "a terminal program, or another nuc980-netboot, has it open"
    next_step = "close that program"


class NotAPort(UnusableInput):
    """Something with this name is there, but it is not a serial port."""

    cause = "a folder or a plain file in place of a device"
    next_step = "give a device as /dev/ttyUSB0, or socket://HOST:PORT, or rfc2217://HOST:PORT"


class NoSuchUrl(UnusableInput):
    """This URL cannot name a port."""

    cause = "an unknown scheme, or a missing host or port"
    next_step = "give socket://HOST:PORT (raw TCP), rfc2217://HOST:PORT (Telnet), or a device as /dev/ttyUSB0"


class PortUnreachable(UnusableInput):
    """The serial server on the network does not answer, or not as one."""

    cause = "no server (ser2net) runs there, it has another client, or a firewall is in between"
    next_step = "check host and port; a server that speaks no RFC 2217 takes socket:// instead"


class SpeedRefused(UnusableInput):
    """The port cannot run at this speed."""

    cause = "the adapter does not have this speed"
    next_step = "omit --baud: the board's console has 115200 bit/s"


# ---- the serial line


class LineLost(NetbootError):
    """The serial port went away."""

    cause = "the adapter was unplugged, or the serial server closed the connection"
    next_step = "check the cable, and start again; an interrupted flash goes on with --resume"


class NoOutput(NetbootError):
    """No byte came from the board."""

    cause = "wrong port, TX and RX swapped, no common ground, or the board has no power"
    next_step = "check the power LED and the wiring (docs/netboot.md), or name another --port"


class Garbage(NetbootError):
    """Bytes came, but not text, at any of the usual speeds."""

    cause = "an unusual speed, no common ground, or RS-232 levels on a 3.3 V port"
    next_step = "check ground and level; give the speed with --baud when the board has its own"


class PowerHookFailed(NetbootError):
    """The command to switch the board off and on failed."""

    cause = "the switch cannot be reached, or it belongs to another board"
    next_step = "run the --power-cycle command by hand, and look at the board's power LED"


class AutobootMissed(NetbootError):
    """The board went on to boot what it has."""

    cause = "no key reached the board in time: its RX wire, or bootdelay=0"
    next_step = "check the wire to the board's RX, and power-cycle the board while this runs"


class AutobootKeyed(NetbootError):
    """Autoboot is stopped by a certain string alone."""

    cause = "a U-Boot with CONFIG_AUTOBOOT_KEYED"
    next_step = "--interrupt TEXT types the string; --password-file FILE does if nobody may see it"


class PasswordNeeded(NetbootError):
    """U-Boot asks for a password."""

    cause = "a U-Boot that is locked; no key was pressed to its prompt"
    next_step = "--password-file FILE types it; - in place of FILE asks you for it"


class PasswordRefused(NetbootError):
    """The board does not take the password, or the string that stops autoboot."""

    cause = "another board's, or --autoboot or --password-prompt matches another line; it was typed once"
    next_step = "check it, and switch the board off and on while this runs"


class NotUBoot(NetbootError):
    """Something answers, but it is not U-Boot."""

    cause = "Linux is running on the board"
    next_step = "power-cycle the board while this runs, or give --power-cycle COMMAND"


class StuckConsole(NetbootError):
    """The prompt does not come back."""

    cause = "the command hangs, or the board no longer hears (its RX wire)"
    next_step = "power-cycle the board and start again; --log FILE keeps every byte"


class LineUnsafe(NetbootError):
    """The line changes what is typed or answered."""

    cause = "noise, a bad ground, or a second program that reads the port"
    next_step = "check the wiring and that no other program has the port; --log FILE keeps every byte"


class BoardReset(NetbootError):
    """The board restarted in the middle."""

    cause = "the supply dips, a watchdog, or someone at the reset button"
    next_step = "check the supply, and start again; an interrupted flash goes on with --resume"


class BoardHung(NetbootError):
    """U-Boot gave up: only a reset helps."""

    cause = "see what U-Boot said above: RAM, flash or a file that it cannot work with"
    next_step = "switch the board off and on, and start again; if it happens again, U-Boot or the RAM is bad"


class NoStatus(NetbootError):
    """This U-Boot's parser does not report whether a command succeeded."""

    cause = "U-Boot without the hush parser, which the factory's has"
    next_step = "work by hand with --console: without a status nothing can be verified"


class LineTooLong(UnusableInput):
    """U-Boot would cut the command (CONFIG_SYS_CBSIZE 256), or change it."""

    cause = "a file name or a value that is too long, or not of printable ASCII"
    next_step = "give the file or the value a shorter, plain name"


class CommandFailed(NetbootError):
    """A command failed on the board."""

    cause = "see what the board said above"
    next_step = "--log FILE keeps the whole dialogue"


# ---- what is to be booted


class UnusableImage(UnusableInput):
    """The board could not boot this file."""


# ---- the network


class NoHostAddress(UnusableInput):
    """The host has no address that the board can reach."""


class HostAmbiguous(UnusableInput):
    """The host has more than one interface in the board's network."""

    cause = "the board's cable is in one of them, and the tool cannot see which"
    next_step = "name the address of the interface with the board's cable: --server-ip ADDRESS"


class TftpError(UnusableInput):
    """The server cannot have its port."""


class TransferFailed(NetbootError):
    """A file did not arrive."""

    cause = "see what U-Boot said above"
    next_step = "nuc980-netboot probe shows what this U-Boot has; --log FILE keeps the whole dialogue"


class NoEthernet(TransferFailed):
    """U-Boot has no Ethernet port."""

    cause = "a U-Boot without a driver for it (the vendor's nuc980_iot_defconfig builds one)"
    next_step = "nuc980-netboot probe shows what this U-Boot has; without a port nothing can be loaded"


class NoMac(TransferFailed):
    """The port that U-Boot uses has no MAC address."""

    cause = "a third port, or an ethaddr that U-Boot does not take"
    next_step = "choose the port with --ethact; ethaddr and eth1addr come from the file `macs` of the site"


class LinkDown(TransferFailed):
    """The PHY has no link."""

    cause = "no cable, the cable is in the other port, or a switch port that is off"
    next_step = "plug the cable into the other port, or choose the port with --ethact"


class NoAnswer(TransferFailed):
    """Nobody answers the board at the server's address (ARP)."""

    cause = (
        "the cable is in the other port, leads elsewhere or is not plugged in (the factory's U-Boot does not"
        " notice), or the host does not have this address"
    )
    next_step = (
        "plug the cable into the other port, or choose the port with --ethact; check the host's address"
    )


class TftpTimeout(TransferFailed):
    """The board asked for a file and got nothing at all."""

    cause = "a firewall on the host drops the board's UDP, or another host has the server's address"
    next_step = (
        "let the board's UDP in at the server's port, and high ports too: each transfer has one of its own"
    )


class TransferBroken(TftpTimeout):
    """A transfer began and did not finish."""

    cause = "a bad cable, a network that loses packets, or a firewall that does not know TFTP"
    next_step = "start again, with a direct cable if another network is in between"


class FileRefused(TransferFailed):
    """A TFTP server refused the file."""

    cause = "another TFTP server answered at this address"
    next_step = "stop the other server, or name this host's address with --server-ip"


class WrongBytes(TransferFailed):
    """What arrived is not what was sent."""

    cause = "RAM, a broken transfer, or a wrong address"
    next_step = "start again; if it happens again, the board's RAM or its network is at fault"


# ---- Linux


class BootmFailed(NetbootError):
    """U-Boot did not start what was loaded."""

    cause = "this U-Boot expects another kind of image; kernel and device tree are in RAM unchanged"
    next_step = "--log FILE keeps the whole dialogue; nuc980-netboot probe shows what this U-Boot has"


class KernelPanic(NetbootError):
    """The kernel gave up."""

    cause = "see the panic's lines above"
    next_step = "boot a known image; nuc980-pins check looks at the device tree"


class KernelOops(KernelPanic):
    """The kernel found an error of its own (an oops); it may have gone on."""

    cause = "a driver, or a device tree that does not describe this board"


class RootMissing(KernelPanic):
    """The kernel found no root file system."""

    cause = (
        "root= or ubi.mtd= names something that is not there, the flash holds no file system, or the kernel's"
        " own command line was replaced by the device tree's"
    )
    next_step = (
        "boot the image nuc980_netboot, which has its root in the kernel; --bootargs sets another root="
    )


class LinuxSilent(NetbootError):
    """The kernel started but did not get as far as it should."""

    cause = "it hangs, or it needs more time"
    next_step = "--timeout SECONDS waits longer, --until PATTERN for another line; --log FILE keeps all lines"


class KernelMute(LinuxSilent):
    """Not a word after "Starting kernel"."""

    cause = (
        "no console at this UART (console=ttyS0,115200n8), another board's device tree, a kernel for another"
        " load address, or a panic before the console is there"
    )
    next_step = "nuc980-pins check looks at the device tree; boot a known image"


# ---- the flash


class DoesNotFit(UnusableInput):
    """An image is larger than its place in the board's RAM or flash."""


class FlashFailed(NetbootError):
    """The flash does not hold what was written."""

    cause = "worn blocks"
    next_step = "nuc980-netboot flash --resume, or --roll-back; netboot works without the flash"


class LayoutUnknown(UnusableInput):
    """The place of an image in this board's flash is unknown, or unusable."""

    cause = "a boot command, partitions or bad blocks that this program does not understand"
    next_step = "nuc980-netboot probe shows the environment; --kernel-at, --dtb-at, --ubi-at name a place"


class FlashNotPossible(UnusableInput):
    """This board, or its U-Boot, cannot do what flashing needs."""

    cause = "a U-Boot without nand or crc32, or a flash whose geometry is unknown"
    next_step = "nuc980-netboot probe shows what it has; boot works without the flash"


class Unfinished(UnusableInput):
    """An earlier flash of this site was not finished."""

    cause = "it was interrupted"
    next_step = "flash --resume finishes it, flash --roll-back restores what was there before"


class JournalUnusable(UnusableInput):
    """There is no journal to continue from, or it belongs to another board or other files."""

    next_step = "flash the images again"


class SiteBusy(UnusableInput):
    """Another nuc980-netboot works on this site."""

    cause = "it runs in another terminal"
    next_step = "wait for it, or end it"


class BackupFailed(NetbootError):
    """The content of the flash could not be copied to the host; nothing was erased."""

    cause = "the network, or RAM"
    next_step = "start again; --backup-by serial uses the serial line, --no-backup REASON makes no backup"
