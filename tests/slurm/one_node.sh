#!/usr/bin/env bash
# SLURM on this machine alone, without an accounting database. Debian, as root.
#   one_node.sh start [CPUS]   installs it if it must, starts it, waits until the node is idle
#   one_node.sh stop           ends it; what a former start left in /etc/slurm stays
set -euo pipefail

CONF=/etc/slurm/slurm.conf STATE=/var/spool/osl_analysis_slurm

stop() {
	[ ! -e "$STATE" ] || scancel --user=root 2>/dev/null || true
	for name in slurmd slurmctld; do
		[ ! -s "$STATE/$name.pid" ] || kill "$(cat "$STATE/$name.pid")" 2>/dev/null || true
	done
}

start() {
	local cpus=${1:-$(nproc)} memory
	command -v slurmd >/dev/null || { apt-get update -qq && apt-get install -qq -y --no-install-recommends slurm-wlm munge >/dev/null; }
	if [ -e "$CONF" ] && ! grep -q osl_analysis "$CONF"; then
		echo "$CONF is another SLURM's: it is left alone" >&2
		exit 1
	fi
	stop
	mkdir -p "$STATE"/{state,spool} /etc/slurm
	memory=$(awk '/MemTotal/ {print int($2 / 1024 * 0.9)}' /proc/meminfo)
	cat >"$CONF" <<-END
		# One node for the tests of osl_analysis
		ClusterName=osl_analysis
		SlurmctldHost=$(hostname -s)
		SlurmUser=root
		SlurmctldPidFile=$STATE/slurmctld.pid
		SlurmdPidFile=$STATE/slurmd.pid
		StateSaveLocation=$STATE/state
		SlurmdSpoolDir=$STATE/spool
		SlurmctldLogFile=$STATE/slurmctld.log
		SlurmdLogFile=$STATE/slurmd.log
		ProctrackType=proctrack/linuxproc
		TaskPlugin=task/none
		SelectType=select/cons_tres
		SelectTypeParameters=CR_CPU_Memory
		JobAcctGatherType=jobacct_gather/none
		AccountingStorageType=accounting_storage/none
		SchedulerParameters=sched_interval=2,batch_sched_delay=0
		MinJobAge=3600
		ReturnToService=2
		KillWait=2
		NodeName=$(hostname -s) NodeAddr=127.0.0.1 CPUs=$cpus RealMemory=$memory State=UNKNOWN
		PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
	END
	if ! munge -n >/dev/null 2>&1; then
		[ -s /etc/munge/munge.key ] || mungekey
		mkdir -p /run/munge && chown munge: /run/munge && chmod 755 /run/munge
		runuser -u munge -- munged
	fi
	slurmctld -c
	slurmd -c
	for _ in $(seq 50); do
		[ "$(sinfo --noheader --format=%T 2>/dev/null)" = idle ] && return
		sleep 0.2
	done
	tail -5 "$STATE"/*.log >&2
	exit 1
}

"$@"
