# Sourced by each step of the toolchain: where things are, refusals of one line, and long work that is quiet.
# shellcheck shell=bash
set -euo pipefail

me=$(basename "$0")
toolchain=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
project=$(dirname "$toolchain")
# Everything made goes here; it may be removed at any time.
build=${BOARD_BUILD:-$project/build/board}
log=$build/log/${me%.sh}.log
readonly me toolchain project build log

readonly BOARD_SUITE=bookworm

say() { echo "$me: $*"; }

# What cannot be done: one line, and exit status 1.
refuse() {
    echo "$me: $*" >&2
    exit 1
}

# A command line that is wrong: one line, and exit status 2.
misused() {
    echo "$me: $*; $me --help says more" >&2
    exit 2
}

# The script's own comment at its top is its help.
help() {
    sed -n '2,/^[^#]/{s/^# \{0,1\}//p}' "$0"
    exit 0
}

# need TOOL...: refuse when one is missing.
need() {
    local tool
    for tool in "$@"; do
        command -v "$tool" >/dev/null || refuse "no $tool on this machine; toolchain/setup-host.sh installs it"
    done
}

# need_mb N: make the build folder, and refuse when it has less than N MB free.
need_mb() {
    { mkdir -p "$build/log" && : >"$log"; } 2>/dev/null || refuse "$build cannot be written; give another folder as BOARD_BUILD"
    local free
    free=$(df --output=avail -BM "$build" | tail -n 1 | tr -dc 0-9)
    [ "$free" -ge "$1" ] || refuse "only $free MB are free in $build, $1 MB are needed"
}

need_root() {
    [ "$(id -u)" -eq 0 ] || refuse "this step $1, and takes root: sudo $me"
}

# quietly WHAT COMMAND...: run it with its output in the log; when it fails, its last line is the refusal.
quietly() {
    local what=$1
    shift
    echo "== $what: $*" >>"$log"
    "$@" >>"$log" 2>&1 </dev/null ||
        refuse "$what failed: $(grep -v '^[[:space:]]*$' "$log" | tail -n 1 | cut -c -200) (all of it: $log)"
}

# A Debian architecture's GNU names, compiler flags and wheel platform.
choose_arch() {
    arch=$1
    case $arch in
    armhf)
        triplet=arm-linux-gnueabihf platform=linux_armv7l machine=ARM
        cpu_flags=(-mcpu=cortex-a8 -mfpu=neon -mfloat-abi=hard)
        ;;
    arm64)
        triplet=aarch64-linux-gnu platform=linux_aarch64 machine=AArch64
        cpu_flags=()
        ;;
    *) misused "no architecture '$arch', there are armhf and arm64" ;;
    esac
    readonly arch triplet platform machine cpu_flags
}

# The mirror that this machine's own apt takes Debian from; nothing where it has none (mmdebstrap then knows its own).
host_mirror() {
    apt-get indextargets --format '$(CODENAME) $(COMPONENT) $(REPO_URI)' 'Created-By: Packages' 2>/dev/null |
        awk -v suite="$BOARD_SUITE" '$1 == suite && $2 == "main" {print $3; exit}'
}

version() {
    sed -n 's/^version = "\(.*\)"$/\1/p' "$project/pyproject.toml"
}

# Refuse when the kernel does not start programs of $arch.
need_binfmt() {
    local name=qemu-arm
    [ "$arch" = armhf ] || name=qemu-aarch64
    [ -e "/proc/sys/fs/binfmt_misc/$name" ] ||
        refuse "the kernel does not start programs of $arch; toolchain/setup-host.sh registers $name"
}

# only_arch [ARCH]: the command line of a step that takes nothing but a board's architecture, armhf unless told otherwise.
only_arch() {
    local choice=armhf option
    for option in "$@"; do
        case $option in
        --help | -h) help ;;
        -*) misused "no option '$option'" ;;
        *) choice=$option ;;
        esac
    done
    choose_arch "$choice"
}
