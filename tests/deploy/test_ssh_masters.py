"""ssh that shares connections, as its config may say: a script never becomes the master that stays, but uses one."""

import subprocess
from pathlib import Path

from support.patience import PATIENCE, wait_until
from support.programs.clusters import cluster_file, sshd
from volsplat.deploy.cluster_file import read_cluster
from volsplat.deploy.launchers.ssh import run_there


def test_a_script_leaves_no_master_behind_and_uses_one_that_is_there(tmp_path: Path) -> None:
    """A master keeps the script's standard error open for as long as it stays, and whoever started it waiting."""
    shared = tmp_path / "shared"
    with sshd(tmp_path / "sshd") as ssh:
        sharing = f"'-o', 'ControlMaster=auto', '-o', 'ControlPath={shared}', '-o', 'ControlPersist=60'"
        keys = f"map-shade-servers = 1\nsplat-servers = 1\n{ssh}".replace("options = [", f"options = [{sharing}, ")
        (machine,) = read_cluster(cluster_file(tmp_path, "lab", keys)).machines
        assert run_there(machine, "echo there", "") == "there\n"
        assert not shared.exists()
        command = ["ssh", "-o", "ControlPersist=no", *machine.ssh.options, "-M", "-N", str(machine.host)]
        by_hand = subprocess.Popen(command, stdin=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            wait_until(shared.exists, "opened by hand")
        except BaseException:
            by_hand.kill()
            raise
    try:  # sshd takes no other connection any more
        assert run_there(machine, "echo there", "") == "there\n"
    finally:  # as a person ends it: SIGTERM is lost on an ssh that is just about to wait for the other side
        subprocess.run(["ssh", *machine.ssh.options, "-O", "exit", str(machine.host)], check=True, capture_output=True)
        by_hand.wait(PATIENCE)
