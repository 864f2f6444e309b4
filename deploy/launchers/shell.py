"""Servers started, asked after and ended by a POSIX shell, here or on another machine: the scripts and their answers.

No secret stands in a script: the token comes by its standard input, and goes on in the servers' environment.
"""

import shlex
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from volsplat.deploy.launchers.launcher import Report, Said, Secrets, ServerOrder, ServerState, StartedServer
from volsplat.deploy.launchers.log_files import file_name
from volsplat.deploy.server_command import Program, first_word
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.text.printable import one_line
from volsplat.protocol.wire.tokens import TOKEN_VARIABLE

# A process is known by its number and the moment of its start: numbers are used again.
PROCESS_FUNCTIONS = """
began() {
    sed 's/.*) //' "/proc/$1/stat" 2>/dev/null | {
        read -r state rest && [ "$state" != Z ] && set -- $rest && shift 18 && echo "$1"
    }
}
runs() { [ -n "$2" ] && [ "$(began "$1")" = "$2" ]; }
"""
_FOLDER = "${XDG_STATE_HOME:-$HOME/.local/state}/volsplat/servers"
GRACE_TENTHS = 30  # of a second that servers have to end by themselves before they are killed

Run = Callable[[str, str], str]  # a script and its input: what it prints. Raises BadInput with the reason.


class ShellServers(NamedTuple):
    """A launcher of servers on one machine, whose shell `run` speaks to, and `ask` of what nobody has to wait for."""

    run: Run
    ask: Run
    place: str  # for people
    cluster: str  # name, for its logs
    command: Callable[[Program], str]  # that runs one, as a shell takes it

    def start(self, orders: Sequence[ServerOrder], secrets: Secrets, report: Report) -> list[StartedServer]:
        report(f"{self.place}: starting {len(orders)} servers")
        commands = [self.command(order.program) for order in orders]
        said = self.run(_start_script(self.cluster, orders, commands), secrets.token.key.decode() + "\n")
        lines = [line.split("\t") for line in said.split("\n") if line.count("\t") == 2]
        if len(lines) != len(orders):
            raise BadInput(
                f"{self.place}: the servers cannot be started: {one_line(said)[-300:] or 'nothing was said'}"
            )
        return [
            StartedServer(
                order.name, f"{self.place}, process {process}", {"process": process, "began": began, "log": log}
            )
            for order, (process, began, log) in zip(orders, lines, strict=True)
        ]

    def states(self, servers: Sequence[StartedServer]) -> Mapping[str, Said]:
        asks = "".join(
            f"if runs {process} {began}; then echo running\n"
            f"else printf 'ended %s\\n' \"$(tail -n 1 {log} 2>/dev/null | tr '\\r' ' ')\"; fi\n"
            for process, began, log in map(_quoted, servers)
        )
        try:
            said = self.ask(PROCESS_FUNCTIONS + asks, "").removesuffix("\n").split("\n")
            if len(said) != len(servers):
                raise BadInput(f"{self.place}: its shell answers {one_line(' '.join(said))[-300:]!r}")
        except BadInput as error:
            return {server.name: Said(ServerState.UNKNOWN, str(error)) for server in servers}
        return {server.name: _said(line) for server, line in zip(servers, said, strict=True)}

    def stop(self, servers: Sequence[StartedServer], report: Report) -> None:
        every = [(process, began) for process, began, _ in map(_quoted, servers)]
        # One that was stopped by a signal goes on, to end.
        ends = [
            f"if runs {process} {began}; then kill {process}; kill -CONT {process}; fi\n" for process, began in every
        ]
        waits = [
            f"n=0; while runs {process} {began} && [ $n -lt {GRACE_TENTHS} ]; do sleep 0.1; n=$((n+1)); done\n"
            f"if runs {process} {began}; then kill -9 {process}; fi\n"
            for process, began in every
        ]
        self.run("".join([PROCESS_FUNCTIONS, *ends, *waits]), "")

    def logs(self, server: StartedServer, lines: int) -> str:
        return self.run(f"tail -n {lines} {_quoted(server)[2]}", "")


def _start_script(cluster: str, orders: Sequence[ServerOrder], commands: Sequence[str]) -> str:
    parts = [PROCESS_FUNCTIONS, "umask 077\n", f"IFS= read -r {TOKEN_VARIABLE}\nexport {TOKEN_VARIABLE}\n"]
    parts += [f'd="{_FOLDER}/"{shlex.quote(cluster)}\nmkdir -p "$d" || exit 1\n']
    parts += map(command_check, dict.fromkeys(commands))
    parts += map(_root_check, dict.fromkeys(filter(None, map(_data_root, orders))))
    logs = [f"{file_name(order.name)}.log" for order in orders]
    parts += [f'true >> "$d"/{log} || {{ printf "%s cannot be written\n" "$d"/{log}; exit 1; }}\n' for log in logs]
    for order, command, log in zip(orders, commands, logs, strict=True):
        words = " ".join([command, *map(shlex.quote, order.arguments)])
        parts.append(
            f'[ ! -s "$d"/{log} ] || mv -f "$d"/{log} "$d"/{log}.1\n'  # it may tell why the one before has ended
            f'setsid nohup {words} > "$d"/{log} 2>&1 < /dev/null &\n'
            f'printf "%s\\t%s\\t%s\\n" $! "$(began $!)" "$d"/{log}\n'
        )
    return "".join(parts)


def command_check(command: str) -> str:
    """Ends the script with status 3 where what is to be called is not there."""
    return (
        f"first={first_word(command)}\n"
        'command -v "$first" >/dev/null || { printf "%s is not there\\n" "$first"; exit 3; }\n'
    )


def _data_root(order: ServerOrder) -> str | None:
    _, named, root = "\0".join(order.arguments).partition("--data-root\0")
    return root.partition("\0")[0] if named else None


def _root_check(root: str) -> str:
    """Of the folder that the server will take. Whose home `~user` is, it alone finds out."""
    home, slash, below = root.partition("/")
    if home.startswith("~") and home != "~":
        return ""
    place = f'"$HOME"{slash}{shlex.quote(below)}' if home == "~" else shlex.quote(root)
    line = shlex.quote(f"data-root {root} is no folder there; make it, or name another")
    return f"[ -d {place} ] || {{ printf '%s\\n' {line}; exit 4; }}\n"


def _quoted(server: StartedServer) -> tuple[str, str, str]:
    """Process, beginning and log, safe in a script whatever the state's file says."""
    handle = server.handle
    return shlex.quote(handle["process"]), shlex.quote(handle["began"]), shlex.quote(handle["log"])


def _said(line: str) -> Said:
    if line == "running":
        return Said(ServerState.RUNNING)
    return Said(ServerState.ENDED, one_line(line.removeprefix("ended").strip()) or "without a word")
