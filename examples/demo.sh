#!/bin/sh
# The main job on the simulated robot: a year of wear in 40 seconds, then the commands that evaluate it.
# The shoulder has no play; the elbow's grows.  DEMO_WEB=1: the page is served meanwhile, and afterwards until Ctrl-C.
# Everything lies in a folder of its own, which is removed at the end; DEMO_DIR=FOLDER: in this new folder, which stays.
set -eu
PATH="$(cd "${BIN:-.venv/bin}" && pwd):$PATH"
if [ -n "${DEMO_DIR:-}" ]; then
    if [ -e "$DEMO_DIR" ]; then
        echo "DEMO_DIR: found $DEMO_DIR, maybe of an earlier run, expected a new folder: remove it, or give another name" >&2
        exit 2
    fi
    mkdir "$DEMO_DIR" 2>/dev/null || { echo "DEMO_DIR: cannot make $DEMO_DIR; expected a new folder in one that exists" >&2; exit 2; }
    folder=$(cd "$DEMO_DIR" && pwd) passing=""
else
    folder=$(mktemp -d) passing=$folder
fi
trap 'rm -rf "$passing"' EXIT
trap 'exit 130' INT TERM
cd "$folder"

cat > robot.toml <<'END'
[robot]
name = "demo"

[store]
path = "history.db"

[simulated]
speed = 852324                     # a year in 37 s

[[accelerometer]]
name = "shoulder_tip"
driver = "simulated"
rate_hz = 1000
oscillator = { f_res_hz = 58.0 }

[[accelerometer]]
name = "elbow_tip"
driver = "simulated"
rate_hz = 1000
oscillator = { f_res_hz = 58.0 }

[[joint]]
name = "shoulder"
driver = "simulated"
accelerometer = "shoulder_tip"

[[joint]]
name = "elbow"
driver = "simulated"
accelerometer = "elbow_tip"
play_m = 2e-6                      # gap between the teeth when new
wear_per_year = 4.0                # it grows as exp(4 t): to 110 um in a year

[detector]
statistic = "band"                 # eq. 8; the default would detect the first micrometre at once
level = 60                         # scores: 3 without a gap, 60 at a gap of 10 um (3 arc-minutes)

[alarm]
remind = "once"                    # a day is a tenth of a second here
judged_within_h = 1000             # the robot moves every ten days
END

show() {
    printf '\n$ lostmotion %s\n' "$*"
    lostmotion "$@"
}

show config check robot.toml
show record --config robot.toml --joint elbow --duration 2 -o new.csv   # compiles the model where it never was
show score new.csv --config robot.toml
if [ "${DEMO_WEB:-}" = 1 ]; then
    lostmotion web --config robot.toml &
    page=$!
    trap 'kill "$page" 2>/dev/null || true; rm -rf "$passing"' EXIT
fi
show run --config robot.toml --duration 36
show status --config robot.toml
show alarms ack elbow --config robot.toml
show history shoulder --config robot.toml --limit 5
show history elbow --config robot.toml --limit 5
show trend elbow --config robot.toml

if [ -n "$passing" ]; then
    printf '\nrobot.toml and its history are removed at the end; DEMO_DIR=/tmp/demo make demo keeps them in that folder.\n'
else
    printf '\nrobot.toml and its history are in %s\n' "$folder"
fi

if [ "${DEMO_WEB:-}" = 1 ]; then
    printf '\nThe page is at http://127.0.0.1:8737/ until Ctrl-C.\n'
    wait "$page"
fi
