"""What ssh is given comes to the same by any login shell: a script that a POSIX shell runs, with the same input."""

import shutil
import subprocess

import pytest

from volsplat.deploy.cluster_file import cluster_from_toml
from volsplat.deploy.launchers.ssh import ssh_command

SHELLS = ("sh", "bash", "dash", "zsh", "ksh", "tcsh", "csh", "fish")
SCRIPT = r"""
# It isn't over!
IFS= read -r given
said='a \ b "c" $d !e ~ %s \n \\ ä'
for word in "$said" "it's" "$given"; do
    [ "$word" != no ] && printf '%s\t%s\n' "$PPID" "$word" | cut -f 2
done; sleep 0 & [ -n "$!" ] || exit 1
exit 7
"""


def asked_of_ssh(script: str) -> str:
    machine = '[[machines]]\nlauncher = "ssh"\nhost = "node"\nmap-shade-servers = 1\nsplat-servers = 1\n'
    return ssh_command(cluster_from_toml(f'name = "one"\n{machine}', "one.toml").machines[0], script)[-1]


@pytest.mark.parametrize("shell", [shell for shell in SHELLS if shutil.which(shell)])
def test_a_script_is_run_as_it_is_by_any_login_shell(shell: str) -> None:
    command = [shell, "-c", asked_of_ssh(SCRIPT)]
    ran = subprocess.run(command, input="given\nmore", capture_output=True, encoding="utf-8")
    assert ran.stdout.splitlines() == ['a \\ b "c" $d !e ~ %s \\n \\\\ ä', "it's", "given"], ran.stderr
    assert ran.returncode == 7


def test_nothing_is_said_that_shells_quote_differently() -> None:
    """csh ends at a newline and expands `!` within quotes; fish takes `\\` before `\\` and `'` there for an escape."""
    command = asked_of_ssh(SCRIPT)
    assert not any(found in command for found in ("\n", "!", "\\\\", "\\'"))
