#!/bin/sh
# Builds the fuzzer of the C core: tests/fuzz/build_fuzz_fusion.sh PROGRAM
# Not all of UBSan: on the filter's unrolled loops it costs minutes of compiling (`make test-c` runs these under it).
# Comparisons are not traced: nearly all are of floating-point numbers, and it costs half the speed.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
core=$(ls "$here"/../../csrc/*.c | grep -v -e /vehicle -e /lsa)
exec clang -O2 -g -std=c11 -fno-sanitize-recover=all \
    -fsanitize=fuzzer,address,bounds,shift,signed-integer-overflow,float-cast-overflow,integer-divide-by-zero \
    -fno-sanitize-coverage=trace-cmp,trace-div,trace-gep \
    -I"$here/../../csrc" "$here/fuzz_fusion.c" $core -lm -o "$1"
