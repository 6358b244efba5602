"""The manifests: valid, fitting together, and without rights."""

import functools
import os
import re
import shutil
import tempfile
from pathlib import Path

import kubernetes_validate
import yaml

from .common import (DEPLOY, PROJECT, STEADYMESH, Failed, clean_environment, expect, note, read_yaml,
                     run)

# The oldest and the newest Kubernetes that the manifests are for.
VERSIONS = ["1.27", "1.37"]
ONE, MANY = "overlays/example", "overlays/scale-out"
# The component for recordings, which no overlay has unless somebody asks for it.
RECORDINGS = "overlays/example + components/recordings"
FOLDER = DEPLOY / "kubernetes"
# The names of everything that is a node, whatever its role.
NODES = ["steadymesh", "steadymesh-worker"]


def can_build():
    return bool(shutil.which("kubectl") or shutil.which("kustomize"))


@functools.cache
def built(overlay):
    """The manifests of an overlay, with components that it has not if there is a plus; without
    patches where nothing builds them."""
    overlay, *components = overlay.split(" + ")
    if not can_build():
        return [m for part in (overlay, *components) for m in gathered(FOLDER / part)]
    with tempfile.TemporaryDirectory() as folder:
        relative = [os.path.relpath(FOLDER / part, Path(folder).resolve()) for part in (overlay, *components)]
        (Path(folder) / "kustomization.yaml").write_text(yaml.safe_dump(
            {"resources": relative[:1], "components": relative[1:]}))
        command = ["kubectl", "kustomize"] if shutil.which("kubectl") else ["kustomize", "build"]
        return list(yaml.safe_load_all(run(*command, folder)))


def gathered(folder):
    """The files that a kustomization names, and those of others that it names."""
    kustomization = yaml.safe_load((folder / "kustomization.yaml").read_text())
    for name in kustomization.get("resources", []) + kustomization.get("components", []):
        place = folder / name
        if place.is_dir():
            yield from gathered(place)
        else:
            yield from yaml.safe_load_all(place.read_text())


def of_kind(kind, overlay=ONE):
    return [manifest for manifest in built(overlay) if manifest["kind"] == kind]


def named(kind, name, overlay=ONE):
    found = [m for m in of_kind(kind, overlay) if m["metadata"]["name"] == name]
    expect(len(found) == 1, f"{overlay} has {len(found)} of {kind} {name}")
    return found[0]


def pods(overlay):
    """Name and template of everything that has pods."""
    for manifest in of_kind("Deployment", overlay) + of_kind("StatefulSet", overlay):
        yield manifest["metadata"]["name"], manifest["spec"]["template"]


def containers():
    """Where they are, and the containers of all servers, gateways and workers."""
    for overlay in (ONE, MANY):
        for manifest in of_kind("Deployment", overlay):
            [only] = manifest["spec"]["template"]["spec"]["containers"]
            yield f"{manifest['metadata']['name']} in {overlay}", only


def environment(container):
    return {variable["name"]: variable for variable in container.get("env", [])}


def manifests_are_valid():
    if not can_build():
        note("neither kubectl nor kustomize is here: files are checked, not what is built of them")
    for overlay in ("base", ONE, MANY, RECORDINGS):
        for manifest in built(overlay):
            if manifest["apiVersion"].startswith("monitoring.coreos.com/"):
                continue
            for version in VERSIONS:
                where = f"{overlay}: {manifest['kind']} {manifest['metadata']['name']} ({version})"
                try:
                    kubernetes_validate.validate(manifest, version, strict=True)
                except kubernetes_validate.ValidationError as error:
                    raise Failed(f"{where}: {error.message}") from error


def manifests_fit_together():
    for overlay in (ONE, MANY):
        labels = {name: pod["metadata"]["labels"].items() for name, pod in pods(overlay)}
        templates = dict(pods(overlay))
        for service in of_kind("Service", overlay):
            name, spec = service["metadata"]["name"], service["spec"]
            chosen = [pod for pod in labels if spec["selector"].items() <= labels[pod]]
            expect(len(chosen) == 1, f"the Service {name} selects {chosen}")
            [container] = templates[chosen[0]]["spec"]["containers"]
            ports = {port["name"]: port["containerPort"] for port in container["ports"]}
            for port in spec["ports"]:
                expect(ports.get(port["targetPort"]) == port["port"], f"the Service {name}: {port}")
        for kind, key in (("PodDisruptionBudget", "selector"), ("NetworkPolicy", "podSelector")):
            for manifest in of_kind(kind, overlay):
                wanted = manifest["spec"][key]["matchLabels"].items()
                chosen = [pod for pod in labels if wanted <= labels[pod]]
                expect(chosen == [manifest["metadata"]["name"]], f"the {kind} selects {chosen}")
        closed = {manifest["metadata"]["name"] for manifest in of_kind("NetworkPolicy", overlay)}
        expect(closed == labels.keys(), f"{overlay}: {labels.keys() - closed} can be reached by all")
        policy = named("NetworkPolicy", "steadymesh", overlay)
        open_to_all = [rule for rule in policy["spec"]["ingress"] if "from" not in rule]
        expect([rule["ports"] for rule in open_to_all] == [[{"port": "http"}]], "operations are open")


