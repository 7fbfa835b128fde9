#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Runs a command beside a SLURM of one node and no accounting database: one_node.sh COMMAND ... (Debian, as root)
# NODES=2 makes two nodes of this machine, each with a daemon of its own; CPUS is of one. REQUEUE=1: a job whose node is
# lost starts again, as SLURM does by default.
#
# It has namespaces of its own: what is installed and started here is seen by the command alone and is gone with it,
# however it ends. A SLURM of this machine is neither used nor disturbed. Exit code 75: it cannot be set up here.
set -euo pipefail

LOCK=/tmp/osl_analysis_slurm.lock CPUS=${CPUS:-2} NODES=${NODES:-1} REQUEUE=${REQUEUE:-0}

cannot() {
	echo "no SLURM for a test here: $1" >&2
	exit 75
}

# Copies of these folders are written to, in memory.
hide_changes() {
	local names folder over
	names=$(cat /etc/resolv.conf)
	mount -t tmpfs tmpfs /run
	for folder in usr etc var; do
		over=/run/over/$folder
		mkdir -p "$over"/{written,work}
		mount -t overlay -o "lowerdir=/$folder,upperdir=$over/written,workdir=$over/work" overlay "/$folder" || return
	done
	rm -f /etc/resolv.conf # perhaps a link to /run
	echo "$names" >/etc/resolv.conf
	mkdir -p /run/lock /run/munge
}

configure() {
	local state=/var/spool/one_node memory n
	mkdir -p "$state"/{state,spool} /etc/slurm
	memory=$(awk -v nodes="$NODES" '/MemTotal/ {print int($2 / 1024 * 0.9 / nodes)}' /proc/meminfo)
	cat >/etc/slurm/slurm.conf <<-END
		ClusterName=one_node
		SlurmctldHost=$(hostname -s)(127.0.0.1)
		SlurmctldPort=26817
		SlurmUser=root
		StateSaveLocation=$state/state
		SlurmdSpoolDir=$state/spool/%n
		SlurmctldLogFile=$state/slurmctld.log
		SlurmdLogFile=$state/%n.log
		SlurmdPidFile=/run/%n.pid
		ProctrackType=proctrack/linuxproc
		TaskPlugin=task/none
		SelectType=select/cons_tres
		SelectTypeParameters=CR_CPU_Memory
		JobAcctGatherType=jobacct_gather/none
		AccountingStorageType=accounting_storage/none
		SchedulerParameters=sched_interval=2,batch_sched_delay=0
		MinJobAge=3600
		JobRequeue=$REQUEUE
		ReturnToService=2
		KillWait=2
		PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
	END
	for n in $(seq "$NODES"); do
		echo "NodeName=node$n NodeHostname=$(hostname -s) NodeAddr=127.0.0.1 Port=$((26817 + n))" \
			"CPUs=$CPUS RealMemory=$memory State=UNKNOWN" >>/etc/slurm/slurm.conf
	done
}

start() {
	local n
	[ -s /etc/munge/munge.key ] || mungekey
	chown munge: /run/munge && chmod 755 /run/munge
	runuser -u munge -- munged
	slurmctld -c
	for n in $(seq "$NODES"); do slurmd -c -N "node$n"; done
	for _ in $(seq 100); do
		if [ "$(sinfo --noheader --format=%D,%T 2>/dev/null)" = "$NODES,idle" ]; then return; fi
		sleep 0.2
	done
	tail -5 /var/spool/one_node/*.log >&2
	return 1
}

if [ $$ != 1 ]; then
	[ "$(id -u)" = 0 ] || cannot "it takes root"
	command -v apt-get >/dev/null || cannot "it takes Debian's packages"
	unshare --mount --pid --fork --mount-proc true 2>/dev/null || cannot "it takes the right to make namespaces"
	exec 9>"$LOCK"
	flock --nonblock 9 || cannot "another test has $LOCK"
	exec unshare --mount --pid --fork --kill-child --mount-proc "$0" "$@"
fi
hide_changes || cannot "folders cannot be overlaid"
if ! command -v slurmctld >/dev/null || ! command -v munged >/dev/null; then
	{ apt-get update -qq && apt-get install -qq -y --no-install-recommends slurm-wlm munge; } >/dev/null 2>&1 ||
		cannot "slurm-wlm cannot be installed"
fi
configure
start
code=0
"$@" || code=$?
exit "$code"
