# SPDX-License-Identifier: GPL-3.0-or-later
# The device tree.

# Of board/nuc980/boards: docs/your-board.md. U-Boot, and the image from Debian's packages, have a folder for each other board.
BOARD := gateway
OF_BOARD := $(if $(filter-out gateway,$(BOARD)),boards/$(BOARD)/)
DTS := dts/nuvoton/nuc980-$(BOARD).dts
# of the board file, as SWITCHES="GATEWAY_PDMA=1 GATEWAY_RTC=1"; a build with switches has a folder of its own
SWITCHES :=
EMPTY :=
DTB := build/dtb/$(addsuffix /,$(subst $(EMPTY) $(EMPTY),_,$(strip $(SWITCHES))))nuc980-$(BOARD).dtb

dtb: $(BOARDS) ## Build: the board's device tree: generate, compile, check (BOARD=, SWITCHES=)
	scripts/nuc980-pins generate
	scripts/build-dtb.sh $(DTS) $(DTB) $(SWITCHES)
	scripts/nuc980-pins check --board $(BOARD) $(addprefix -D ,$(SWITCHES)) $(DTS) $(DTB)
	scripts/validate-dtb.sh $(DTB)
