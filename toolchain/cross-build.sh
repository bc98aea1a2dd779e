#!/usr/bin/env bash
# usage: cross-build.sh [armhf|arm64] [--float]
#
# Builds the wheel for a board, armhf unless told otherwise (BeagleBone Black: Cortex-A8 with NEON), on this machine: cffi
# writes the extension's C here, the cross compiler compiles it with the C core, and the library and headers of the
# board's own Debian release, unpacked into the build folder, decide which symbols it may use. No interpreter of the
# board is run. The wheel for this machine is built too, and installed into the build folder's own venv: the Python
# part of the board's wheel is taken from it, and replays are compared with it.
#
#   --float   the C core in single precision (TINYEKF_REAL=float); the wheel goes to dist-float
#
# Result: build/board/dist/tinyekf_py-VERSION-cp311-abi3-linux_{armv7l,aarch64}.whl
source "$(dirname "$0")/step.sh"

choice=armhf dist=dist
for option in "$@"; do
    case $option in
    --help | -h) help ;;
    --float) export TINYEKF_REAL=float dist=dist-float ;;
    -*) misused "no option '$option'" ;;
    *) choice=$option ;;
    esac
done
choose_arch "$choice"
python=${PYTHON:-python3}
need "$triplet-gcc" "$triplet-readelf" apt-get dpkg-deb "$python"
need_mb 300

# Every step is done in a folder that is removed at the end, whatever the end; results are moved out of it when complete.
work=$(mktemp -d "$build/cross-build.XXXXXX")
trap 'rm -rf "$work"' EXIT

# The board's C library and headers: by an apt of its own, so that this machine's packages and sources stay as they are.
sysroot=$build/sysroot-$arch
if [ ! -d "$sysroot" ]; then
    say "fetching the board's libraries and headers ($BOARD_SUITE $arch)"
    mirror=${BOARD_MIRROR:-$(host_mirror)}
    [ -n "$mirror" ] || refuse "apt here knows no mirror of Debian $BOARD_SUITE; give its address as BOARD_MIRROR"
    mkdir -p "$work/apt/lists/partial" "$work/apt/archives/partial" "$work/debs" "$work/sysroot"
    keyring=/usr/share/keyrings/debian-archive-keyring.gpg
    echo "deb [signed-by=$keyring] $mirror $BOARD_SUITE main" >"$work/apt/sources.list"
    touch "$work/apt/status"
    apt_of_board=(
        apt-get -q -o "APT::Architecture=$arch" -o "APT::Architectures=$arch" -o "Dir::State=$work/apt"
        -o "Dir::State::status=$work/apt/status" -o "Dir::Cache=$work/apt" -o Dir::Etc::SourceParts=/dev/null
        -o "Dir::Etc::SourceList=$work/apt/sources.list" -o Acquire::Languages=none -o APT::Sandbox::User=root
        -o APT::Update::Error-Mode=any -o Acquire::Retries=2
    )
    quietly "fetching the package list of $BOARD_SUITE $arch" "${apt_of_board[@]}" update
    cd "$work/debs"
    quietly "fetching the board's headers" "${apt_of_board[@]}" download libc6 libc6-dev linux-libc-dev libpython3.11-dev
    for deb in *.deb; do
        quietly "unpacking $deb" dpkg-deb -x "$deb" "$work/sysroot"
    done
    mv "$work/sysroot" "$sysroot"
fi

# This machine's wheel, from a copy of the sources: what lies about in a work tree stays out of it.
venv=$build/venv
if [ ! -d "$venv" ]; then
    say "making a venv for the build"
    quietly "making a venv" "$python" -m venv "$work/venv"
    quietly "installing build tools" "$work/venv/bin/python" -m pip install -q setuptools wheel 'cffi>=1.15'
    # A venv that is moved finds itself again by its interpreter's place; its scripts, which do not, are not used.
    mv "$work/venv" "$venv"
fi
run_python() { "$venv/bin/python" "$@"; }

mkdir "$work/source"
cd "$project"
tar c --exclude='__pycache__' --exclude='*.so' --exclude='_core.c' --exclude='*.egg-info' \
    pyproject.toml setup.py README.md LICENSE csrc acquisition tinyekf_py | tar x -C "$work/source"
export SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct 2>/dev/null || date +%s)}
cd "$work/source"
say "building this machine's wheel"
quietly "building the wheel" "$venv/bin/python" -m pip wheel -q --no-build-isolation \
    --no-deps --wheel-dir "$work/host" .

say "compiling the core for $arch"
CC=$triplet-gcc quietly "writing the extension's C" run_python "$toolchain/emit_core.py" "$work/source/_core.c" "$work/flags"
mapfile -t flags <"$work/flags"
quietly "compiling the core" "$triplet-gcc" "--sysroot=$sysroot" "${cpu_flags[@]}" "${flags[@]}" \
    -fPIC -shared -s -Wl,-z,relro,-z,now -Icsrc "-I$sysroot/usr/include/python3.11" "-I$sysroot/usr/include" \
    csrc/*.c _core.c -lm -o _core.abi3.so

readelf_of_board() { "$triplet-readelf" "$@" --wide _core.abi3.so; }
readelf_of_board --file-header | grep -q "Machine: *$machine\$" || refuse "the core is not for $machine"
if [ "$arch" = armhf ]; then
    readelf_of_board --arch-specific | grep -q 'Tag_ABI_VFP_args: VFP registers' || refuse "the core is not hard-float"
fi
newest=$(readelf_of_board --version-info | grep -o 'GLIBC_[0-9.]*' | sort -V | tail -n 1)
printf '%s\n' "$newest" GLIBC_2.36 | sort -V -C || refuse "the core needs $newest, $BOARD_SUITE has GLIBC_2.36"

say "packing the wheel"
run_wheel() { (cd "$work" && quietly "packing the wheel" "$venv/bin/python" -m wheel "$@"); }
run_wheel unpack --dest "$work" "$work"/host/*.whl
unpacked=$(echo "$work"/tinyekf_py-*/)
mv _core.abi3.so "$unpacked/tinyekf_py/_core.abi3.so"
mkdir "$work/packed"
run_wheel pack --dest-dir "$work/packed" "$unpacked"
run_wheel tags --remove --platform-tag "$platform" "$work"/packed/*.whl

mkdir -p "$build/$dist"
if [ "$dist" = dist ]; then
    quietly "installing this machine's wheel" run_python -m pip install -q "$(echo "$work"/host/*.whl)[geomag]"
    quietly "installing this machine's wheel" run_python -m pip install -q --force-reinstall --no-deps "$work"/host/*.whl
fi
wheel=$(basename "$work"/packed/*.whl)
mv "$work"/host/*.whl "$work"/packed/*.whl "$build/$dist/"
say "build/board/$dist/$wheel: $(stat -c %s "$build/$dist/$wheel") bytes, $machine, newest symbol $newest"
