#!/usr/bin/env bash
# usage: emulated-board.sh [armhf|arm64] [STEP...] | emulated-board.sh [armhf|arm64] run COMMAND...
#
# A board without the board: the root that board-root.sh makes (it is called first) under qemu's user emulation, with the
# Debian packages that debian-package.sh has made, in a mount, process and network namespace of its own. The cached root
# stays as it is: each run starts from it and leaves nothing.
#
#   packages   install, upgrade with a changed configuration, remove and purge leave what they should
#   deploy     deploy.sh over ssh to an sshd on the board, loopback only; then what it left
#   service    the unit verified and rated by systemd-analyze, its ExecStart run with a notification socket of ours
#   tests      the unit tests
#   replay     a recording replayed here and there, with three methods: the heading CSVs compared byte for byte
#   live       tinyekf run --simulate for 20 s, recorded; its replay is the same, byte for byte
#
# Without STEP all are taken. run starts COMMAND on the board with the packages installed; the project is at /project.
source "$(dirname "$0")/step.sh"

all_steps=(packages deploy service tests replay live)
steps=() command=() choice=armhf
while [ $# -gt 0 ]; do
    case $1 in
    --help | -h) help ;;
    armhf | arm64) choice=$1 ;;
    packages | deploy | service | tests | replay | live) steps+=("$1") ;;
    run)
        command=("${@:2}")
        [ "${#command[@]}" -gt 0 ] || misused "run which command?"
        break
        ;;
    -*) misused "no option '$1'" ;;
    *) misused "no step '$1', there are ${all_steps[*]} and run" ;;
    esac
    shift
done
[ "${#steps[@]}${#command[@]}" != 00 ] || steps=("${all_steps[@]}")
choose_arch "$choice"
package=$build/dist/tinyekf_$(version)_$arch.deb
geomag=$(echo "$build"/dist/python3-pygeomag_*_all.deb)

if [ -z "${BOARD_NAMESPACE:-}" ]; then
    need_root "makes namespaces"
    need unshare ip ssh ssh-keygen
    need_binfmt
    need_mb 100
    "$toolchain/board-root.sh" "$arch"
    for deb in "$package" "$geomag"; do
        [ -r "$deb" ] || refuse "there is no $deb; toolchain/debian-package.sh $arch makes it"
    done
    BOARD_NAMESPACE=made exec unshare --mount --propagation private --pid --fork --kill-child --net --ipc --uts \
        "$0" "$arch" "${steps[@]}" ${command:+run "${command[@]}"}
fi

# Inside the namespaces, as their first process: when it ends, all that it started ends, and every mount goes.
need_mb 100
ip link set lo up
hostname board
work=$(mktemp -d)
board=$work/board
trap '{ umount -R -l "$board"; umount -l "$work/memory"; } 2>/dev/null || true; rm -rf --one-file-system "$work"' EXIT
mkdir "$board" "$work/memory"
mount -t tmpfs -o mode=755 board "$work/memory"
mkdir "$work/memory/upper" "$work/memory/work"
mount -t overlay -o "lowerdir=$build/root-$arch,upperdir=$work/memory/upper,workdir=$work/memory/work" board "$board"
mount -t proc proc "$board/proc"
mount -t tmpfs -o mode=755 run "$board/run"
mount -t tmpfs -o mode=1777 tmp "$board/tmp"
mount -t tmpfs -o mode=755 dev "$board/dev"
for device in null:3 zero:5 full:7 random:8 urandom:9; do
    mknod -m 666 "$board/dev/${device%:*}" c 1 "${device#*:}"
