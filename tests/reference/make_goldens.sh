#!/bin/sh
# Makes the golden outputs anew: inputs by Python, outputs by GNU Octave, packed into tests/reference/golden.
#   tests/reference/make_goldens.sh [OUTPUT-FOLDER] [--short]
# PYTHON names the interpreter (default python3). --short leaves the ten-minute recording out (about a minute).
set -eu
here=$(cd "$(dirname "$0")" && pwd)
output=${1:-$here/golden}
short=${2:-}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir -p "$work/out" "$output"
PYTHONPATH="$here/../..${PYTHONPATH:+:$PYTHONPATH}" "${PYTHON:-python3}" "$here/make_cases.py" "$work/in" $short
octave-cli --no-gui --norc --quiet --path "$here" --eval "make_goldens('$work/in', '$work/out')"
for file in "$work"/out/*.csv; do
    gzip -9 --no-name --stdout "$file" > "$output/$(basename "$file").gz"
done
if [ -z "$short" ]; then
    cp "$work/in/ten_minutes.sha256" "$output/"
fi
