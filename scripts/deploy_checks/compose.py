"""compose.yaml, and what Grafana is given there."""

import functools
import json
import re

import yaml

from .common import DEPLOY, PROJECT, clean_environment, expect, read_yaml, run

# Those that run the server's binary as one, whatever its role.
SERVERS = ["steadymesh", "gateway-1", "gateway-2", "worker"]
PROFILES = {"demo": ["demo"], "scale": ["gateway-1", "gateway-2", "nats", "worker"]}


@functools.cache
def compose():
    file = DEPLOY / "compose.yaml"
    env = clean_environment(GRAFANA_ADMIN_PASSWORD="", GRAFANA_ANONYMOUS="")
    profiles = [word for name in PROFILES for word in ("--profile", name)]
    return yaml.safe_load(run("docker-compose", "--file", file, *profiles, "config", env=env))["services"]


def compose_is_closed():
    for name, service in compose().items():
        expect(service.get("read_only") is True, f"{name}: the root can be written")
        expect(service.get("cap_drop") == ["ALL"], f"{name} has capabilities")
        expect(service.get("security_opt") == ["no-new-privileges:true"], f"{name} may gain rights")
        for limit in ("mem_limit", "pids_limit", "stop_grace_period", "healthcheck", "restart"):
            expect(limit in service, f"{name} has no {limit}")
        for port in service.get("ports", []):
            on = port if isinstance(port, str) else port.get("host_ip", "") + ":"
            expect(on.startswith("127.0.0.1:"), f"{name} is reached from other machines: {port}")
        for volume in service.get("volumes", []):
            text = volume if isinstance(volume, str) else json.dumps(volume)
            is_bind = text.startswith(("/", ".")) or '"bind"' in text
            is_read_only = text.endswith(":ro") or '"read_only": true' in text
            expect(not is_bind or is_read_only, f"{name} may write {text}")
        image = service["image"]
        is_pinned = image == "steadymesh" or re.search(r":v?\d+\.\d+\.\d+(-alpine)?$", image)
        expect(is_pinned, f"{name}: {image} is not a version")
    anonymous = compose()["grafana"]["environment"]["GF_AUTH_ANONYMOUS_ENABLED"]
    expect(anonymous == "false", "Grafana shows everything to everybody")


def profiles_leave_the_server_alone():
    text = (DEPLOY / "compose.yaml").read_text()
    for profile, names in PROFILES.items():
        found = sorted(n for n, s in compose().items() if profile in s.get("profiles", []))
        expect(found == names, f"{profile} has {found}")
    asked = sorted(name for name, service in compose().items() if "profiles" in service)
    expect(asked == sorted(sum(PROFILES.values(), [])), f"a profile is needed for {asked}")
    expect("--scale worker=" in text, "nobody is told how there are more workers")
    expect(compose()["worker"]["scale"] == 2, "frames of a worker that is gone have no other")
    server = compose()["steadymesh"]["environment"]
    expect("STEADYMESH_BUS__NATS_URL" not in server, "the server needs NATS")
    published = [p for s in compose().values() for p in s.get("ports", [])]
    ports = [p.split(":")[1] if isinstance(p, str) else str(p["published"]) for p in published]
    expect(len(ports) == len(set(ports)), f"ports are taken twice: {sorted(ports)}")


def gateways_and_workers_are_on_the_bus():
    services = compose()
    for name in PROFILES["scale"]:
        own = services[name]
        expect("bus" in own["networks"], f"{name} does not reach the bus")
        if name == "nats":
            continue
        role = name.split("-")[0]
        expect(own["command"] == ["serve", "--role", role], f"{name} does {own['command']}")
        url = own["environment"]["STEADYMESH_BUS__NATS_URL"]
        expect(url == "nats://nats:4222", f"{name} looks for the bus at {url}")
        needed = own["depends_on"]["nats"]["condition"]
        expect(needed == "service_healthy", f"{name} does not wait for NATS")
        for setting in ("STEADYMESH_STREAMS__MAX", "STEADYMESH_STREAMS__HISTORY_BYTES"):
            given = own["environment"].get(setting)
            same = given == services["steadymesh"]["environment"][setting]
            expect(same or role == "worker", f"{name} has another {setting}: {given}")
    nats = services["nats"]
    expect(list(nats["networks"]) == ["bus"], "NATS is reached by others")
    expect("ports" not in nats, "NATS is reached from this machine")
    expect(not nats["user"].startswith("0"), "NATS is root")
    others = [name for name in services if "bus" in (services[name].get("networks") or [])]
    expect(sorted(others) == PROFILES["scale"], f"on the bus are {others}")
    mounts = [str(mount) for mount in nats["volumes"]]
    command = " ".join(nats["command"])
    expect("--config /etc/nats/nats.conf" in command, "NATS has another configuration")
    store = re.search(r"--store_dir (\S+)", command)[1]
    expect(any(f"nats:{store}" in mount for mount in mounts), f"{store} is not on the volume")


def recordings_can_be_written():
    server = compose()["steadymesh"]
    url = server["environment"]["STEADYMESH_RECORDINGS__URL"]
    folder = url.removeprefix("file://")
    mounts = [str(mount) for mount in server["volumes"]]
    expect(any(f"recordings:{folder}" in mount for mount in mounts), f"{folder} is on no volume")
    docker = (PROJECT / "docker/Dockerfile").read_text()
    user = re.search(r"^USER (\d+)$", docker, re.M)[1]
    made = re.search(r"install --directory --owner (\d+) --mode 700 (\S+)$", docker, re.M)
    expect(made and made.groups() == (user, folder), f"{folder} is not the user's in the image")


def grafana_finds_what_it_is_given():
    services = compose()
    mounts = [str(mount) for mount in services["grafana"]["volumes"]]
    [source] = read_yaml("grafana/provisioning/datasources/prometheus.yaml")["datasources"]
    expect((source["uid"], source["url"]) == ("prometheus", "http://prometheus:9090"), str(source))
    [provider] = read_yaml("grafana/provisioning/dashboards/steadymesh.yaml")["providers"]
    path = provider["options"]["path"]
    expect(any(path in mount for mount in mounts), f"nothing is mounted on {path}")
    expect(any("/etc/grafana/provisioning" in mount for mount in mounts), "no provisioning")
    home = services["grafana"]["environment"]["GF_DASHBOARDS_DEFAULT_HOME_DASHBOARD_PATH"]
    expect(home == f"{path}/steadymesh.json", f"the home page is {home}")
    interval = read_yaml("prometheus/prometheus.yml")["global"]["scrape_interval"]
    expect(source["jsonData"]["timeInterval"] == interval, f"it is scraped every {interval}")


CHECKS = [
    compose_is_closed,
    profiles_leave_the_server_alone,
    gateways_and_workers_are_on_the_bus,
    recordings_can_be_written,
    grafana_finds_what_it_is_given,
]
