#!/usr/bin/env bash
# A Slurm cluster of virtual nodes on this machine, without systemd and without a trace in /etc:
#   virtual_slurm.sh start FOLDER NUM_NODES     prints the SLURM_CONF to use
#   virtual_slurm.sh lose FOLDER NODE           the node dies: its daemon and all that it ran
#   virtual_slurm.sh stop FOLDER
# Debian's slurmd is built for several of them a machine. Root only; jobs/cluster/setup.sh
# --with-slurm-daemons installs what it needs. Only processes that it started are ever ended.
set -euo pipefail
command=$1 folder=$(realpath -m "$2")

# All processes that descend from one.
descendants() {
  local child
  for child in $(ps -o pid= --ppid "$1"); do
    descendants "$child"
    echo "$child"
  done
}

end_process() {  # PIDFILE SIGNAL
  local pid
  [ -s "$1" ] || return 0
  pid=$(cat "$1")
  kill "-$2" "$pid" 2>/dev/null || return 0
  for _ in $(seq 50); do
    kill -0 "$pid" 2>/dev/null || return 0
    sleep 0.1
  done
  kill -KILL "$pid" 2>/dev/null || true
}

start() {
  local num_nodes=$1 host port munge="$folder/munge" node
  host=$(hostname -s)
  port=$((20000 + $$ % 20000))
  mkdir -p "$folder"/{run,log,state,spool,munge}
  chmod 0755 "$folder"
  dd if=/dev/urandom of="$munge/key" bs=1024 count=1 status=none
  chmod 0400 "$munge/key"
  chmod 0711 "$munge"
  chown -R munge:munge "$munge"
  setpriv --reuid=munge --regid=munge --clear-groups /usr/sbin/munged --force \
    --key-file="$munge/key" --socket="$munge/socket" --pid-file="$munge/munged.pid" \
    --log-file="$munge/log" --seed-file="$munge/seed"
  {
    cat <<CONF
ClusterName=panofix
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=$port
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
# A short credential: else a task of a lost node may not start anew for two minutes.
AuthInfo=socket=$munge/socket,cred_expire=5
CredType=cred/munge
MpiDefault=none
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
AccountingStorageType=accounting_storage/none
JobCompType=jobcomp/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
SchedulerType=sched/backfill
SchedulerParameters=sched_interval=2,bf_interval=2,batch_sched_delay=0
ReturnToService=2
# Else a task that fits no node waits for ever instead of being refused.
EnforcePartLimits=ALL
KillWait=3
MinJobAge=600
SlurmdTimeout=10
StateSaveLocation=$folder/state
SlurmdSpoolDir=$folder/spool/%n
SlurmctldPidFile=$folder/run/slurmctld.pid
SlurmdPidFile=$folder/run/slurmd.%n.pid
SlurmctldLogFile=$folder/log/slurmctld.log
SlurmdLogFile=$folder/log/slurmd.%n.log
CONF
    for node in $(seq "$num_nodes"); do
      echo "NodeName=n$node NodeHostname=$host NodeAddr=127.0.0.1 Port=$((port + node)) CPUs=2" \
        "RealMemory=4000 State=UNKNOWN"
    done
    echo "PartitionName=main Nodes=n[1-$num_nodes] Default=YES MaxTime=INFINITE State=UP"
  } >"$folder/slurm.conf"
  export SLURM_CONF="$folder/slurm.conf"
  slurmctld -i -c 2>"$folder/log/slurmctld.err"
  for node in $(seq "$num_nodes"); do
    mkdir -p "$folder/spool/n$node"
    slurmd -N "n$node" 2>>"$folder/log/slurmd.err"
  done
  for _ in $(seq 300); do
    [ "$(sinfo -h -N -o %T 2>/dev/null | grep -c '^idle$')" -ge "$num_nodes" ] && break
    sleep 0.1
  done
  echo "$SLURM_CONF"
}

# Ends what a node runs. Steps detach from their daemon; the log that they hold open tells whose
# they are.
end_steps() {
  local pid step
  for step in $(pgrep -x slurmstepd || true); do
    ls -l "/proc/$step/fd" 2>/dev/null | grep -q "$folder/log/slurmd.$1.log" || continue
    for pid in $(descendants "$step") "$step"; do kill -KILL "$pid" 2>/dev/null || true; done
  done
}

lose() {
  kill -KILL "$(cat "$folder/run/slurmd.$1.pid")"
  end_steps "$1"
}

stop() {
  local file node
  for file in "$folder/run/slurmctld.pid" "$folder"/run/slurmd.*.pid; do
    end_process "$file" TERM
  done
  for file in "$folder"/log/slurmd.n*.log; do
    node=$(basename "$file" .log)
    end_steps "${node#slurmd.}"
  done
  end_process "$folder/munge/munged.pid" TERM
}

case $command in
  start) start "$3" ;;
  lose) lose "$3" ;;
  stop) stop ;;
  *) echo "virtual_slurm.sh: unknown command '$command'" >&2; exit 64 ;;
esac
