"""Prometheus's files, and the numbers that several files have in common."""

import re

from .common import (DEPLOY, PROJECT, defaults, expect, panel, read_yaml, rule, rules, run, unit)
from .compose import SERVERS, compose
from .kubernetes import containers, of_kind

# Every place gives so many seconds for stopping.
STOP_SECS = 60
# After shutdown_grace_secs, once for streams and once for a worker's frames: players and the listener
# of operations 2 s each, webhooks and traces 3 s, the last frames of recordings 5 s.
FAREWELLS_SECS = 15


def prometheus_takes_its_files():
    run("promtool", "check", "config", DEPLOY / "prometheus/prometheus.yml")
    run("promtool", "check", "rules", DEPLOY / "prometheus/alerts.yml")


def alerts_fire_when_they_should():
    run("promtool", "test", "rules", "alerts.test.yml", cwd=DEPLOY / "prometheus")
    tests = read_yaml("prometheus/alerts.test.yml")["tests"]
    cases = [case for test in tests for case in test.get("alert_rule_test", [])]
    fired = {case["alertname"] for case in cases if case["exp_alerts"]}
    page = (PROJECT / "docs/deployment.md").read_text()
    for alert in rules():
        name = alert["alert"]
        expect(name in fired, f"no test has {name} fire")
        expect(alert["labels"]["severity"] in ("page", "ticket"), f"{name} has no severity")
        expect(f"| `{name}` |" in page, f"docs/deployment.md does not say what to do for {name}")


def prometheus_finds_every_node():
    [job] = read_yaml("prometheus/prometheus.yml")["scrape_configs"]
    expect(job["job_name"] == "steadymesh", f"alerts do not know {job['job_name']}")
    [always] = job["static_configs"]
    expect(always["targets"] == ["steadymesh:9090"], f"it always asks {always['targets']}")
    [found] = job["dns_sd_configs"]
    of_profile = {name for name in SERVERS if compose()[name].get("profiles") == ["scale"]}
    expect(set(found["names"]) == of_profile, f"it looks for {found['names']}")
    expect((found["type"], found["port"]) == ("A", 9090), "it asks another port")
    # A node that was stopped on purpose is no target any more before SteadymeshDown tells.
    seconds = int(found["refresh_interval"].removesuffix("s"))
    expect(4 * seconds < int(rule("SteadymeshDown")["for"].removesuffix("s")),
           f"names are looked up every {seconds} s only")
    own = compose()["prometheus"]
    expect("bus" not in own.get("networks", {}), "Prometheus reaches NATS")
    # Else a name that nobody has would be asked for outside, or would be an error.
    expect((own.get("dns_opt"), own.get("dns_search")) == (["ndots:1"], ["."]),
           "names of containers that are not there are looked for elsewhere")


def one_memory_limit_holds_everywhere():
    four_gib = 4 * 1024**3
    expect(rule("MemoryNearLimit")["expr"].endswith("> 0.85 * 4 * 1024 ^ 3"),
           "MemoryNearLimit has another limit")
    shown = panel("Memory")["fieldConfig"]["defaults"]["thresholds"]["steps"][1]["value"]
    expect(shown == round(0.85 * four_gib), f"the dashboard has {shown}")
    for name in SERVERS:
        expect(compose()[name]["mem_limit"] == "4g", f"{name} in compose.yaml has another limit")
    expect(unit()["MemoryMax"] == "4G", "the systemd unit has another limit")
    for name, container in containers():
        expect(container["resources"]["limits"]["memory"] == "4Gi", f"{name} has another limit")


def there_is_time_to_stop():
    config = DEPLOY / "kubernetes/base/steadymesh.toml"
    grace = int(re.search(r"^shutdown_grace_secs = (\d+)$", config.read_text(), re.M)[1])
    example = (DEPLOY / "systemd/steadymesh.toml.example").read_text()
    expect(f"\nshutdown_grace_secs = {grace}\n" in example, "the examples differ")
    expect(defaults()["shutdown_grace_secs"] == grace, "the default differs")
    expect(2 * grace + FAREWELLS_SECS < STOP_SECS, f"{grace} s of grace are too many")
    given = {"the systemd unit": int(unit()["TimeoutStopSec"])}
    for name in SERVERS:
        given[name] = int(compose()[name]["stop_grace_period"].removesuffix("s"))
    for overlay in ("overlays/example", "overlays/scale-out"):
        for manifest in of_kind("Deployment", overlay):
            pod = manifest["spec"]["template"]["spec"]
            where = f"{manifest['metadata']['name']} in {overlay}"
            given[where] = pod["terminationGracePeriodSeconds"]
    for place, seconds in given.items():
        expect(seconds == STOP_SECS, f"{place} gives {seconds} s for stopping")


def the_bus_has_room():
    """Sizes in nats.conf, and numbers of frames in alerts, dashboard and autoscaler."""
    text = (DEPLOY / "nats/nats.conf").read_text()
    copy = (DEPLOY / "kubernetes/components/nats/nats.conf").read_text()
    expect(text == copy, "deploy/kubernetes has another nats.conf")
    sizes = dict(re.findall(r"^\s*(\w+): (\d+)[MG]B$", text, re.M))
    expect(sizes["max_payload"] == "8", "frames above 1 MB take the detour")
    # As much of outcomes, and frames that are too large for a message.
    frames = defaults()["bus"]["max_bytes"]
    expect(3 * frames <= int(sizes["max_file_store"]) * 1000**3, "frames have no room")
    most = defaults()["bus"]["frames"]
    expect(rule("WorkersTooFew")["expr"].endswith(f"> {most * 3 // 4}"),
           f"WorkersTooFew does not know that {most} frames may be on the bus")
    for scaler in of_kind("HorizontalPodAutoscaler", "overlays/scale-out"):
        [metric] = scaler["spec"]["metrics"]
        wanted = int(metric["external"]["target"]["averageValue"])
        shown = panel("Frames on the bus, by worker")["fieldConfig"]["defaults"]["thresholds"]
        expect(shown["steps"][1]["value"] == wanted, f"the autoscaler has {wanted}")


CHECKS = [
    prometheus_takes_its_files,
    alerts_fire_when_they_should,
    prometheus_finds_every_node,
    one_memory_limit_holds_everywhere,
    there_is_time_to_stop,
    the_bus_has_room,
]
