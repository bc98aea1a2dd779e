#!/usr/bin/env bash
# usage: debian-package.sh [armhf|arm64]
#
# Builds the Debian packages for a board, armhf unless told otherwise: tinyekf, with program, service, default
# configuration and example udev rules, from the wheel that cross-build.sh makes (it is called first); and
# python3-pygeomag, which Debian lacks, from its pinned release on PyPI. It is a package of its own, as Debian's policy
# wants of a library that others could use too, and goes away once Debian has one. Both are checked by lintian.
#
# Result: build/board/dist/tinyekf_VERSION_{armhf,arm64}.deb and python3-pygeomag_VERSION_all.deb
source "$(dirname "$0")/step.sh"

only_arch "$@"
need dpkg-buildpackage dh dh_python3 lintian fakeroot
need_mb 300
"$toolchain/cross-build.sh" "$arch"

work=$(mktemp -d "$build/debian-package.XXXXXX")
trap 'rm -rf "$work"' EXIT
python=$build/venv/bin/python
export SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(git -C "$project" log -1 --format=%ct 2>/dev/null || date +%s)}

# build_package FOLDER SOURCE VERSION WHAT_CHANGED [OPTION...]: in FOLDER, where debian/ is.
build_package() {
    local folder=$1 source=$2 release=$3 change=$4
    shift 4
    cat >"$folder/debian/changelog" <<END
$source ($release) $BOARD_SUITE; urgency=medium

  * $change

 -- $(sed -n 's/^Maintainer: //p' "$folder/debian/control")  $(LC_ALL=C date -u -R -d "@$SOURCE_DATE_EPOCH")
END
    mkdir -p "$folder/debian/source"
    echo '3.0 (native)' >"$folder/debian/source/format"
    (cd "$folder" && quietly "building the package $source" dpkg-buildpackage -b -us -uc -d "$@")
}

say "packing python3-pygeomag"
mkdir "$work/pygeomag"
quietly "fetching pygeomag" "$python" -m pip download -q --no-deps --no-binary :all: --no-build-isolation \
    --require-hashes -d "$work" -r "$toolchain/python3-pygeomag/requirements.txt"
geomag_version=$(sed -n 's/^pygeomag==\([^ ]*\).*/\1/p' "$toolchain/python3-pygeomag/requirements.txt")
tar xzf "$work"/pygeomag-*.tar.gz --strip-components=1 -C "$work/pygeomag"
cp -r "$toolchain/python3-pygeomag/debian" "$work/pygeomag/"
build_package "$work/pygeomag" python-pygeomag "$geomag_version" "Release $geomag_version, packed for tinyekf."

say "packing tinyekf for $arch"
mkdir "$work/tinyekf" "$work/wheel"
(cd "$work/wheel" && "$python" -m zipfile -e "$build"/dist/tinyekf_py-"$(version)"-*-"$platform".whl .)
cp -r "$toolchain/debian" "$work/tinyekf/"
quietly "writing the default configuration" sh -c 'cd / && "$1" -m tinyekf_py.run --config "$2" --print-config >"$3"' \
    - "$python" "$toolchain/debian/board.toml" "$work/tinyekf.toml"
WHEEL=$work/wheel CONFIG=$work/tinyekf.toml build_package "$work/tinyekf" tinyekf "$(version)" \
    "Version $(version); what it brings is in the project's CHANGELOG.md." "-a$arch"

quietly "lintian" lintian --fail-on error --allow-root "$work"/*.changes
mkdir -p "$build/dist"
for deb in "$work"/*.deb; do
    say "build/board/dist/$(basename "$deb"): $(stat -c %s "$deb") bytes"
    mv "$deb" "$build/dist/"
done