def nodes_are_scraped():
    for overlay in (ONE, MANY):
        services = of_kind("Service", overlay)
        [monitor] = of_kind("ServiceMonitor", overlay)
        wanted = monitor["spec"]["selector"]["matchLabels"].items()
        seen = [s for s in services if wanted <= s["metadata"]["labels"].items()]
        nodes = [manifest["metadata"]["name"] for manifest in of_kind("Deployment", overlay)]
        asked = sorted(service["spec"]["selector"]["app.kubernetes.io/name"] for service in seen)
        expect(asked == sorted(nodes), f"{overlay}: the ServiceMonitor finds {asked}")
        [endpoint] = monitor["spec"]["endpoints"]
        for service in seen:
            ports = [port["name"] for port in service["spec"]["ports"]]
            expect(endpoint["port"] in ports, f"the ServiceMonitor asks {endpoint['port']}")
            job = service["metadata"]["labels"][monitor["spec"]["jobLabel"]]
            expect(job == "steadymesh", f"Prometheus calls it {job}, alerts do not")
        label = "__meta_kubernetes_pod_label_app_kubernetes_io_component"
        expected = {"sourceLabels": [label], "targetLabel": "role"}
        expect(endpoint["relabelings"] == [expected], "nodes have no role")
    if can_build():
        roles = {name: pod["metadata"]["labels"].get("app.kubernetes.io/component")
                 for name, pod in pods(MANY)}
        expect((roles["steadymesh"], roles["steadymesh-worker"]) == ("gateway", "worker"), str(roles))


def pods_have_no_rights():
    docker = (PROJECT / "docker/Dockerfile").read_text()
    user = int(re.search(r"^USER (\d+)$", docker, re.M)[1])
    for overlay in (ONE, MANY, RECORDINGS):
        for name, template in pods(overlay):
            pod = template["spec"]
            expect(pod["securityContext"]["runAsNonRoot"] is True, f"{name} may be root")
            expect(pod["securityContext"]["runAsUser"] == user, f"{name}: the user is {user}")
            expect(pod["securityContext"]["fsGroup"] == user, f"{name} cannot write its volumes")
            expect(pod["securityContext"]["seccompProfile"] == {"type": "RuntimeDefault"},
                   f"{name} has no seccomp")
            expect(pod["automountServiceAccountToken"] is False, f"{name} has a token for the cluster")
            [container] = pod["containers"]
            context = container["securityContext"]
            expect(context["allowPrivilegeEscalation"] is False, f"{name} may gain rights")
            expect(context["readOnlyRootFilesystem"] is True, f"{name}: the root can be written")
            expect(context["capabilities"] == {"drop": ["ALL"]}, f"{name} has capabilities")
            expect({"requests", "limits"} <= container["resources"].keys(), f"{name} may take everything")
            ports = {port["name"]: port["containerPort"] for port in container["ports"]}
            for probe in ("startupProbe", "livenessProbe", "readinessProbe"):
                asked = ports.get(container[probe]["httpGet"]["port"])
                internal = 9090 if name in NODES else 8222
                expect(asked == internal, f"the {probe} of {name} asks {asked}")


def the_server_takes_its_configuration():
    given = {"STEADYMESH_LISTEN": "0.0.0.0:8080", "STEADYMESH_INTERNAL_LISTEN": "0.0.0.0:9090"}
    file = FOLDER / "base/steadymesh.toml"
    for overlay in (ONE, MANY, RECORDINGS):
        for manifest in of_kind("Deployment", overlay):
            [container] = manifest["spec"]["template"]["spec"]["containers"]
            pod = dict(given)
            for name, variable in environment(container).items():
                wanted = variable.get("valueFrom", {}).get("secretKeyRef")
                if wanted:
                    secret = named("Secret", wanted["name"], overlay)
                    pod[name] = secret["stringData"][wanted["key"]]
                else:
                    pod[name] = variable["value"]
            run(STEADYMESH, "config", "--check", file, env=clean_environment(**pod))
            if can_build():
                mounts_are_there(manifest["spec"]["template"]["spec"], overlay)
    example = DEPLOY / "systemd/steadymesh.toml.example"
    run(STEADYMESH, "config", "--check", example, env=clean_environment())
    # With what it has in comments, but for secrets.
    meant = r"^# (role = .*|\[(?:bus|recordings)\]|(?:nats_url|url|max_bytes) = .*)$"
    text, count = re.subn(meant, r"\1", example.read_text(), flags=re.M)
    expect(count == 6, f"{count} settings are in comments")
    with tempfile.NamedTemporaryFile("w", suffix=".toml") as file:
        file.write(text)
        file.flush()
        run(STEADYMESH, "config", "--check", file.name, env=clean_environment())


