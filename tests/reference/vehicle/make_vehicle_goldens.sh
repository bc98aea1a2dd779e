#!/bin/sh
# Makes the golden tracks anew: drives by Python, tracks by GNU Octave, packed into tests/reference/vehicle/golden.
#   tests/reference/vehicle/make_vehicle_goldens.sh [OUTPUT-FOLDER]
# PYTHON names the interpreter (default python3).
set -eu
here=$(cd "$(dirname "$0")" && pwd)
output=${1:-$here/golden}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir -p "$work/out" "$output"
PYTHONPATH="$here/../../..${PYTHONPATH:+:$PYTHONPATH}" "${PYTHON:-python3}" "$here/vehicle_cases.py" "$work/in"
octave-cli --no-gui --norc --quiet --path "$here/..:$here" --eval "make_vehicle_goldens('$work/in', '$work/out')"
for file in "$work"/out/*.csv; do
    gzip -9 --no-name --stdout "$file" > "$output/$(basename "$file").gz"
done
