"""Four Slurm nodes on this machine for a test: munge, the controller and four node daemons with a configuration of their
own, in process, mount and network namespaces of their own, so that nothing of them outlives the test."""
import os
import pathlib
import secrets
import shutil
import subprocess
import time

from support import measure

NODES = 4
ADDRESS = "10.213.1.1"  # not the loopback: Slurm does not listen where there is nothing else, and we encrypt
TOOLS = {"munged": "munge", "slurmctld": "slurm-wlm", "slurmd": "slurm-wlm", "sbatch": "slurm-wlm", "unshare": "util-linux",
         "nsenter": "util-linux", "ip": "iproute2"}
CONFIGURATION = """\
ClusterName=test
SlurmctldHost={host}({address})
SlurmctldPort=17000
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
CredType=cred/munge
AuthInfo=socket={folder}/munge.socket
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool-%n
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd-%n.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
SchedulerParameters=sched_interval=1,batch_sched_delay=0
ReturnToService=2
KillWait=15
MinJobAge=3600
NodeName=n[1-{nodes}] NodeHostname={host} NodeAddr={address} Port=[17001-{last_port}] CPUs=1 RealMemory=2000
PartitionName=main Nodes=n[1-{nodes}] Default=YES State=UP
"""


def why_not():
    """Why it cannot run here, or None."""
    if os.geteuid() != 0:
        return "the Slurm daemons need root"
    missing = sorted({package for tool, package in TOOLS.items() if shutil.which(tool) is None})
    return f"missing, to be had by apt-get install {' '.join(missing)}" if missing else None


class Farm:
    def __init__(self, folder, environment):
        self.folder = folder
        for name in ("state", *(f"spool-n{k}" for k in range(1, 1 + NODES))):
            (folder / name).mkdir()
        (folder / "munge.key").write_bytes(secrets.token_bytes(128))
        (folder / "munge.key").chmod(0o400)
        (folder / "slurm.conf").write_text(CONFIGURATION.format(
            host=os.uname().nodename, address=ADDRESS, folder=folder, nodes=NODES, last_port=17000 + NODES))
        self.environment = os.environ | environment | {"SLURM_CONF": str(folder / "slurm.conf")}
        self.init = self.launch("init", "unshare", "--fork", "--kill-child", "--pid", "--mount-proc", "--mount", "--net",
                                "sh", "-c", f"ip link set lo up && ip link add nodes type bridge && "
                                f"ip addr add {ADDRESS}/24 dev nodes && ip link set nodes up && echo up && exec sleep infinity")
        self.daemons = []
        try:
            self.enter = ["nsenter", "--target", self.find_init(), "--pid", "--mount", "--net"]
            munge = folder / "munge"
            self.daemon("munged", "--foreground", "--force", f"--key-file={munge}.key", f"--socket={munge}.socket",
                        f"--pid-file={munge}.pid", f"--seed-file={munge}.seed", f"--log-file={munge}.log")
            self.wait("munge answers", lambda: (folder / "munge.socket").exists())
            self.daemon("slurmctld", "-D", "-i")
            for k in range(1, 1 + NODES):
                self.daemon("slurmd", "-D", "-N", f"n{k}", name=f"slurmd-n{k}")
            self.wait("the nodes are idle", lambda: self.output("sinfo", "-h", "-t", "idle", "-o", "%D").strip() == str(NODES),
                      30)
        except BaseException:
            self.end()
            raise

    def launch(self, name, *command):
        with open(self.folder / f"{name}.out", "w") as out:
            return subprocess.Popen([str(w) for w in command], env=self.environment, stdout=out, stderr=subprocess.STDOUT,
                                    stdin=subprocess.DEVNULL, cwd=self.folder, preexec_fn=measure.die_with_parent)

    def find_init(self):
        """The shell that holds the namespaces, a child of `unshare`."""
        self.wait("the namespaces are there", lambda: (self.folder / "init.out").read_text() == "up\n")
        return pathlib.Path(f"/proc/{self.init.pid}/task/{self.init.pid}/children").read_text().split()[0]

    def daemon(self, *command, name=None):
        self.daemons.append(self.launch(name or command[0], *self.enter, *command))

    def output(self, *command):
        """What a Slurm command prints."""
        result = subprocess.run([*self.enter, *map(str, command)], env=self.environment, text=True, stdout=subprocess.PIPE,
                                stderr=subprocess.STDOUT, timeout=60)
        return result.stdout

    def wait(self, what, condition, seconds=60):
        end = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > end:
                raise RuntimeError(f"not within {seconds} s: {what}\n{self.logs()}")
            time.sleep(0.2)

    def logs(self):
        return "\n".join(f"--- {log.name}\n{log.read_text(errors='replace')[-2000:]}" for log in sorted(self.folder.glob("*.out")))

    def end(self):
        """Killing the first process of the namespaces ends all that are in them."""
        self.init.kill()
        self.init.wait()
        for child in self.daemons:
            child.wait(20)
