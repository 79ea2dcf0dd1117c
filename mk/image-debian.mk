# SPDX-License-Identifier: GPL-3.0-or-later
# The image from Debian's packages.

# A build for a site has a folder of its own.
SYSTEM = build/$(OF_BOARD)system$(if $(SITE),-$(subst $(EMPTY) $(EMPTY),_,$(shell basename '$(SITE_SETTINGS)')))
# With OpenSSL only where the site's configuration asks for TLS.
FOR_SITE := $(or $(SITE),$(SITE_SETTINGS))
GATEWAY := $(or $(if $(FOR_SITE),$(shell PYTHONPATH=scripts python3 -m image.rootfs gateway '$(FOR_SITE)' 2> /dev/null)),gateway)
SYSTEM_PARTS := build/linux/done build/busybox/done build/chrony/done build/root/packages.done build/root/$(GATEWAY).done \
  build/dtb/nuc980-$(BOARD).dtb

# A site with certificates takes updates.
SYSTEM_PARTS += $(if $(FOR_SITE),$(if $(wildcard $(FOR_SITE)/update.pem),build/swupdate/done))
SYSTEM_PARTS += $(if $(FOR_SITE),$(if $(wildcard $(FOR_SITE)/update-server),build/curl/done))

image-debian: $(SYSTEM_PARTS) ## Build: a board's image from Debian's packages (SITE=folder: its settings; BOARD=)
	$(LOGGED) $(notdir $(SYSTEM)) scripts/build-system.sh $(SYSTEM) $(GATEWAY) $(LINUX_FRAGMENTS)

# Of image-debian, unless IMAGE= was typed: what goes onto a board.
IMAGE_TYPED   := $(filter command,$(origin IMAGE))
IMAGE_DEBIAN  := $(if $(IMAGE_TYPED),,image-debian)
IMAGE_FOLDER   = $(if $(IMAGE_TYPED),build/$(IMAGE)/images,$(SYSTEM))

update: $(if $(and $(SITE),$(KEY),$(CERTIFICATE)),$(IMAGE_DEBIAN) $(BOARDS)) ## Build: a signed update of that image, or IMAGE= (SITE= KEY= CERTIFICATE=)
ifeq ($(and $(SITE),$(KEY),$(CERTIFICATE)),)
	@echo "make update SITE=folder KEY=file CERTIFICATE=file: who gets it, and who signs it (docs/update.md)" >&2; exit 2
endif
	@mkdir -p $(dir $(SYSTEM))
	PYTHONPATH=scripts $(PYTHON) -m image.update $(IMAGE_FOLDER) --board nuc980-$(BOARD) --site '$(notdir $(SITE_SETTINGS))' \
	  --key '$(KEY)' --certificate '$(CERTIFICATE)' --out $(SYSTEM).swu

# Programs and libraries of others: a row each in scripts/for-board.
FOR_BOARD := busybox swupdate curl chrony net-snmp libmicrohttpd

build/busybox/done build/swupdate/done: build/%/done: board/nuc980/%.config
# Into the sysroot, so once more when that is another.
build/net-snmp/done build/libmicrohttpd/done: $(SYSROOT)
$(FOR_BOARD:%=build/%/done): build/%/done: scripts/build-for-board.sh scripts/for-board/%.sh build/%/debian.dsc | $(SYSROOT)
	$(LOGGED) $* scripts/build-for-board.sh $* build/$*/debian $(@D)
	@touch $@

build/net-snmp-agent/done: scripts/for-board/net-snmp-agent.sh build/net-snmp/done
	$(LOGGED) net-snmp-agent scripts/build-for-board.sh net-snmp-agent build/net-snmp/debian $(@D)
	@touch $@

build/root/packages.done: board/nuc980/system.toml scripts/debian-package.sh | $(EMULATED)
	@mkdir -p $(@D)
	@packages=$$(PYTHONPATH=scripts python3 -m image.rootfs packages) && \
	  scripts/logged.sh root-packages env ARCHITECTURE=armel scripts/debian-package.sh $(@D)/packages $$packages
	@touch $@

build/root/gateway.done: build/arm-release/build.ninja
build/root/gateway-tls.done: build/arm-release-tls/build.ninja build/net-snmp/done build/libmicrohttpd/done
build/root/gateway.done build/root/gateway-tls.done: $(shell find $(SRC) -type f)
	$(LOGGED) $(notdir $(@:.done=)) ninja -C $(patsubst build/root/gateway%.done,build/arm-release%,$@)
	@rm -rf $(@:.done=)
	$(LOGGED) $(notdir $(@:.done=))-install env DESTDIR=$(CURDIR)/$(@:.done=) \
	  meson install -C $(patsubst build/root/gateway%.done,build/arm-release%,$@) --strip --no-rebuild --quiet
	@touch $@

build/arm-release-tls/build.ninja: | build/net-snmp/done build/libmicrohttpd/done
build/arm-release/build.ninja build/arm-release-tls/build.ninja: build/sysroot.ini $(BUILD_OPTIONS)
	$(LOGGED) $(notdir $(@D))-setup $(SETUP) --prefix=/usr -Dtests=disabled -Dcentre=false -Dlibrary=false -Dsunspec=false \
	  $(foreach option,tls snmp web,-D$(option)=$(if $(findstring -tls,$@),true,false)) \
	  --cross-file $< --cross-file scripts/armel.ini

build/dtb/nuc980-%.dtb: $(wildcard dts/nuvoton/*) scripts/build-dtb.sh | build/packages-boards.done
	@scripts/build-dtb.sh dts/nuvoton/nuc980-$*.dts $@
