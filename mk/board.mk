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

schemas: build/linux/schemas.json ## Build: the kernel's bindings, for nuc980-pins check --schemas

# Two of Linux 6.1's are not what this dtschema takes: it says so, and goes on without them.
build/linux/schemas.json: build/linux/debian.dsc $(shell find dts/bindings -name '*.yaml') | build/packages-boards.done
	$(LOGGED) schemas sh -c '.venv/bin/dt-mk-schema -j "$$1" dts/bindings > $@.new' - $(@D)/debian/Documentation/devicetree/bindings
	@mv $@.new $@

dtb: $(BOARDS) ## Build: the board's device tree: generate, compile, check (BOARD=, SWITCHES=)
	scripts/nuc980-pins generate
	scripts/build-dtb.sh $(DTS) $(DTB) $(SWITCHES)
	scripts/nuc980-pins check --board $(BOARD) $(addprefix -D ,$(SWITCHES)) $(DTS) $(DTB)
	scripts/validate-dtb.sh $(DTB)
