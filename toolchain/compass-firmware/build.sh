#!/usr/bin/env bash
# Builds the compass' firmware for the Arduino Uno with Debian's avr-gcc and Arduino core; writes it to one with --flash.
set -euo pipefail

usage() {
    cat <<'END'
Usage: build.sh [--output DIR] [--simulator] [--flash PORT]

Compiles compass-firmware.ino for the Arduino Uno into DIR/compass.elf and compass.hex (DIR: build/compass-firmware).

  --output DIR    where to build
  --simulator     also builds DIR/simulated-board: an Uno (simavr) with a simulated CMPS11, which runs compass.elf
  --flash PORT    also writes the program to the Uno at PORT, e.g. /dev/fjEC (the live program must not run)
  --help          this text

Needs: gcc-avr avr-libc arduino-core-avr; --simulator: gcc libsimavr-dev libelf-dev; --flash: avrdude.
END
}

fail() {
    echo "build.sh: $1" >&2
    exit "${2:-1}"
}

need() {
    command -v "$1" >/dev/null || fail "$1 is missing; install it with: apt-get install $2"
}

output=""
simulator=false
port=""
while [ $# -gt 0 ]; do
    case "$1" in
        --help) usage; exit 0 ;;
        --simulator) simulator=true; shift ;;
        --output | --flash)
            [ -n "${2:-}" ] || fail "$1 needs a value; see --help" 2
            if [ "$1" = --output ]; then output=$2; else port=$2; fi
            shift 2 ;;
        *) fail "unknown argument $1; see --help" 2 ;;
    esac
done
[ -z "$port" ] || [ -e "$port" ] || fail "there is no port $port"

arduino=/usr/share/arduino/hardware/arduino/avr
need avr-g++ gcc-avr
[ -f /usr/lib/avr/include/avr/io.h ] || fail "avr-libc is missing; install it with: apt-get install avr-libc"
[ -f "$arduino/cores/arduino/Arduino.h" ] || fail "the Arduino core is missing; install it with: apt-get install arduino-core-avr"
[ -z "$port" ] || need avrdude avrdude

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
output=${output:-$(cd "$here/../.." && pwd)/build/compass-firmware}
mkdir -p "$output" 2>/dev/null || fail "cannot make the folder $output"
[ "$(df -k --output=avail "$output" | tail -n 1)" -ge 2048 ] || fail "the disk of $output is full; 2 MB are needed"
objects=$(mktemp -d "$output/objects.XXXXXX" 2>/dev/null) || fail "cannot write to $output"
trap 'rm -rf "$objects"' EXIT

# The Uno, as Arduino's boards.txt and platform.txt have it.
target=(-mmcu=atmega328p -DF_CPU=16000000L -DARDUINO=10819 -DARDUINO_AVR_UNO -DARDUINO_ARCH_AVR)
common=(-Os -flto -ffunction-sections -fdata-sections "${target[@]}"
    -I "$arduino/cores/arduino" -I "$arduino/variants/standard" -I "$arduino/libraries/Wire/src")
# avr-gcc 5.4 has DECIMAL_DIG, which the core asks for, in C only.
cxx=(-std=gnu++11 -DDECIMAL_DIG=__DECIMAL_DIG__ -fno-exceptions -fno-threadsafe-statics "${common[@]}")

compile() {  # compiler and options, then the source as the last argument
    local source=${!#}
    "${@:1:$#-1}" -c "$source" -o "$objects/$(basename "$source").o" || fail "cannot compile $source into $output"
}

for source in "$arduino"/cores/arduino/*.c "$arduino"/libraries/Wire/src/utility/*.c; do
    compile avr-gcc -std=gnu11 -w "${common[@]}" "$source"
done
for source in "$arduino"/cores/arduino/*.cpp "$arduino"/libraries/Wire/src/*.cpp; do
    compile avr-g++ -w "${cxx[@]}" "$source"
done
compile avr-g++ -Wall -Wextra -Werror "${cxx[@]}" -include Arduino.h -x c++ "$here/compass-firmware.ino"

avr-gcc -Os -flto -fuse-linker-plugin -Wl,--gc-sections "${target[@]}" "$objects"/*.o -lm -o "$objects/compass.elf" ||
    fail "cannot link the firmware in $output"
avr-objcopy -O ihex -R .eeprom "$objects/compass.elf" "$objects/compass.hex" || fail "cannot write to $output"
mv "$objects/compass.elf" "$objects/compass.hex" "$output"
avr-size "$output/compass.elf" | awk 'NR == 2 { print "compass.hex: " $1 + $2 " bytes of flash, " $2 + $3 " of RAM" }'

if $simulator; then
    need gcc gcc
    [ -f /usr/include/simavr/sim_avr.h ] || fail "simavr is missing; install it with: apt-get install libsimavr-dev"
    [ -f /usr/include/libelf.h ] || fail "libelf is missing; install it with: apt-get install libelf-dev"
    gcc -std=gnu11 -O2 -Wall -Wextra -Werror -isystem /usr/include/simavr "$here/simulated_board.c" -lsimavr -lelf \
        -o "$objects/simulated-board" || fail "cannot build the simulator in $output"
    mv "$objects/simulated-board" "$output"
fi
if [ -n "$port" ]; then
    avrdude -q -q -p atmega328p -c arduino -P "$port" -b 115200 -D -U "flash:w:$output/compass.hex:i" ||
        fail "the Uno at $port does not take the program; is the live program running, or is it another device?"
fi
