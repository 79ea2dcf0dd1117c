# SPDX-License-Identifier: GPL-3.0-or-later
# What there is to see, and to measure.

LAB := PYTHONPATH=scripts $(PYTHON) -m lab
AT_PORT = $(if $(PORT),--port '$(PORT)')

run-native: build $(VENV) ## See it: the gateway on this machine, built and shown in a minute (KEEP=1; PORT=)
	@$(LAB) $(AT_PORT) $(if $(KEEP),--keep)

# The system of `make run`, for a site of its own; its engineer brings the configuration with SNMPv3 later.
lab: $(VENV) $(EMULATED) ## Build: the image that `make run` boots
	@$(LAB).site build/site
	@$(MAKE) image-debian SITE=build/site/lab GATEWAY=gateway-tls

# 20 stations with simulated devices and receivers, or STATIONS=file, the centre's file of one's own.
centre: build centre-page $(VENV) $(BOARDS) $(CENTRE) ## See it: a control centre with 20 RTUs (KEEP=1; PORT=; STATIONS=file)
	@$(LAB).centre_show $(AT_PORT) $(if $(KEEP),--keep) $(if $(STATIONS),--stations '$(STATIONS)')

ifndef IMAGE_TYPED
run: build qemu uboot lab $(BOARDS) ## See it: the emulated board, from reset to the control room (KEEP=1; PORT=; IMAGE=)
	@$(LAB).board_show $(AT_PORT) $(if $(KEEP),--keep)
else ifndef SITE
run: qemu uboot $(BOARDS)
	@$(LAB).image '$(IMAGE)'
else # which it was made with
run: build qemu uboot $(BOARDS)
	@$(LAB).board_show $(AT_PORT) $(if $(KEEP),--keep) --image '$(IMAGE)'
endif

twin: qemu uboot $(BOARDS) ## See it: the emulated board: from reset to a file over TFTP, its pins, a wrong pin
	@$(LAB).twin_show

bench-polls: build .compared $(TESTED) ## Maintain: of the bench the polls of positions and their octets alone: figure 9
	PYTHONPATH=scripts $(PYTHON) $(BENCH)/polls.py
	PYTHONPATH=scripts $(PYTHON) $(BENCH)/octets.py

bench-map: build centre-page build/packages-centre.done $(TESTED) ## Maintain: frames a second of the control centre's map
	PYTHONPATH=scripts $(PYTHON) $(BENCH)/frames.py

bench-pictures: build centre-page build/packages-centre.done $(TESTED) ## Maintain: frames a second of a process picture
	PYTHONPATH=scripts $(PYTHON) $(BENCH)/picture_frames.py

cost: build .compared qemu build/root/gateway-tls.done $(TESTED) ## Maintain: count what work costs the board's core (docs/bench.md; WRITE=1)
	PYTHONPATH=scripts $(PYTHON) $(BENCH)/cost.py $(if $(WRITE),--write)

bench: build .compared qemu uboot build/root/gateway-tls.done build/net-snmp-agent/done $(TESTED) ## Maintain: measure ours beside what else does it (docs/bench.md; LIB60870=folder)
	PYTHONPATH=scripts $(PYTHON) $(BENCH)/bench.py
	PYTHONPATH=scripts $(PYTHON) $(BENCH)/stations.py $(if $(LIB60870),--lib60870 '$(LIB60870)')
	PYTHONPATH=scripts $(PYTHON) $(BENCH)/lines.py
	PYTHONPATH=scripts $(PYTHON) $(BENCH)/moods.py
	$(MAKE) bench-polls
	PYTHONPATH=scripts $(PYTHON) $(BENCH)/store.py
	PYTHONPATH=scripts $(PYTHON) $(BENCH)/history.py
	PYTHONPATH=scripts $(PYTHON) $(BENCH)/beside.py
	PYTHONPATH=scripts $(PYTHON) $(BENCH)/logic_scans.py
	PYTHONPATH=scripts $(PYTHON) $(BENCH)/reload.py
	PYTHONPATH=scripts $(PYTHON) $(BENCH)/module_scans.py
	PYTHONPATH=scripts $(PYTHON) $(BENCH)/managers.py
	PYTHONPATH=scripts $(PYTHON) $(BENCH)/mms_servers.py
	scripts/build-dtb.sh $(DTS) $(DTB)
	$(PYTHON) $(BENCH)/pins.py
	PYTHONPATH=scripts $(PYTHON) $(BENCH)/tftp.py

netboot: $(IMAGE_DEBIAN) $(BOARDS) ## A board: boot it over UART and Ethernet (PORT=, BOARD_IP=, SITE=, IMAGE=, BOARD=)
	scripts/nuc980-netboot boot --port $(PORT) $(if $(SITE),--site $(SITE_SETTINGS)) $(if $(BOARD_IP),--board-ip $(BOARD_IP)) \
	  --console $(IMAGE_FOLDER)/uImage $(IMAGE_FOLDER)/nuc980-$(BOARD).dtb