def mounts_are_there(pod, overlay):
    [container] = pod["containers"]
    volumes = {volume["name"]: volume for volume in pod["volumes"]}
    mounts = {mount["mountPath"]: volumes[mount["name"]] for mount in container["volumeMounts"]}
    asked = Path(container["args"][-1])
    expect(str(asked.parent) in mounts, f"nothing is mounted for {asked}")
    config = named("ConfigMap", mounts[str(asked.parent)]["configMap"]["name"], overlay)
    expect(asked.name in config["data"], f"the ConfigMap has no {asked.name}")
    url = environment(container).get("STEADYMESH_RECORDINGS__URL")
    if overlay == RECORDINGS:
        folder = url["value"].removeprefix("file://")
        claim = mounts[folder]["persistentVolumeClaim"]["claimName"]
        room = named("PersistentVolumeClaim", claim, overlay)["spec"]["resources"]["requests"]["storage"]
        most = int(environment(container)["STEADYMESH_RECORDINGS__MAX_BYTES"]["value"])
        expect(most < 0.9 * int(room.removesuffix("Gi")) * 1024**3, f"{room} are too few")
    else:
        expect(url is None, "it records although nobody asked for that")


def gateways_and_workers_share_a_bus():
    if not can_build():
        note("neither kubectl nor kustomize is here: what is patched is not checked")
        return
    services = {s["metadata"]["name"]: s for s in of_kind("Service", MANY)}
    for name, role in (("steadymesh", "gateway"), ("steadymesh-worker", "worker")):
        manifest = named("Deployment", name, MANY)
        [container] = manifest["spec"]["template"]["spec"]["containers"]
        env = environment(container)
        expect(env["STEADYMESH_ROLE"]["value"] == role, f"{name} is no {role}")
        url = re.fullmatch(r"nats://([\w-]+):(\d+)", env["STEADYMESH_BUS__NATS_URL"]["value"])
        [port] = services[url[1]]["spec"]["ports"]
        expect(str(port["port"]) == url[2], f"{name} asks {url[0]}")
        strategy = manifest["spec"]["strategy"]["type"]
        expect(strategy == "RollingUpdate", f"all of {name} end at a time: {strategy}")
        budget = named("PodDisruptionBudget", name, MANY)["spec"]["maxUnavailable"]
        expect(budget == 1, f"a node with a {role} cannot be drained")
        policy = named("NetworkPolicy", name, MANY)["spec"]
        targets = [(peer["podSelector"]["matchLabels"], rule["ports"])
                   for rule in policy["egress"] for peer in rule["to"] if "podSelector" in peer]
        wanted = (services[url[1]]["spec"]["selector"], [{"port": port["port"]}])
        expect(targets == [wanted], f"{name} may ask {targets}")
        names = [rule for rule in policy["egress"] if {"port": 53, "protocol": "UDP"} in rule["ports"]]
        expect(names, f"{name} cannot look up a name")
    expect(2 <= named("Deployment", "steadymesh", MANY)["spec"]["replicas"], "there is one gateway")
    [ingress] = named("NetworkPolicy", "steadymesh-nats", MANY)["spec"]["ingress"]
    let_in = sorted(peer["podSelector"]["matchLabels"]["app.kubernetes.io/name"]
                    for peer in ingress["from"])
    expect(let_in == NODES, f"NATS is for {let_in}")


def the_bus_is_kept():
    """What is on NATS is on a volume, with room for all that it may hold."""
    nats = named("StatefulSet", "steadymesh-nats", MANY)["spec"]
    [claim] = nats["volumeClaimTemplates"]
    [container] = nats["template"]["spec"]["containers"]
    mounts = {mount["name"]: mount["mountPath"] for mount in container["volumeMounts"]}
    arguments = " ".join(container["args"])
    expect(f"--store_dir {mounts[claim['metadata']['name']]}" in arguments, "frames are in memory")
    expect(f"--config {mounts['configuration']}/nats.conf" in arguments, "another configuration")
    text = (DEPLOY / "nats/nats.conf").read_text()
    most = int(re.search(r"max_file_store: (\d+)GB", text)[1])
    room = claim["spec"]["resources"]["requests"]["storage"]
    expect(most * 1000**3 < int(room.removesuffix("Gi")) * 1024**3, f"{room} are too few")
    image = compose_image("nats")
    expect(container["image"] == image, f"compose.yaml has {image}")


def compose_image(name):
    return read_yaml("compose.yaml")["services"][name]["image"]


def workers_are_as_many_as_needed():
    [scaler] = of_kind("HorizontalPodAutoscaler", MANY)
    target = scaler["spec"]["scaleTargetRef"]
    manifest = named(target["kind"], target["name"], MANY)
    expect("replicas" not in manifest["spec"], "applying it again ends workers")
    expect(2 <= scaler["spec"]["minReplicas"], "frames of a worker that is gone have no other")
    [metric] = scaler["spec"]["metrics"]
    [rule] = read_yaml("kubernetes/prometheus-adapter.yaml")["externalRules"]
    name = metric["external"]["metric"]["name"]
    expect(rule["name"]["as"] == name, f"the adapter has no {name}")


CHECKS = [
    manifests_are_valid,
    manifests_fit_together,
    nodes_are_scraped,
    pods_have_no_rights,
    the_server_takes_its_configuration,
    gateways_and_workers_share_a_bus,
    the_bus_is_kept,
    workers_are_as_many_as_needed,
]