done
mknod -m 666 "$board/dev/tty" c 5 0
mkdir "$board/dev/pts" "$board/dev/shm"
mount -t devpts -o newinstance,ptmxmode=0666,mode=620,gid=5 devpts "$board/dev/pts"
ln -s pts/ptmx "$board/dev/ptmx"
ln -s /proc/self/fd "$board/dev/fd"
mount -t tmpfs -o mode=1777 shm "$board/dev/shm"
mkdir "$board/project" "$board/checks"
mount --bind -o ro "$project" "$board/project"
mount --bind -o ro "$toolchain/board-checks" "$board/checks"
mkdir -p "$build/exchange"
mkdir "$board/exchange"
mount --bind "$build/exchange" "$board/exchange"

on_board() {
    chroot "$board" /usr/bin/env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin LC_ALL=C.UTF-8 HOME=/root TERM=dumb \
        DEBIAN_FRONTEND=noninteractive PYTHONPATH=/usr/lib/tinyekf:/checks "$@"
}

# expect WHAT COMMAND...: what is to hold on the board.
expect() {
    local what=$1
    shift
    "$@" || refuse "$what: it does not hold"
}

# Every file of the root but what any installation changes.
list_files() {
    on_board find / -xdev \( -path /tmp -o -path /exchange -o -path /checks -o -path /project -o -path /var/log \
        -o -path /var/cache -o -path /var/lib/dpkg -o -path /var/lib/apt -o -name __pycache__ \) -prune -o -print | sort
}

install_packages() {
    [ ! -e "$board/usr/bin/tinyekf" ] || return 0
    cp "$package" "$geomag" "$board/tmp/"
    quietly "installing the packages" on_board sh -c 'apt-get install -y -q --no-install-recommends /tmp/*.deb'
}

config=$board/etc/tinyekf/tinyekf.toml
wants=$board/etc/systemd/system/multi-user.target.wants/tinyekf.service

step_packages() {
    list_files >"$work/before"
    install_packages
    expect "the console script answers" on_board tinyekf --help >"$work/help"
    expect "the configuration is one" on_board tinyekf run --config /etc/tinyekf/tinyekf.toml --print-config >"$work/config"
    cmp -s "$config" "$work/config" || refuse "the default configuration is not what the program prints"
    expect "the service is enabled" test -L "$wants"
    echo '# changed by its user' >>"$config"
    quietly "upgrading" on_board sh -c 'dpkg -i --force-confold /tmp/tinyekf_*.deb'
    expect "an upgrade keeps the configuration" grep -q 'changed by its user' "$config"
    quietly "removing" on_board dpkg --remove tinyekf
    expect "removal leaves the configuration" grep -q 'changed by its user' "$config"
    expect "removal leaves no program" test ! -e "$board/usr/lib/tinyekf" -a ! -e "$board/usr/bin/tinyekf"
    quietly "purging" on_board dpkg --purge tinyekf python3-pygeomag
    list_files >"$work/after"
    diff "$work/before" "$work/after" >"$work/left" ||
        refuse "a purge leaves: $(grep '^[<>]' "$work/left" | head -n 5 | tr '\n' ' ')"
    say "packages: installed, upgraded with its changed configuration kept, removed, purged; nothing is left"
}

step_deploy() {
    ssh-keygen -q -t ed25519 -N '' -f "$work/key"
    mkdir -p -m 700 "$board/root/.ssh" "$board/run/sshd"
    cp "$work/key.pub" "$board/root/.ssh/authorized_keys"
    printf 'board %s\n' "$(cut -d ' ' -f 1,2 "$board/etc/ssh/ssh_host_ed25519_key.pub")" >"$work/known"
    cat >"$work/ssh_config" <<END
Host board
    HostName 127.0.0.1
    HostKeyAlias board
    IdentityFile $work/key
    UserKnownHostsFile $work/known
    BatchMode yes
END
    on_board /usr/sbin/sshd -D -e -o ListenAddress=127.0.0.1 2>"$work/sshd.log" &
    local sshd=$!
    until ssh-keyscan -t ed25519 127.0.0.1 2>/dev/null | grep -q ed25519; do
        kill -0 "$sshd" 2>/dev/null || refuse "the board's sshd ended: $(tail -n 1 "$work/sshd.log")"
    done
    deploy=("$toolchain/deploy.sh" --ssh-config "$work/ssh_config" root@board)
    expect "a dry run" "${deploy[@]}" --dry-run
    expect "a dry run changes nothing" test ! -e "$board/usr/bin/tinyekf"
    expect "a deployment" "${deploy[@]}"
    expect "the program is there" test -x "$board/usr/bin/tinyekf"
    expect "the service is enabled" test -L "$wants"
    echo '# changed by its user' >>"$config"
    expect "a second deployment" "${deploy[@]}" >"$work/second"
    expect "a second deployment keeps the configuration" grep -q 'changed by its user' "$config"
    kill "$sshd"
    say "deploy: deployed twice over ssh, configuration kept, service enabled"
}

