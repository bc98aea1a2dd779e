#!/usr/bin/env bash
# usage: deploy.sh [--dry-run] [--ssh-config FILE] USER@BOARD
#
# Brings the program onto a board over ssh: copies the Debian packages of the board's architecture (debian-package.sh makes
# them), installs them with what they depend on, writes udev rules for the sensors plugged in there, starts the service
# and shows its status. A second time it upgrades; the board's configuration is kept. USER is root, or may use sudo
# without a password.
#
#   --dry-run           say what would be done; nothing is changed on the board
#   --ssh-config FILE   as ssh's -F: another port, a key, a jump host
source "$(dirname "$0")/step.sh"

dry=false target='' config=()
while [ $# -gt 0 ]; do
    case $1 in
    --help | -h) help ;;
    --dry-run) dry=true ;;
    --ssh-config)
        [ $# -gt 1 ] || misused "--ssh-config takes a file"
        [ -r "$2" ] || misused "--ssh-config: there is no file $2"
        config=(-F "$2")
        shift
        ;;
    -*) misused "no option '$1'" ;;
    *)
        [ -z "$target" ] || misused "one board at a time, '$1' is too many"
        target=$1
        ;;
    esac
    shift
done
[[ $target == ?*@?* ]] || misused "which board? USER@BOARD"
need ssh scp
need_mb 1

# One connection for all, so that a password is asked for once.
work=$(mktemp -d)
options=("${config[@]}" -o ControlMaster=auto -o "ControlPath=$work/ssh" -o ControlPersist=yes -o ConnectTimeout=15)
trap 'ssh "${options[@]}" -O exit "$target" 2>/dev/null || true; rm -rf "$work"' EXIT
on_board() { ssh "${options[@]}" "$target" "$@"; }

found=$(on_board 'dpkg --print-architecture && . /etc/os-release && echo "$VERSION_CODENAME" && id -u' 2>"$log") ||
    refuse "$target cannot be asked: $(tail -n 1 "$log")"
read -r -d '' board_arch codename uid <<<"$found" || true
case $board_arch in
armhf | arm64) ;;
*) refuse "$target is of architecture $board_arch; there are packages for armhf and arm64" ;;
esac
[ "$codename" = "$BOARD_SUITE" ] || say "note: $target runs $codename, the packages are made for $BOARD_SUITE"
sudo='' && [ "$uid" = 0 ] || sudo='sudo -n '
[ -z "$sudo" ] || on_board "sudo -n true" 2>/dev/null || refuse "$target may not use sudo without a password"

package=$build/dist/tinyekf_$(version)_$board_arch.deb
geomag=$(echo "$build"/dist/python3-pygeomag_*_all.deb)
for deb in "$package" "$geomag"; do
    [ -r "$deb" ] || refuse "there is no $deb; toolchain/debian-package.sh $board_arch makes it"
done
say "$target is $board_arch, $codename: $(basename "$package"), $(basename "$geomag")"

if $dry; then
    say "would copy these, then run there:"
    sed 's/^/    /' <<END
${sudo}apt-get install -y ./$(basename "$geomag") ./$(basename "$package")
${sudo}tinyekf devices rules --config /etc/tinyekf/tinyekf.toml --install
${sudo}systemctl enable tinyekf && ${sudo}systemctl restart tinyekf
systemctl status tinyekf
END
    exit
fi

folder=$(on_board 'mktemp -d')
scp -q "${options[@]}" "$geomag" "$package" "$target:$folder/" 2>"$log" || refuse "copying failed: $(tail -n 1 "$log")"
say "installing"
on_board "cd $folder && chmod 755 . && { ${sudo}env DEBIAN_FRONTEND=noninteractive apt-get update -q ||
    echo 'no package lists could be fetched'; ${sudo}env DEBIAN_FRONTEND=noninteractive apt-get install -y -q \
    --allow-downgrades --reinstall -o Dpkg::Options::=--force-confold ./*.deb; } && rm -rf $folder" >"$log" 2>&1 ||
    refuse "installing failed: $(tail -n 1 "$log") (all of it: $log)"
say "writing udev rules"
on_board "${sudo}tinyekf devices rules --config /etc/tinyekf/tinyekf.toml --install" ||
    say "no rules were written; plug the sensors in, and deploy again or run there: sudo tinyekf devices rules --install"
on_board "${sudo}systemctl enable tinyekf" 2>"$log" || refuse "enabling the service failed: $(tail -n 1 "$log")"
if on_board 'test -d /run/systemd/system'; then
    on_board "${sudo}systemctl restart tinyekf" || say "the service did not start; its status says why"
    on_board 'systemctl status --no-pager --lines 5 tinyekf' || refuse "the service does not run on $target"
else
    say "no systemd runs on $target: the service is enabled, and starts when one does"
fi
say "done; its console: ssh -t $target tinyekf ctl status"
