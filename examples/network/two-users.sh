#!/usr/bin/env bash
# Tests the section "Two users on one machine" of docs/network.md: service, relay and one tunnel run as one user, the
# other tunnel and a recorder as a second one, and the tunnels meet on loopback. Both record the increments. Each one of
# the second user must be one of the first user; the tunnel may lose some. It takes about 20 s. It needs root (setpriv),
# the tunnel's program in PATH and a build of the tests:
#   cargo install iceoryx2-integrations-zenoh-link-tunnel-cli --version 0.10.0 --locked
#   sudo --preserve-env=PATH examples/network/two-users.sh [FOLDER WITH THE PROGRAM isotherm]
set -euo pipefail
cd "$(dirname "$0")/../.."
fail() { echo "two-users.sh: $1" >&2; exit 1; }
[ "$(id -u)" = 0 ] || fail "only root can be two users; run it with sudo"
tunnel=$(command -v iox2-link-tunnel-zenoh) || fail "iox2-link-tunnel-zenoh is not in PATH; see the top of this file"

dir=$(mktemp -d /tmp/iso-XXXXXX)
# The users have numbers that no name belongs to.
declare -A number=([near]=61001 [far]=61002)
become() { # become USER COMMAND..: goes on as one of the users, in that user's folder and domains
  local user=$1; shift
  cd "$dir/$user"
  exec setpriv --reuid "${number[$user]}" --regid "${number[$user]}" --clear-groups \
    env HOME="$dir/$user" ISOTHERM_ROOT="$dir/$user" "$@"
}
as() { (become "$@"); }
pids=()
start() { # start LOG USER COMMAND..: in the background
  local log=$1; shift
  become "$@" < /dev/null > "$dir/$log" 2>&1 & pids+=($!)
}
await() { # await TEXT LOG
  for _ in {1..200}; do grep -q "$1" "$dir/$2" && return; sleep 0.1; done
  cat "$dir/$2"; fail "no '$1' after 20 s"
}
finish() {
  kill -9 "${pids[@]}" 2> /dev/null || true
  wait 2> /dev/null || true
  for domain in near/default near/net far/net; do
    rm -f "/dev/shm/isotherm_$(printf %s "$dir/$domain" | sha256sum | cut -c1-8)_"*
  done
  rm -rf "$dir"
}
trap finish EXIT
trap 'exit 1' INT TERM

chmod 755 "$dir"
cp "${1:-target/debug}/isotherm" "$tunnel" "$dir"
for user in near far; do
  cp -r examples/network "$dir/$user"
  cp examples/tables/imu-whole.toml tests/data/run.csv "$dir/$user"
  sed -i 's|tcp/[^"]*:7447|tcp/127.0.0.1:7447|' "$dir/$user/$user.json5"
  chown -R "${number[$user]}" "$dir/$user"
  as "$user" bash -c '../isotherm --domain net status --iceoryx2 > config/iceoryx2.toml'
done

start service near ../isotherm serve --imu imu-whole=imu-whole.toml
await ready service
start relay near ../isotherm relay --imu imu-whole --to net
await connected relay
for user in near far; do
  start "tunnel-$user" "$user" "../$(basename "$tunnel")" --zenoh-config $user.json5 --allow 'isotherm/*/increment' --poll 2
done
start record-near near ../isotherm record --imu imu-whole --stream increment -o increments.csv
start record-far far ../isotherm --domain net record --imu imu-whole --stream increment -o increments.csv
await recording record-near
await recording record-far
as near ../isotherm feed --imu imu-whole --rate 400 run.csv -o fed.csv
sleep 2
# Both have recorded at their own time; all else that an increment has must be equal.
rows() { grep '^[0-9]' "$dir/$1/increments.csv" | cut -d, -f2-16 | sort; }
common() { comm "$1" <(rows near) <(rows far) | wc -l; }
echo "first user: $(rows near | wc -l) increments, second user: $(rows far | wc -l), equal: $(common -12)"
[ "$(common -13)" = 0 ] || fail "the second user has increments that the first one does not have"
