#!/usr/bin/env bash
# Runs a command beside a SLURM of one node and no accounting database: one_node.sh COMMAND ... (Debian, as root)
#
# It has namespaces of its own: what is installed and started here is seen by the command alone and is gone with it,
# however it ends. A SLURM of this machine is neither used nor disturbed. Exit code 75: it cannot be set up here.
set -euo pipefail

LOCK=/tmp/osl_analysis_slurm.lock CPUS=${CPUS:-2}

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
	local state=/var/spool/one_node memory
	mkdir -p "$state"/{state,spool} /etc/slurm
	memory=$(awk '/MemTotal/ {print int($2 / 1024 * 0.9)}' /proc/meminfo)
	cat >/etc/slurm/slurm.conf <<-END
		ClusterName=one_node
		SlurmctldHost=$(hostname -s)(127.0.0.1)
		SlurmctldPort=26817
		SlurmdPort=26818
		SlurmUser=root
		StateSaveLocation=$state/state
		SlurmdSpoolDir=$state/spool
		SlurmctldLogFile=$state/slurmctld.log
		SlurmdLogFile=$state/slurmd.log
		ProctrackType=proctrack/linuxproc
		TaskPlugin=task/none
		SelectType=select/cons_tres
		SelectTypeParameters=CR_CPU_Memory
		JobAcctGatherType=jobacct_gather/none
		AccountingStorageType=accounting_storage/none
		SchedulerParameters=sched_interval=2,batch_sched_delay=0
		MinJobAge=3600
		JobRequeue=0
		ReturnToService=2
		KillWait=2
		NodeName=$(hostname -s) NodeAddr=127.0.0.1 CPUs=$CPUS RealMemory=$memory State=UNKNOWN
		PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
	END
}

start() {
	[ -s /etc/munge/munge.key ] || mungekey
	chown munge: /run/munge && chmod 755 /run/munge
	runuser -u munge -- munged
	slurmctld -c
	slurmd -c
	for _ in $(seq 100); do
		if [ "$(sinfo --noheader --format=%T 2>/dev/null)" = idle ]; then return; fi
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
