# SPDX-License-Identifier: GPL-3.0-or-later
# For Linux machines: an installation, Debian packages, containers.

PREFIX  := /usr/local
DESTDIR :=
# Each prefix has a build of its own: rtud knows where its modules are.
INSTALLED = build/installed$(subst /,_,$(PREFIX))
MAN = build/man

$(INSTALLED)/build.ninja: $(BUILD_OPTIONS) | $(PACKAGES) build/packages-man.done
	$(LOGGED) $(notdir $(@D))-setup $(SETUP) --prefix=$(PREFIX) --sysconfdir=/etc -Dtests=disabled -Dtls=true -Dsnmp=true -Dweb=true -Dman=true \
	  -Dsystemd=true -Ddesk=true

install: $(INSTALLED)/build.ninja ## Build: install the gateway on this machine (PREFIX=/usr/local, DESTDIR=)
	$(LOGGED) installed ninja -C $(INSTALLED)
	meson install -C $(INSTALLED) --no-rebuild $(if $(DESTDIR),--destdir "$$(realpath -m '$(DESTDIR)')")
	[ -e '$(DESTDIR)/etc/openrtu/gateway.json' ] || \
	  install -D -m 644 $(SRC)/systemd/gateway.json '$(DESTDIR)/etc/openrtu/gateway.json'

man: $(INSTALLED)/build.ninja $(BOARDS) $(CENTRE) ## Build: the man pages, of the tools too
	$(LOGGED) installed ninja -C $(INSTALLED)
	mkdir -p $(MAN)
	cp $(INSTALLED)/man/*.[18] $(MAN)
	$(SRC)/man/page.py scripts/nuc980-pins 1 'check the device tree of a NUC980 board' $(MAN)/nuc980-pins.1
	$(SRC)/man/page.py scripts/nuc980-netboot 1 'boot and flash a NUC980 board' $(MAN)/nuc980-netboot.1
	$(SRC)/man/page.py scripts/openrtu 1 "OpenRTU's tools for engineers" $(MAN)/openrtu.1

# as "amd64 arm64 armhf"; without it, this machine's
DEB_ARCHS :=

# What the tools import and Debian 12 does not have, or in a version that is too old.
VENDORED := build/deb-vendored

$(VENDORED)/done: requirements.txt $(VENV)
	@rm -rf $(@D)
	$(LOGGED) $(notdir $(@D)) $(PYTHON) -m pip install --disable-pip-version-check --no-deps --no-compile --target $(@D) \
	  --constraint $< paho-mqtt pyfdt tftpy
	@touch $@

# What the Debian packages are made with, and of.
PACKAGING := build/packages-man.done build/packages-deb.done build/packages-release.done wheels $(VENDORED)/done

deb: $(PACKAGES) $(PACKAGING) ## Build: the Debian packages, in build/deb (DEB_ARCHS="amd64 arm64 armhf")
	scripts/build-deb.sh build/deb $(DEB_ARCHS)

containers: deb build/linesim/build.ninja ## Build: images for containers and a compose.yaml, in build/containers
	$(LOGGED) linesim ninja -C build/linesim
	$(LOGGED) containers scripts/build-containers.sh build/containers build/deb
