"""Cluster files: what stands in them is read as it is meant, and whatever is wrong is one line that names the place."""

import os
import socket
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.programs.clusters import ordered
from volsplat.deploy.cluster import orders
from volsplat.deploy.cluster.orders import wanted_servers
from volsplat.deploy.cluster_file import Cluster, Machine, cluster_from_toml, read_cluster
from volsplat.deploy.launcher_keys import DaskKeys, KubernetesKeys, SlurmKeys, SshKeys
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.wire.addresses import parse_address
from volsplat.protocol.wire.encryption import Encryption
from volsplat.splat_server.command import told_address

NODE1 = """[[machines]]
launcher = "ssh"
host = "node1.lab"
map-shade-servers = 2
splat-servers = 1
threads = 8
memory = "8G"
data-root = "/scratch/volumes"
"""
WHOLE = f"""
name = "lab"
client = "desk.lab:7000"
tls = true
silence = 2.0
keep = 600
token-file = "token"

{NODE1}command = "volsplat"
listen = "0.0.0.0:7100"
advertise = "node1.lab"
[machines.ssh]
options = ["-J", "gate.lab"]
"""


# Each key with another value than its default.
EVERY_KEY = (
    """
name = "lab"
client = "desk.lab:7000"
tls = false
silence = 3
keep = 900
token-file = "token"
log-format = "json"

"""
    + NODE1
    + """command = "/opt/volsplat"
listen = "0.0.0.0:7100"
advertise = "node1.lab"
metrics = "0.0.0.0:9100"
metrics-token = "/etc/metrics"
ssh.options = ["-J", "gate.lab"]

[[machines]]
launcher = "ssh"
host = "node2.lab"
map-shade-servers = 3
ssh.tunnel = true

[[machines]]
launcher = "dask"
map-shade-servers = 4
dask = {scheduler = "tcp://desk.lab:8786", scheduler-file = "dask.json", resources = {volsplat = 1}}

[[machines]]
launcher = "slurm"
map-shade-servers = 5
slurm = {options = ["--partition=short"], folder = "/cluster/lab"}

[[machines]]
launcher = "kubernetes"
splat-servers = 6
kubernetes = {namespace = "volumes", image = "volsplat:1", claim = "scans", resources = {memory = "16Gi"}}
"""
)
MEANT = Cluster(
    name="lab",
    client="desk.lab:7000",
    tls=False,
    silence=3.0,
    keep=900.0,
    token_file="token",
    log_format="json",
    machines=(
        Machine(
            launcher="ssh",
            host="node1.lab",
            map_shade_servers=2,
            splat_servers=1,
            threads=8,
            memory="8G",
            data_root="/scratch/volumes",
            command="/opt/volsplat",
            listen="0.0.0.0:7100",
            advertise="node1.lab",
            metrics="0.0.0.0:9100",
            metrics_token="/etc/metrics",
            ssh=SshKeys(options=("-J", "gate.lab")),
        ),
        Machine(launcher="ssh", host="node2.lab", map_shade_servers=3, ssh=SshKeys(tunnel=True)),
        Machine(
            launcher="dask",
            map_shade_servers=4,
            dask=DaskKeys(scheduler="tcp://desk.lab:8786", scheduler_file="dask.json", resources={"volsplat": 1.0}),
        ),
        Machine(
            launcher="slurm",
            map_shade_servers=5,
            slurm=SlurmKeys(options=("--partition=short",), folder="/cluster/lab"),
        ),
        Machine(
            launcher="kubernetes",
            splat_servers=6,
            kubernetes=KubernetesKeys(
                namespace="volumes", image="volsplat:1", claim="scans", resources={"memory": "16Gi"}
            ),
        ),
    ),
)


def told(text: str) -> str:
    with pytest.raises(BadInput) as caught:
        cluster_from_toml(text, "lab.toml")
    return str(caught.value)


def test_every_key_is_read() -> None:
    assert cluster_from_toml(EVERY_KEY, "lab.toml") == MEANT
    tables = [getattr(machine, name) for machine in MEANT.machines for name in ("ssh", "dask", "slurm", "kubernetes")]
    structs: list[msgspec.Struct] = [MEANT, *MEANT.machines, *tables]
    for kind in {type(struct) for struct in structs}:
        for field in msgspec.structs.fields(kind):
            values = [getattr(struct, field.name) for struct in structs if isinstance(struct, kind)]
            assert any(value != field.default for value in values), f"EVERY_KEY lacks {field.encode_name}"


