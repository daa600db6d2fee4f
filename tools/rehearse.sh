#!/bin/sh
# Rehearses the whole bench in real time without prism, camera, LCD or screen: an X server with two monitors that
# exist only in memory, `zeromethod virtual-bench` on one side, `zeromethod run` on the other. What is given to it
# goes to `run`. Leaves out/rehearsal.json, out/rehearsal.png and out/truth.jsonl; ends all that it started.
set -eu
BIN=${BIN:-.venv/bin}
mkdir -p out
rm -f out/rehearsal.json out/rehearsal.png out/truth.jsonl
work=$(mktemp -d)
bench= server=
finish() {
    [ -z "$bench" ] || kill "$bench" 2>/dev/null || true
    [ -z "$server" ] || kill "$server" 2>/dev/null || true
    wait
    rm -rf "$work"
}
trap finish EXIT
trap 'exit 130' INT TERM

mkfifo "$work/display"
# sessions of their own: Ctrl-C is for the run, which then still has its bench
setsid Xorg -displayfd 3 -config "$PWD/tests/xorg-dummy.conf" -noreset -nolisten tcp \
    -logfile "$work/xorg.log" 3>"$work/display" 2>"$work/xorg.err" &
server=$!
read -r number <"$work/display" || { cat "$work/xorg.err" >&2; exit 1; }
export DISPLAY=":$number" XDG_SESSION_TYPE=x11
unset WAYLAND_DISPLAY
xrandr --newmode lcd 67 1280 1296 1328 1360 800 803 808 820
for output in DUMMY0 DUMMY1; do xrandr --addmode $output lcd; done
xrandr --output DUMMY0 --mode lcd --primary --output DUMMY1 --mode lcd --right-of DUMMY0
xrandr --query >/dev/null  # an output counts as connected once it is asked for after its first mode

# a rehearsal that is watched goes on until it is stopped, and presses again and again
seconds=27 again=
case " $* " in *" --view"*) seconds=1800 again=--forever ;; esac
setsid "$BIN/zeromethod" virtual-bench --port 0 --truth out/truth.jsonl --start-after 5 $again >"$work/bench" &
bench=$!
until grep -q tcp:// "$work/bench"; do
    kill -0 "$bench" 2>/dev/null || exit 1
    sleep 0.2
done
address=$(grep -o 'tcp://.*' "$work/bench")
echo "zeromethod run --rig virtual --display 1 --camera $address --seconds $seconds $*"
"$BIN/zeromethod" run --rig virtual --display 1 --camera "$address" --seconds $seconds \
    --summary out/rehearsal.json --figure out/rehearsal.png "$@"
"$BIN/python" - <<'P'
import json

run = json.load(open("out/rehearsal.json"))
read_mm = run["depth_peak_mm"]
true_mm = max(json.loads(line)["peak_depth_mm"] for line in list(open("out/truth.jsonl"))[1:])
print(f"peak depth read {read_mm:.5f} mm, true {true_mm:.5f} mm: {100 * (read_mm / true_mm - 1):+.2f} %")
late = run["surface_latency_ms"]
print(
    f"{run['frames_read']} of {run['frames_to_read']} frames read to depth, at most {run['longest_unread']} in a row "
    f"not; from mid-exposure to the surface {late['median']:.0f} ms (99 %: {late['p99']:.0f})"
)
P
