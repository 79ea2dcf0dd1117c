#!/usr/bin/env bash
# SPDX-License-Identifier: GPL-3.0-or-later
# check-arguments.sh GOAL...: says in one line what make cannot do with its arguments, which are in the environment by
# their names there; says nothing when they are sound. It needs nothing that is installed or built by this tree.
set -euo pipefail
shopt -s nullglob

refuse() {
	echo "$*"
	exit 0
}

# some WORD...: the words, or "none".
some() {
	if (($#)); then echo "$*"; else echo none; fi
}

check_tcp_port() {
	if [[ ! ${PORT:-1} =~ ^[1-9][0-9]{0,4}$ ]] || ((${PORT:-1} > 65535)); then
		refuse "PORT=$PORT is not a TCP port: give a number from 1 to 65535, such as PORT=2405"
	fi
}

check_serial_port() {
	case ${PORT:-} in
	'') refuse "netboot: PORT is missing: name the port of the board's debug UART, such as PORT=/dev/ttyUSB0" ;;
	socket://*:* | rfc2217://*:*) ;;
	*) [[ -c $PORT ]] || refuse "netboot: PORT=$PORT is not a serial port; this machine has:" \
		"$(some /dev/serial/by-id/* /dev/ttyUSB* /dev/ttyACM*)" ;;
	esac
}

check_board_ip() {
	[[ -z ${BOARD_IP:-} || $BOARD_IP =~ ^[0-9]{1,3}(\.[0-9]{1,3}){3}/[0-9]{1,2}$ ]] ||
		refuse "BOARD_IP=$BOARD_IP is not an address with its prefix, such as BOARD_IP=192.168.1.20/24"
}

# check_image FOLDER: what `make image-buildroot` or `make image-debian` made, for the board.
check_image() {
	local name folder=$1
	[[ ! -d $folder/images ]] || folder+=/images
	for name in uImage "nuc980-${BOARD:-gateway}.dtb"; do
		[[ -f $folder/$name ]] || refuse "there is no image in $folder: it lacks $name;" \
			"make image-buildroot makes build/nuc980_gateway and build/nuc980_netboot, make image-debian build/system"
	done
}

# check_configuration NAME ARGUMENT: an image that configs/ describes, or one for development.
check_configuration() {
	[[ $1 =~ ^[a-z0-9_]+(-development|-offline)?$ && -f configs/${1%-*}_defconfig ]] || refuse "$2: there is no configs/${1}_defconfig; there are" \
		"$(cd configs && some ./*_defconfig | sed 's|[.]/||g; s/_defconfig//g')"
}

check_site() {
	local found
	[[ -d $SITE ]] || refuse "SITE=$SITE is not a folder; docs/image-buildroot.md says what belongs in it"
	for script in post-build place-macs; do
		found=$(SITE_SETTINGS=$SITE "board/nuc980/$script.sh" 2>&1) || refuse "SITE=$SITE: $found"
	done
	command -v python3 >/dev/null || refuse "SITE=$SITE cannot be read without Python; make setup brings it"
	found=$(PYTHONPATH=scripts python3 -m image.rootfs gateway "$SITE" 2>&1) || refuse "SITE=$SITE: $found"
}

check_board() {
	[[ -f board/nuc980/boards/$BOARD/pins.yml ]] || refuse "BOARD=$BOARD: there is no such board;" \
		"boards are $(cd board/nuc980/boards && some ./*/pins.yml | sed 's|[.]/||g; s|/pins.yml||g')"
}

check_signer() {
	for name in KEY CERTIFICATE; do
		[[ -z ${!name:-} || -f ${!name} ]] || refuse "$name=${!name} is not a file; docs/update.md says how to make one"
	done
	[[ -z ${SITE:-} || -f $SITE/update.pem ]] ||
		refuse "SITE=$SITE has no update.pem: its boards take no updates; docs/update.md says how to make one"
}

check_plant() {
	local name
	for name in SEED SEEDS; do
		[[ -z ${!name:-} || ${!name} =~ ^[1-9][0-9]{0,8}$ ]] || refuse "$name=${!name} is not a number from 1"
	done
	[[ -z ${HOURS:-} || $HOURS =~ ^[0-9]{1,4}(\.[0-9]{1,4})?$ ]] || refuse "HOURS=$HOURS is not a number of hours, such as HOURS=0.5"
}

# The builds of Linux, BusyBox, U-Boot, QEMU and Buildroot read a path as words.
check_folder() {
	[[ $PWD != *[[:space:]]* ]] ||
		refuse "make $1: Linux, U-Boot and QEMU cannot be built in a path with a space: move the tree from $PWD"
}

# What is made for the gateway board alone.
check_gateway() {
	[[ ${BOARD:-gateway} == gateway ]] ||
		refuse "make $1 knows the gateway board only; BOARD= goes with dtb, uboot, images, update and netboot"
}

check_device_tree() {
	local found
	[[ -f $DTS ]] || refuse "DTS=$DTS is not a file"
	# shellcheck disable=SC2086 # words
	found=$(scripts/build-dtb.sh --check "$DTS" ${SWITCHES:-} 2>&1) || refuse "SWITCHES=$SWITCHES: $found"
}

[[ -z ${SITE:-} ]] || check_site
for goal; do
	case $goal in
	dtb | uboot | image-* | image | system | update | netboot) check_board ;;&
	run | lab) check_gateway "$goal" ;;&
	run | run-native | centre) check_tcp_port ;;&
	centre) [[ -z ${STATIONS:-} || -f $STATIONS ]] || refuse "STATIONS=$STATIONS is not a file; docs/centre.md says what belongs in it" ;;
	run) [[ -z ${IMAGE_TYPED:-} ]] || check_image "${IMAGE:-.}" ;;
	update) check_signer ;;
	netboot)
		check_serial_port
		check_board_ip
		[[ -z ${IMAGE_TYPED:-} ]] || check_image "build/$IMAGE"
		;;
	image | image-buildroot | source) for image in $IMAGES; do check_configuration "$image" "IMAGES=$image"; done ;;
	menuconfig | linux-menuconfig | savedefconfig | sdk | legal-info | sbom) check_configuration "$IMAGE" "IMAGE=$IMAGE" ;;
	cves)
		check_configuration "$IMAGE" "IMAGE=$IMAGE"
		[[ -z ${NVD:-} || -d $NVD ]] || refuse "NVD=$NVD is not a folder; docs/security.md says what belongs in it"
		;;
	dtb) check_device_tree ;;
	fuzz) [[ $FUZZ_SECONDS =~ ^[1-9][0-9]{0,5}$ ]] || refuse "FUZZ_SECONDS=$FUZZ_SECONDS is not a number of seconds" ;;
	plant) check_plant ;;
	bench) [[ -z ${LIB60870:-} || -d $LIB60870 ]] || refuse "LIB60870=$LIB60870 is not a folder; name the one with lib60870's source" ;;
	esac
done
[[ -z ${DRY_RUN:-} ]] || exit 0
for goal; do
	case $goal in
	run | lab | twin | qemu | uboot | linux* | image-* | image | system | source | test | test-linux | test-netboot | test-twin | test-native | \
		test-debug-kernel | test-offline | soak | bench | cost | busy) check_folder "$goal" ;;
	update | netboot) [[ -n ${IMAGE_TYPED:-} ]] || check_folder "$goal" ;;
	esac
done
