#!/usr/bin/env bash
# Tests docs/network.md on one machine: two network namespaces are the hosts, each with a domain and a tunnel. Prints
# the results. It takes about 6 minutes. It needs root (ip netns), the tunnel's program and a Rust toolchain:
#   cargo install iceoryx2-integrations-zenoh-link-tunnel-cli --version 0.10.0 --locked
#   sudo --preserve-env=PATH examples/network/try.sh [PART..]        PART: steady breaks cost; all unless given
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
cd "$here/../.."
fail() { echo "try.sh: $1" >&2; exit 1; }
[ "$(id -u)" = 0 ] || fail "network namespaces need root; run it with sudo"
tunnel=$(command -v iox2-link-tunnel-zenoh) || fail "iox2-link-tunnel-zenoh is not in PATH; see the top of this file"
command -v ip > /dev/null || fail "ip is missing; install iproute2"
if [ -z "${ISOTHERM_BUILD:-}" ]; then # ISOTHERM_BUILD: a folder with the programs isotherm and network
  cargo build --release --locked --quiet -p isotherm-cli
  cargo build --release --locked --quiet -p isotherm-tests --bin network
  export ISOTHERM_BUILD=target/release
fi
# Everything runs at a real-time priority, so that other processes do not disturb it. PLAIN=1 keeps the normal priority.
if [ -z "${PLAIN:-}" ]; then PLAIN=0 exec chrt -r 10 "$here/${0##*/}" "$@"; fi
isotherm=$PWD/$ISOTHERM_BUILD/isotherm network=$PWD/$ISOTHERM_BUILD/network

# Both namespaces share memory and files. Therefore the far host's domain has another name here than the near host's.
dir=$(mktemp -d /tmp/iso-XXXXXX)
export ISOTHERM_ROOT=$dir
prefix() { echo "isotherm_$(printf %s "$dir/$1" | sha256sum | cut -c1-8)_"; }
declare -A pid
near=iso-near-$$ far=iso-far-$$
finish() {
  for name in "${!pid[@]}"; do kill -9 "${pid[$name]}" 2> /dev/null || true; done
  wait 2> /dev/null
  ip netns del $near 2> /dev/null || true
  ip netns del $far 2> /dev/null || true
  for domain in near net far; do rm -f "/dev/shm/$(prefix $domain)"*; done
  rm -rf "$dir"
}
trap finish EXIT
trap 'exit 1' INT TERM

ip netns add $near && ip netns add $far
ip link add link0 netns $near type veth peer name link0 netns $far
ip -n $near addr add 192.0.2.1/24 dev link0 && ip -n $far addr add 192.0.2.2/24 dev link0
for host in $near $far; do ip -n $host link set lo up && ip -n $host link set link0 up; done

# The shipped configuration, with the root path and prefix of this test.
for host in net far; do
  mkdir -p "$dir/etc-$host/config"
  sed "s|^root-path = .*|root-path = \"$dir/$host\"|; s|^prefix = .*|prefix = \"$(prefix $host)\"|" \
    "$here/config/iceoryx2.toml" > "$dir/etc-$host/config/iceoryx2.toml"
done

# start NAME COMMAND..: runs a command in the background, with its own log
start() { local name=$1; shift; "$@" < /dev/null >> "$dir/$name.log" 2>&1 & pid[$name]=$!; }
stop() { kill "-${2:-TERM}" "${pid[$1]}"; wait "${pid[$1]}" 2> /dev/null || true; unset "pid[$1]"; }
service() { start service "$isotherm" --domain near serve --imu imu-whole=examples/tables/imu-whole.toml; }
relay() { start relay "$isotherm" --domain near relay --imu imu-whole --to net; }
near_tunnel() { cd "$dir/etc-net"; start near-tunnel ip netns exec $near "$tunnel" -z "$here/near.json5" -a 'isotherm/*/increment' --poll 2; cd "$OLDPWD"; }
far_tunnel() { cd "$dir/etc-far"; start far-tunnel ip netns exec $far "$tunnel" -z "$here/far.json5" -a 'isotherm/*/increment' --poll 2; cd "$OLDPWD"; }

# feed HZ SECONDS: sends the recording, repeated as often as necessary
feed() {
  awk -F, -v OFS=, -v rows="$(($1 * $2))" 'NR == 1 { print; next } { row[NR - 2] = $0; n = NR - 1 }
    END { for (i = 0; i < rows; i++) { $0 = row[i % n]; $1 = i; print } }' tests/data/run.csv > "$dir/run.csv"
  "$isotherm" --domain near feed --imu imu-whole --rate "$1" "$dir/run.csv" -o "$dir/fed.csv"
}

# cpu: prints the processor time of relay and tunnels so far [ticks]
cpu() { for name in relay near-tunnel far-tunnel; do awk -v name=$name '{ print name, $14 + $15 }' "/proc/${pid[$name]}/stat"; done; }

# steady HZ SECONDS: compares the increments on both hosts at a steady rate
steady() {
  printf '\n%s Hz for %s s\n' "$1" "$2"
  cpu > "$dir/before"
  "$network" compare near far & local compare=$!
  feed "$1" "$2"
  cpu | paste -d' ' - "$dir/before" | awk -v s="$2" '{ printf "  %s: %.0f %% of a core\n", $1, ($2 - $4) / s }'
  wait $compare
}

# break_it TITLE BREAK REPAIR PAUSE: feeds 25 s at 400 Hz; runs BREAK after 5 s, and REPAIR after PAUSE more seconds
break_it() {
  printf '\n%s\n' "$1"
  "$network" compare near far --idle 8 & local compare=$!
  feed 400 25 & local feed=$!
  sleep 5; printf '             (broken)\n'; eval "$2"
  sleep "$4"; printf '             (repaired)\n'; eval "$3"
  wait $feed || echo "  feed failed"
  wait $compare
}

parts=${*:-steady breaks cost}
service; relay; near_tunnel; far_tunnel
sleep 5
[[ $parts != *steady* ]] || { steady 400 30; steady 2000 20; }
if [[ $parts == *breaks* ]]; then
  link() { ip -n $near link set link0 "$1"; }
  break_it "the link is down for 1 s" "link down" "link up" 1
  break_it "the link is down for 8 s" "link down" "link up" 8
  break_it "near tunnel killed, started 2 s later" "stop near-tunnel 9" near_tunnel 2
  break_it "far tunnel killed, started 2 s later" "stop far-tunnel 9" far_tunnel 2
  break_it "relay killed, started 2 s later" "stop relay 9" relay 2
  break_it "service killed, started 2 s later" "stop service 9" service 2
fi
if [[ $parts == *cost* ]]; then
  # The far tunnel belongs to another machine, so it runs all the time. The service has a higher priority than relay and
  # tunnel.
  for name in relay near-tunnel service; do stop $name; done
  { echo "#!/usr/bin/env bash"; echo "trap 'kill \$(jobs -p); wait; exit' TERM"; echo "chrt -r -p 10 \$\$"
    echo "dir=$dir here=$here near=$near isotherm=$isotherm tunnel=$tunnel; declare -A pid"
    declare -f start relay near_tunnel; echo "relay; near_tunnel; wait"; } > "$dir/link"
  chmod +x "$dir/link"
  service; sleep 2; chrt -a -r -p 30 "${pid[service]}"
  printf '\nRound trips of the acquisition at 2 kHz, in alternating blocks without and with relay and tunnel\n'
  chrt -r 30 "$network" round-trips near far "$dir/link"
fi
