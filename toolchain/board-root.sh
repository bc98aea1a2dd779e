#!/usr/bin/env bash
# usage: board-root.sh [armhf|arm64]
#
# Makes the root of the emulated board, armhf unless told otherwise: Debian bookworm from its main suite, with the packages
# a board has, what tests need (pytest, hypothesis), an ssh server and systemd. It is kept in the build folder, and made
# anew only when this list of packages has changed. A download that breaks leaves nothing behind.
#
# The mirror is the one that apt here uses; BOARD_MIRROR names another.
source "$(dirname "$0")/step.sh"

packages=(
    python3 python3-numpy python3-cffi-backend python3-serial python3-nmea2 python3-pyudev python3-rich python3-aiohttp
    python3-pytest python3-hypothesis openssh-server systemd udev usr-is-merged
)
# What these bring, as a program imports it.
modules='_cffi_backend, aiohttp.web, hypothesis, numpy, pynmea2, pytest, pyudev, rich.live, rich.table, serial'

only_arch "$@"
root=$build/root-$arch
list=usr/share/board-packages

if [ "$(cat "$root/$list" 2>/dev/null)" = "${packages[*]}" ]; then
    say "the root of $arch is there"
    exit
fi
need_root "makes a root"
need mmdebstrap unshare ssh-keygen
need_binfmt
need_mb 700

# In a mount namespace of its own: the root is made in memory, where dpkg need not wait for the disk, then copied.
if [ -z "${BOARD_NAMESPACE:-}" ]; then
    BOARD_NAMESPACE=made exec unshare --mount --propagation private "$toolchain/board-root.sh" "$arch"
fi
work=$(mktemp -d "$build/board-root.XXXXXX")
trap 'umount -l "$work/memory" 2>/dev/null || true; rm -rf --one-file-system "$work"' EXIT
mkdir "$work/memory"
quietly "mounting memory" mount -t tmpfs -o mode=755 board-root "$work/memory"
mirror=${BOARD_MIRROR:-$(host_mirror)}
includes=$(IFS=, && echo "${packages[*]}")

# py3compile for every module of every package takes minutes under qemu: it is left out, and what is imported compiled.
# shellcheck disable=SC2016  # hooks are mmdebstrap's to expand
options=(
    --mode=root --variant=minbase "--architectures=$arch" --components=main "--include=$includes"
    --aptopt='APT::Install-Recommends "false"' --aptopt='Acquire::Languages "none"'
    --dpkgopt='path-exclude=/usr/share/doc/*' --dpkgopt='path-exclude=/usr/share/man/*'
    --dpkgopt='path-exclude=/usr/share/locale/*'
    --hook-dir=/usr/share/mmdebstrap/hooks/merged-usr
    --setup-hook='mkdir -p "$1/etc/apt/preferences.d"'
    --setup-hook='printf "Package: usrmerge\nPin: release *\nPin-Priority: -1\n" >"$1/etc/apt/preferences.d/merged"'
    --essential-hook='chroot "$1" dpkg-divert --local --no-rename --divert /usr/bin/py3compile.real /usr/bin/py3compile'
    --essential-hook='ln -s /bin/true "$1/usr/bin/py3compile"'
    --essential-hook='mkdir -p "$1/etc/ssh" && ssh-keygen -q -A -f "$1"'
    --customize-hook='mv "$1/usr/bin/py3compile.real" "$1/usr/bin/py3compile"'
    --customize-hook='chroot "$1" dpkg-divert --local --no-rename --remove /usr/bin/py3compile'
    --customize-hook="chroot \"\$1\" python3 -c 'import $modules'"
    --customize-hook="echo ${packages[*]} >\"\$1/$list\""
)
say "making the root of $arch (minutes)"
began=$SECONDS
quietly "making the root" mmdebstrap "${options[@]}" "$BOARD_SUITE" "$work/memory/root" \
    ${mirror:+"deb $mirror $BOARD_SUITE main"}
quietly "copying the root" cp -a "$work/memory/root" "$work/root"
rm -rf --one-file-system "$root"
mv "$work/root" "$root"
say "the root of $arch is made: $(du -sm "$root" | cut -f1) MB in $((SECONDS - began)) s"
