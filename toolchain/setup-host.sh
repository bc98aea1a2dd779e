#!/usr/bin/env bash
# usage: setup-host.sh [--check]
#
# Installs what the other steps need on a Debian or Ubuntu machine: cross compilers for armhf and arm64, qemu's user
# emulation, mmdebstrap, Debian's packaging tools. Nothing of a foreign architecture is installed: foreign headers are
# unpacked into the build folder by cross-build.sh. Then it lets the kernel start foreign programs through qemu
# (binfmt_misc), which the emulated board needs. What is there already is left alone.
#
#   --check   say what is missing, change nothing; exit status 1 if anything is
source "$(dirname "$0")/step.sh"

packages=(
    gcc-arm-linux-gnueabihf libc6-dev-armhf-cross gcc-aarch64-linux-gnu libc6-dev-arm64-cross
    qemu-user-static arch-test mmdebstrap debian-archive-keyring
    dpkg-dev debhelper dh-python fakeroot lintian
    python3-venv openssh-client iproute2 util-linux
)

check=false
for option in "$@"; do
    case $option in
    --help | -h) help ;;
    --check) check=true ;;
    *) misused "no option '$option'" ;;
    esac
done

installed() {
    dpkg-query -W -f='${Status}' "$1" 2>/dev/null | grep -q 'ok installed'
}

binfmt=/proc/sys/fs/binfmt_misc

# register NAME: hand the kernel the line that qemu-user-static brings for it.
register() {
    [ -e "$binfmt/$1" ] && return
    [ -e "$binfmt/register" ] || mount -t binfmt_misc binfmt_misc "$binfmt" 2>/dev/null ||
        refuse "the kernel has no binfmt_misc here (in a container: start it privileged); the emulated board needs it"
    { grep '^:' "/usr/lib/binfmt.d/$1.conf" >"$binfmt/register"; } 2>/dev/null ||
        refuse "the kernel did not take /usr/lib/binfmt.d/$1.conf"
    say "programs for $1 start through qemu"
}

command -v apt-get >/dev/null || refuse "no apt-get: this works on Debian and Ubuntu"
missing=()
for package in "${packages[@]}"; do
    installed "$package" || missing+=("$package")
done

if $check; then
    [ "${#missing[@]}" -eq 0 ] || refuse "missing: ${missing[*]}"
    for name in qemu-arm qemu-aarch64; do
        [ -e "$binfmt/$name" ] || refuse "missing: $binfmt/$name"
    done
    say "nothing is missing"
    exit
fi

if [ "${#missing[@]}" -gt 0 ]; then
    need_root "installs packages"
    need_mb 700
    say "installing ${missing[*]}"
    quietly "apt-get update" apt-get update -q
    quietly "apt-get install" env DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends \
        "${missing[@]}"
fi
for name in qemu-arm qemu-aarch64; do
    [ -e "$binfmt/$name" ] || need_root "registers $name with the kernel"
    register "$name"
done
say "this machine has what the other steps need"
