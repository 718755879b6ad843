#!/usr/bin/env bash
# Runs half of the smoke sweep through real Slurm and directly, and compares the results.
# An argument names the program of the cells, which has `xtask` beside it; without one, both are
# built.
#
# The script starts a cluster of this machine alone, on localhost, with its configuration, state
# and logs in a temporary folder. It submits the script of `cargo xtask ablate --slurm`: an array of
# two tasks, and the merge that waits for them. On every exit it ends all processes that it started.
#
# If Slurm is missing, root on Debian installs it. If Slurm cannot be installed or cannot run, the
# script prints a line `SKIPPED: reason` and ends with status 0. If a sweep fails or a result
# differs, the status is 1.
set -euo pipefail
program=()
xtask=(cargo xtask)
if [ $# -gt 0 ]; then
    program=(--binary "$(realpath "$1")")
    xtask=("$(dirname "${program[1]}")/xtask")
fi
cd "$(dirname "$0")/../.."
PATH=$PATH:/usr/local/sbin:/usr/sbin:/sbin
# This may run inside a job of another cluster: its variables must have no effect.
unset "${!SLURM_@}" "${!SBATCH_@}" "${!SQUEUE_@}" "${!SINFO_@}"

work=$(mktemp -d)
# Munge needs a socket in a folder that other users may enter.
chmod 755 "$work"

# The processes of this cluster, jobs included: their environment names its configuration.
ours() {
    grep -lzsFx "SLURM_CONF=$work/slurm.conf" /proc/[0-9]*/environ | cut -d/ -f3 || true
}
cleanup() {
    status=$?
    trap - EXIT INT TERM HUP
    unset SLURM_CONF
    for second in {1..10}; do
        processes=$(ours)
        [ -n "$processes" ] || break
        # shellcheck disable=SC2086
        kill -s "$([ "$second" -le 2 ] && echo TERM || echo KILL)" $processes 2>/dev/null || true
        sleep 1
    done
    rm -rf "$work"
    exit "$status"
}
trap cleanup EXIT
trap 'exit 1' INT TERM HUP

skip() {
    tail -v -n 20 "$work"/*.log 2>/dev/null || true
    error=$(cat "$work"/*.log 2>/dev/null | grep -iE 'fatal|error' | grep -vi mpi | tail -n 1 || true)
    echo "SKIPPED: $1${error:+: $error}"
    exit 0
}
fail() {
    echo "FAILED: $1" >&2
    tail -v -n 20 "$work"/*.log "$work"/*/*.log "$work"/*/shards/*.log >&2 2>/dev/null || true
    exit 1
}
# within SECONDS COMMAND: repeats the command until it succeeds; fails after that time.
within() {
    local end=$((SECONDS + $1))
    shift
    until "$@"; do
        [ "$SECONDS" -lt "$end" ] || return 1
        sleep 1
    done
}

if [ "$(command -v sbatch squeue sinfo slurmctld slurmd munged | wc -l)" -lt 6 ]; then
    if [ "$(id -u)" != 0 ] || ! command -v apt-get >/dev/null; then
        skip "Slurm or munge is not installed, and this is not root on Debian"
    fi
    echo "installing slurm-wlm and munge"
    # Keep the services of the packages from starting.
    export DEBIAN_FRONTEND=noninteractive RUNLEVEL=1 SYSTEMD_OFFLINE=1
    { apt-get update && apt-get install -y --no-install-recommends slurm-wlm munge; } </dev/null >"$work/apt.log" 2>&1 ||
        skip "slurm-wlm and munge cannot be installed"
    unset DEBIAN_FRONTEND RUNLEVEL SYSTEMD_OFFLINE
fi

# Two ports without a listener.
taken() { (: <"/dev/tcp/127.0.0.1/$1") 2>/dev/null; }
port=$((20000 + RANDOM % 10000))
while taken "$port" || taken $((port + 1)); do port=$((port + 2)); done
host=$(hostname -s) user=$(id -un)
mkdir "$work"/{state,spool}
memory=$(awk '/^MemTotal/ { print int($2 / 1024) }' /proc/meminfo)
printf '%s\n' >"$work/slurm.conf" \
    ClusterName=dsdf "SlurmctldHost=$host(127.0.0.1)" "SlurmctldPort=$port" "SlurmdPort=$((port + 1))" \
    CommunicationParameters=NoInAddrAny,NoCtldInAddrAny "SlurmUser=$user" "SlurmdUser=$user" \
    AuthType=auth/munge "AuthInfo=socket=$work/munge.socket" \
    "StateSaveLocation=$work/state" "SlurmdSpoolDir=$work/spool" \
    "SlurmctldPidFile=$work/slurmctld.pid" "SlurmdPidFile=$work/slurmd.pid" \
    ProctrackType=proctrack/linuxproc TaskPlugin=task/none MpiDefault=none \
    SelectType=select/cons_tres SelectTypeParameters=CR_Core_Memory \
    SlurmdParameters=config_overrides MinJobAge=3600 \
    "NodeName=$host NodeAddr=127.0.0.1 CPUs=$(nproc) RealMemory=$memory" \
    "PartitionName=all Nodes=ALL Default=YES MaxTime=60"
export SLURM_CONF=$work/slurm.conf
(umask 077 && head -c 128 /dev/urandom >"$work/munge.key")
munged --foreground --socket="$work/munge.socket" --key-file="$work/munge.key" --pid-file="$work/munge.pid" \
    --seed-file="$work/munge.seed" --log-file="$work/munge.log" >"$work/munged.log" 2>&1 &
within 30 test -S "$work/munge.socket" || skip "munged does not start"
slurmctld -D >"$work/slurmctld.log" 2>&1 &
slurmd -D >"$work/slurmd.log" 2>&1 &
idle() { [ "$(sinfo -h -o %T 2>&1)" = idle ]; }
within 120 idle || skip "the node does not become idle"
timeout 120 sbatch --wait --output=/dev/null --wrap=true >/dev/null 2>"$work/sbatch.log" || skip "no job runs"

sed -e "s|\"scenes/|\"$PWD/xtask/sweeps/scenes/|" -e 's/^top_k = .*/top_k = [4]/' xtask/sweeps/smoke.toml >"$work/half.toml"
"${xtask[@]}" ablate "$work/half.toml" "${program[@]}" -o "$work/direct" || fail "the direct sweep"
# The folder's name needs quotes. The submission is from a folder outside of the workspace.
array="$work/it's 4%a"
"${xtask[@]}" ablate "$work/half.toml" "${program[@]}" -o "$array" --slurm --shards 2 --jobs 1 || fail "writing submit.sh"
(cd "$work" && bash "$array/submit.sh") || fail "submit.sh"
done_all() { left=$(squeue -h -o '%i %j %T %r') && [ -z "$left" ]; }
within 900 done_all || fail "jobs are not done: ${left:-no answer}"
states=$(squeue -h -t all -o '%i %j %T')
[ "$(grep -c COMPLETED <<<"$states")" = 4 ] || fail "not 4 jobs completed: $states"
for task in 1 2; do
    [ "$(find "$array/shards/$task-of-2/cells" -name result.json | wc -l)" = 1 ] || fail "task $task has not one cell"
done
without_seconds() { sed 's/,[^,]*$//' "$1/results.csv"; }
[ "$(without_seconds "$work/direct" | wc -l)" = 3 ] || fail "the direct sweep has not 2 cells"
diff <(without_seconds "$work/direct") <(without_seconds "$array") || fail "results differ from a direct run"
echo "slurm: 2 cells in 2 tasks and a merge, results equal to a direct run"