def test_what_a_file_says_is_told_as_numbers_and_addresses() -> None:
    cluster = cluster_from_toml(EVERY_KEY, "lab.toml")
    assert (cluster.map_shade_servers, cluster.splat_servers, cluster.memory_bytes) == (14, 7, 8 << 30)
    assert cluster.encryption is Encryption.NEVER
    first = cluster.machines[0]
    assert (first.listens_at, first.metrics_at) == (("0.0.0.0", 7100), ("0.0.0.0", 9100))
    assert first.advertised_at == ("node1.lab", 0)


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        ('launcher = "ssh"', 'launcher = "rsh"', "machines[0].launcher: 'rsh' is none; choose from local, ssh"),
        ('name = "lab"', 'name = "lab"\nlog-format = "xml"', "log-format: 'xml' is none; choose from text, json"),
        ("map-shade-servers = 2", "map-shade-servers = -1", "machines[0].map-shade-servers: -1 cannot be used"),
        (
            "map-shade-servers = 2",
            "map-shade-serves = 2",
            "map-shade-serves: unknown key; did you mean map-shade-servers?",
        ),
        ("splat-servers = 1", "", "splat-servers: no machine runs any"),
        ('host = "node1.lab"', "", "machines[0].host: the launcher ssh needs to know where"),
        ('host = "node1.lab"', 'host = "-oProxyCommand=x"', "is no name of a machine"),
        ('listen = "0.0.0.0:7100"', 'listen = "7100"', "machines[0].listen: '7100' is not an address"),
        ('listen = "0.0.0.0:7100"', 'listen = "0.0.0.0:65534"', "leaves no room for 3 servers"),
        ('memory = "8G"', 'memory = "much"', "machines[0].memory: memory much: give a size"),
        ('command = "volsplat"', 'command = "\'/my env/volsplat"', 'machines[0].command: "\'/my env/volsplat" cannot'),
        ('command = "volsplat"', 'command = " "', "machines[0].command: ' ' cannot be called"),
        ('advertise = "node1.lab"', 'advertise = "fe80::1:"', "machines[0].advertise: 'fe80::1:' is not an address"),
        (
            'advertise = "node1.lab"',
            'advertise = "http://node1"',
            "machines[0].advertise: 'http://node1' is not an addr",
        ),
        ('advertise = "node1.lab"', 'advertise = "node1/x"', "machines[0].advertise: 'node1/x' is not an address"),
        ('advertise = "node1.lab"', 'advertise = "node1:65536"', "machines[0].advertise: 'node1:65536' is not an addr"),
        ('client = "desk.lab:7000"', 'client = "desk.lab:0"', "client: 'desk.lab:0': servers cannot dial port 0"),
        ('name = "lab"', 'name = "../lab"', "name: '../lab' cannot be used"),
        ('name = "lab"', "", "name: this key is missing"),
        (
            'options = ["-J", "gate.lab"]',
            "jump = 1",
            "machines[0].ssh.jump: unknown key; machines[0].ssh has options",
        ),
    ],
)
def test_what_is_wrong_is_named_with_its_place(before: str, after: str, said: str) -> None:
    line = told(WHOLE.replace(before, after, 1))
    assert line.startswith("lab.toml: ") and said in line


@given(st.data())
def test_damage_is_always_one_line(data: st.DataObject) -> None:
    """Any part of the file replaced by anything."""
    begin = data.draw(st.integers(0, len(WHOLE)))
    end = data.draw(st.integers(begin, min(len(WHOLE), begin + 40)))
    damaged = WHOLE[:begin] + data.draw(st.text(max_size=12)) + WHOLE[end:]
    try:
        assert isinstance(cluster_from_toml(damaged, "lab.toml"), Cluster)
    except BadInput as error:
        assert str(error).startswith("lab.toml") and len(str(error).splitlines()) == 1


VALUES = st.recursive(
    st.one_of(st.integers(), st.floats(), st.booleans(), st.text(max_size=8)),
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(st.text(max_size=5), inner, max_size=3)),
    max_leaves=4,
)


@given(st.sampled_from([line.partition(" = ")[0] for line in WHOLE.splitlines() if " = " in line]), VALUES)
def test_any_value_of_any_key_is_taken_or_refused_in_one_line(key: str, value: object) -> None:
    lines = [f"{key} = {toml(value)}" if line.startswith(f"{key} = ") else line for line in WHOLE.splitlines()]
    try:
        cluster_from_toml("\n".join(lines), "lab.toml")
    except BadInput as error:
        assert key in str(error) and len(str(error).splitlines()) == 1


def toml(value: object) -> str:
    match value:
        case bool():
            return str(value).lower()
        case str():
            return (
                '"' + "".join(f"\\U{ord(letter):08X}" for letter in value if not "\ud800" <= letter <= "\udfff") + '"'
            )
        case list():
            return "[" + ", ".join(map(toml, value)) + "]"
        case dict():
            return "{" + ", ".join(f"{toml(key)} = {toml(inner)}" for key, inner in value.items()) + "}"
    return repr(value)


