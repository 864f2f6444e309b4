"""Keys of a cluster file that one launcher alone knows, each in a table of the launcher's name below its machine."""

import msgspec


class LauncherKeys(msgspec.Struct, frozen=True, kw_only=True, rename="kebab", forbid_unknown_fields=True):
    pass


class SshKeys(LauncherKeys, frozen=True):
    options: tuple[str, ...] = ()  # for the program ssh, as ["-J", "gate.lab"]
    tunnel: bool = False  # nothing but ssh gets through, so it carries all that servers there and elsewhere say


class DaskKeys(LauncherKeys, frozen=True):
    scheduler: str = ""  # its address
    scheduler_file: str = ""  # or a file that holds it
    resources: dict[str, float] = {}  # that each server takes of its worker, as {volsplat = 1}


class SlurmKeys(LauncherKeys, frozen=True):
    options: tuple[str, ...] = ()  # for sbatch, of each server, as ["--partition=short", "--mem=16G"]
    folder: str = ""  # that this machine and the nodes see, for logs and the token; empty: the cluster's own


class KubernetesKeys(LauncherKeys, frozen=True):
    namespace: str = "default"
    image: str = ""  # with volsplat in it
    claim: str = ""  # a PersistentVolumeClaim with the volumes, mounted at data-root
    resources: dict[str, str] = {}  # of each server, as {memory = "16Gi"}; threads are its cpu
