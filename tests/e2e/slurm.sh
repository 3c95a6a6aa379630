#!/usr/bin/env bash
# A SLURM cluster of one node on this machine, for tests: munged, slurmctld, slurmd.
#
#   slurm.sh start DIR    configure it in DIR and start it (needs root)
#   slurm.sh stop DIR     end it
#
# Clients find it through SLURM_CONF=DIR/slurm.conf. Debian: apt-get install slurm-wlm munge
set -euo pipefail
action=$1
dir=$(realpath -m "$2")

start() {
    mkdir -p "$dir"/{state,spool,munge}
    chmod 755 "$dir"
    chmod 700 "$dir/munge"
    [ -f "$dir/munge/key" ] || dd if=/dev/urandom of="$dir/munge/key" bs=1024 count=1 status=none
    chmod 600 "$dir/munge/key"
    munged --force --key-file="$dir/munge/key" --socket="$dir/munge/socket" \
        --pid-file="$dir/munge/pid" --log-file="$dir/munge/log" --seed-file="$dir/munge/seed"
    host=$(hostname -s)
    # Other clusters, of other tests, may run beside this one.
    mapfile -t ports < <(shuf -i 20000-30000 -n 2)
    cat >"$dir/slurm.conf" <<CONF
ClusterName=pourcast-test
SlurmctldHost=$host(127.0.0.1)
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket=$dir/munge/socket
CredType=cred/munge
SlurmctldPort=${ports[0]}
SlurmdPort=${ports[1]}
StateSaveLocation=$dir/state
SlurmdSpoolDir=$dir/spool
SlurmctldPidFile=$dir/slurmctld.pid
SlurmdPidFile=$dir/slurmd.pid
SlurmctldLogFile=$dir/slurmctld.log
SlurmdLogFile=$dir/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SwitchType=switch/none
MpiDefault=none
ReturnToService=2
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SchedulerType=sched/backfill
SchedulerParameters=sched_interval=1,sched_min_interval=100000
AccountingStorageType=accounting_storage/none
JobAcctGatherType=jobacct_gather/none
MinJobAge=300
KillWait=2
NodeName=$host NodeAddr=127.0.0.1 CPUs=$(nproc) RealMemory=$(free -m | awk "/^Mem/ {print \$2 - 256}") State=UNKNOWN
PartitionName=test Nodes=$host Default=YES MaxTime=INFINITE State=UP
CONF
    export SLURM_CONF="$dir/slurm.conf"
    slurmctld -c
    slurmd -c
    for _ in $(seq 60); do
        if sinfo --noheader --format=%T 2>/dev/null | grep -q idle; then
            echo "$SLURM_CONF"
            return
        fi
        sleep 0.5
    done
    echo "the node did not come up; see $dir/slurmctld.log and $dir/slurmd.log" >&2
    return 1
}

stop() {
    for name in slurmd slurmctld munge/; do
        file="$dir/${name}.pid"
        [ "$name" = munge/ ] && file="$dir/munge/pid"
        if [ -f "$file" ]; then kill "$(cat "$file")" 2>/dev/null || true; fi
    done
}

"$action"