def test_jobs_do_not_dial_the_loopback_by_which_debian_knows_its_own_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(orders, "host_name", lambda machine: "127.0.1.1")
    monkeypatch.setattr(orders, "NOBODY", "127.0.0.9")  # a machine without a way to others, as far as it knows
    job = 'name = "lab"\n[[machines]]\nlauncher = "slurm"\nsplat-servers = 1\nmap-shade-servers = 1\n'
    assert dials(job) == ["127.0.0.1:7000"] * 2
    monkeypatch.undo()
    monkeypatch.setattr(orders, "host_name", lambda machine: "127.0.1.1")
    try:
        own = own_address()
    except OSError:
        pytest.skip("this machine has no way to others")
    assert dials(job) == [f"{own}:7000"] * 2


def own_address() -> str:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asking:
        asking.connect(("192.0.2.1", 9))
        return str(asking.getsockname()[0])


def dials(text: str) -> list[str]:
    """Where servers dial the client."""
    told = [one.order.arguments for one in ordered(cluster_from_toml(text, "lab.toml"), 7000)]
    return [arguments[arguments.index("--connect") + 1] for arguments in told]


def test_a_machine_s_name_is_looked_up_once_for_all_of_its_servers(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = list[str | None]()

    def host_name(machine: Machine) -> str:
        asked.append(machine.host)
        return "127.0.0.1"

    monkeypatch.setattr(orders, "host_name", host_name)
    several = '[[machines]]\nlauncher = "ssh"\nhost = "{}"\nsplat-servers = 4\nmap-shade-servers = 4\n'
    ordered(cluster_from_toml(f'name = "lab"\n{several.format("a")}{several.format("b")}', "lab.toml"), 7000)
    assert asked == ["a", "a", "b", "b"], "for where it dials, and where it listens"


@pytest.mark.parametrize(("host", "everywhere"), [("::1", "[::]:0"), ("127.0.0.1", "0.0.0.0:0")])
def test_splat_servers_of_this_machine_listen_where_others_dial_it(host: str, everywhere: str) -> None:
    here = '[[machines]]\nlauncher = "local"\nsplat-servers = 1\n'
    there = f'[[machines]]\nlauncher = "ssh"\nhost = "{host}"\nmap-shade-servers = 1\n'
    splat, _ = ordered(cluster_from_toml(f'name = "lab"\n{here}{there}', "lab.toml"), 7000)
    arguments = splat.order.arguments
    assert arguments[arguments.index("--listen") + 1] == everywhere


@given(st.lists(st.sampled_from(["gpu", "gpu-1", "gpu-2", "gpu-2-1", "gpu-3"]), min_size=1, max_size=8))
def test_no_two_servers_have_one_name(hosts: list[str]) -> None:
    machine = '[[machines]]\nlauncher = "manual"\nhost = "{}"\nsplat-servers = 1\nmap-shade-servers = 2\n'
    servers = wanted_servers(cluster_from_toml('name = "lab"\n' + "".join(map(machine.format, hosts)), "lab.toml"))
    assert len({one.name for one in servers}) == len(servers) == 3 * len(hosts)
    for host in {host for host in hosts if hosts.count(host) == 1}:
        assert any(one.name.startswith(f"{host} ") for one in servers), "one that is alone keeps its own"


ADVERTISED = {
    "node1.lab": ("node1.lab", 0),
    "10.0.0.1": ("10.0.0.1", 0),
    "fe80::1": ("fe80::1", 0),
    "[fe80::1]": ("fe80::1", 0),
    "node1.lab:7500": ("node1.lab", 7500),
    "[fe80::1]:7500": ("fe80::1", 7500),
}


@pytest.mark.parametrize("advertise", ADVERTISED)
def test_splat_servers_listen_where_they_are_advertised(advertise: str) -> None:
    """At the port that the file names, and those after it."""
    keys = f'splat-servers = 2\nmap-shade-servers = 1\nlisten = "0.0.0.0:7100"\nadvertise = "{advertise}"\n'
    machine = f'[[machines]]\nlauncher = "manual"\nhost = "node1"\n{keys}'
    *splats, _ = servers = ordered(cluster_from_toml(f'name = "lab"\n{machine}', "lab.toml"), 7000)
    host, first = ADVERTISED[advertise]
    assert {one.wait_at.host for one in servers if one.wait_at} == {host}
    for number, one in enumerate(splats):
        words = one.order.arguments
        listening = parse_address(words[words.index("--listen") + 1])
        assert listening == ("0.0.0.0", first + number if first else 0)
        told = told_address(listening._replace(port=listening.port or 1), words[words.index("--advertise") + 1])
        assert told == (host, listening.port or 1)


def test_ports_that_are_advertised_must_be_there_for_each_splat_server() -> None:
    line = told(WHOLE.replace("splat-servers = 1", "splat-servers = 3").replace('"node1.lab"\n[', '"node1:65534"\n['))
    assert "machines[0].advertise: port 65534 leaves no room for 3 servers" in line


def test_a_pipe_is_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "lab.toml")
    with pytest.raises(BadInput, match="lab.toml: is a pipe, .* write it into a file"):
        read_cluster(tmp_path / "lab.toml")