step_service() {
    install_packages
    expect "systemd takes the unit" on_board systemd-analyze verify --man=no /lib/systemd/system/tinyekf.service
    expect "systemd finds the service safe" on_board systemd-analyze security --offline=true --threshold=25 --no-pager \
        /lib/systemd/system/tinyekf.service >"$work/security"
    say "service: $(tail -n 1 "$work/security" | sed 's/^[^A-Za-z]*//')"
    expect "the service runs" on_board python3 /checks/service.py
}

# From line to estimate: decoders, recordings, the core and its Python face; the simulator's and the fits' take hours here.
# qemu does not know the request that sets a baud rate without a name.
step_tests() {
    install_packages
    local tests=(
        compass_decoder config core ebimu framing gps_decoder heading_csv message output_frame port recording variation
    )
    tests=("${tests[@]/#/tests/unit/test_}")
    quietly "the unit tests on the board" on_board sh -c 'cd /project && exec python3 -P -m pytest -q \
        -p no:cacheprovider -p slow_board -k "not baud_rate_without_a_name" "$@"' - "${tests[@]/%/.py}"
    say "tests: $(tail -n 1 "$log")"
}

step_replay() {
    install_packages
    local here=$build/venv/bin/python exchange=$build/exchange method
    export PYTHONSAFEPATH=1
    quietly "simulating" "$here" -m acquisition.simulator --duration 180 --seed 7 "$exchange/tour.rec" "$exchange/truth.csv"
    for method in adaptive cnw3 ekf-ci; do
        quietly "a replay here" "$here" -m tinyekf_py.run --replay "$exchange/tour.rec" --method "$method" \
            --output "$exchange/here-$method.csv"
        quietly "a replay there" on_board tinyekf run --replay /exchange/tour.rec --method "$method" \
            --output "/exchange/$arch-$method.csv"
        say "replay, $method, $(uname -m) and $arch: $("$here" "$toolchain/board-checks/compare_headings.py" \
            "$exchange/here-$method.csv" "$exchange/$arch-$method.csv" || true)"
    done
}

step_live() {
    install_packages
    quietly "the live run" on_board sh -c 'cd /tmp && tinyekf run --simulate --seed 1 --duration 20 --record live.rec \
        --output live.csv && tinyekf run --replay live.rec --output again.csv'
    cmp "$board/tmp/live.csv" "$board/tmp/again.csv" || refuse "the replay of the live run differs from it"
    local rows with_heading
    rows=$(tail -n +2 "$board/tmp/live.csv" | wc -l)
    with_heading=$(awk -F, 'NR > 1 && $2 != ""' "$board/tmp/live.csv" | wc -l)
    [ "$with_heading" -gt 0 ] || refuse "the live run gave no heading in $rows rows"
    say "live: 20 s, $rows rows, $with_heading with a heading; the replay of its recording is the same, byte for byte"
}

for step in "${steps[@]}"; do
    began=$SECONDS
    "step_$step"
    say "($step took $((SECONDS - began)) s)"
done
if [ "${#command[@]}" -gt 0 ]; then
    install_packages
    on_board "${command[@]}"
fi
