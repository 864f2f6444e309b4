"""The launcher `kubernetes`: writes manifests, a Job for each server, for a person to apply and to delete.

The Jobs take the token from a Secret. Splat servers have Services, by whose names the others reach them.
"""

import hashlib
import json
import re
import shlex
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from volsplat.deploy.cluster_file import Machine
from volsplat.deploy.launchers.launcher import Report, Said, Secrets, ServerOrder, ServerState, StartedServer
from volsplat.deploy.private_file import write_private
from volsplat.deploy.server_command import Program
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.wire.addresses import EVERYWHERE
from volsplat.protocol.wire.tokens import TOKEN_VARIABLE

DATA_PORT = 7500  # of a splat server, in its own pod
LONGEST_NAME = 52  # of a Job, that those of its pods have room in a label's 63 characters
USER = 10001  # as whom servers run: nobody in particular
ATTEMPTS = 6  # that a server which fails is started anew by its Job
FINISHED_SECONDS = 3600  # for which the Job of a server that has ended can be looked at
TOKEN_KEY = "token"

Manifest = dict[str, Any]


class KubernetesLauncher:
    def __init__(self, machine: Machine, folder: Path) -> None:
        self._machine, self._keys = machine, machine.kubernetes
        self._cluster = folder.name
        self._folder = folder

    def start(self, orders: Sequence[ServerOrder], secrets: Secrets, report: Report) -> list[StartedServer]:
        self._check()
        items = [self._secret(secrets), *(item for order in orders for item in self._server(order))]
        path = self._folder / f"{_label(orders[0].name)}.json"
        write_private(path, json.dumps({"apiVersion": "v1", "kind": "List", "items": items}, indent=2).encode())
        # Not `apply`, for which a Job that has ended is one that has not changed.
        replace = f"kubectl replace --force -f {shlex.quote(str(path))}"
        report(f"{path} holds {len(orders)} Jobs and the token; start them, again as well, by: {replace}")
        report(f"end them by: kubectl delete -f {shlex.quote(str(path))}")
        names = [(order.name, self._name(order)) for order in orders]
        return [StartedServer(name, f"job/{job}", {"job": job, "manifests": str(path)}) for name, job in names]

    def _check(self) -> None:
        """Raises BadInput for what no manifest can be made of."""
        if not self._keys.image:
            raise BadInput(
                'the launcher kubernetes needs kubernetes.image = "REGISTRY/volsplat:TAG", with volsplat in it'
            )
        if self._machine.listen is not None:
            raise BadInput("listen: pods have no address of their own outside; leave it out: their servers dial client")
        if self._machine.metrics is not None:
            raise BadInput(
                "metrics: pods have no place for the token's file; leave it out with the launcher kubernetes"
            )
        if self._keys.claim and self._machine.data_root is None:
            raise BadInput('kubernetes.claim needs data-root = "/data", where it is mounted')
        if not self._keys.namespace or _label(self._keys.namespace) != self._keys.namespace:
            raise BadInput(
                f"kubernetes.namespace: {self._keys.namespace!r} is no name of one: small letters, digits and -"
            )

    def states(self, servers: Sequence[StartedServer]) -> Mapping[str, Said]:
        asked = Said(ServerState.UNKNOWN, f"Kubernetes tells: kubectl get jobs -n {self._keys.namespace}")
        return {server.name: asked for server in servers}

    def stop(self, servers: Sequence[StartedServer], report: Report) -> None:
        """They end by themselves when no client has come for as long as they are to be kept, or are deleted by hand."""
        for path in dict.fromkeys(server.handle["manifests"] for server in servers):
            delete = f"kubectl delete -f {shlex.quote(path)}"
            report(f"Jobs go on: end them by: {delete}; without a client they end by themselves")

    def logs(self, server: StartedServer, lines: int) -> str:
        where = f"-n {self._keys.namespace} --tail={lines}"
        raise BadInput(f"{server.name}: its pod has its log: kubectl logs job/{server.handle['job']} {where}")

    def _name(self, order: ServerOrder) -> str:
        return self._unique(order.name)

    def _unique(self, name: str) -> str:
        """Though names, and clusters, may differ by what a label cannot hold."""
        mark = hashlib.sha256(f"{self._cluster}\n{name}".encode()).hexdigest()[:6]
        return f"{_label(f'volsplat-{self._cluster}-{name}')[: LONGEST_NAME - 7].rstrip('-')}-{mark}"

    def _meta(self, name: str) -> Manifest:
        labels = {"app.kubernetes.io/name": "volsplat", "app.kubernetes.io/instance": _label(self._cluster)}
        return {"name": name, "namespace": self._keys.namespace, "labels": labels}

    @property
    def _secret_name(self) -> str:
        return self._unique("token")

    def _secret(self, secrets: Secrets) -> Manifest:
        told = {TOKEN_KEY: secrets.token.key.decode()}
        return {"apiVersion": "v1", "kind": "Secret", "metadata": self._meta(self._secret_name), "stringData": told}

    def _server(self, order: ServerOrder) -> Iterator[Manifest]:
        name = self._name(order)
        yield self._job(order, name)
        if order.program is Program.SPLAT_SERVER:
            spec = {"clusterIP": "None", "selector": {"job-name": name}, "ports": [{"name": "data", "port": DATA_PORT}]}
            yield {"apiVersion": "v1", "kind": "Service", "metadata": self._meta(name), "spec": spec}

    def _job(self, order: ServerOrder, name: str) -> Manifest:
        pod = {"metadata": {"labels": self._meta(name)["labels"]}, "spec": self._pod(order, name)}
        spec = {"backoffLimit": ATTEMPTS, "ttlSecondsAfterFinished": FINISHED_SECONDS, "template": pod}
        return {"apiVersion": "batch/v1", "kind": "Job", "metadata": self._meta(name), "spec": spec}

    def _pod(self, order: ServerOrder, name: str) -> Manifest:
        volumes: list[Manifest] = [{"name": "tmp", "emptyDir": {}}]
        if self._keys.claim:
            claim = {"claimName": self._keys.claim, "readOnly": True}
            volumes.append({"name": "data", "persistentVolumeClaim": claim})
        return {
            "restartPolicy": "OnFailure",
            "automountServiceAccountToken": False,
            "enableServiceLinks": False,
            "securityContext": {"runAsNonRoot": True, "runAsUser": USER, "runAsGroup": USER}
            | {"seccompProfile": {"type": "RuntimeDefault"}},
            "containers": [self._container(order, name)],
            "volumes": volumes,
        }

    def _container(self, order: ServerOrder, name: str) -> Manifest:
        mounts: list[Manifest] = [{"name": "tmp", "mountPath": "/tmp"}]
        if self._keys.claim:
            mounts.append({"name": "data", "mountPath": self._machine.data_root, "readOnly": True})
        splat = order.program is Program.SPLAT_SERVER
        return {
            "name": "server",
            "image": self._keys.image,
            "command": [self._machine.command, order.program.command, *order.arguments, *self._reached(name, splat)],
            "env": [
                {"name": TOKEN_VARIABLE, "valueFrom": {"secretKeyRef": {"name": self._secret_name, "key": TOKEN_KEY}}}
            ],
            "resources": {"requests": self._resources(), "limits": self._resources()},
            "securityContext": {"allowPrivilegeEscalation": False, "readOnlyRootFilesystem": True}
            | {"capabilities": {"drop": ["ALL"]}},
            "volumeMounts": mounts,
        } | ({"ports": [{"name": "data", "containerPort": DATA_PORT}]} if splat else {})

    def _reached(self, name: str, splat: bool) -> list[str]:
        """Where other pods find a splat server; what comes later on a command line counts."""
        if not splat:
            return []
        listen = ["--listen", f"{EVERYWHERE}:{DATA_PORT}"]
        elsewhere = self._machine.advertise is not None
        return listen if elsewhere else [*listen, "--advertise", f"{name}.{self._keys.namespace}.svc:{DATA_PORT}"]

    def _resources(self) -> dict[str, str]:
        cores = {} if self._machine.threads is None else {"cpu": str(self._machine.threads)}
        return cores | dict(self._keys.resources)


def _label(text: str) -> str:
    """As a DNS label."""
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")[:63].rstrip("-")


def host_name(machine: Machine) -> None:
    """Unknown: pods reach the client where the cluster file says."""
    return None
