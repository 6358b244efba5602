"""What checks share: files, commands, and how they fail."""

import functools
import json
import os
import re
import subprocess
import tomllib
from pathlib import Path

import yaml

PROJECT = Path(__file__).resolve().parent.parent.parent
DEPLOY = PROJECT / "deploy"
TARGET = Path(os.environ.get("CARGO_TARGET_DIR", PROJECT / "target")).resolve()
STEADYMESH = Path(os.environ.get("STEADYMESH", TARGET / "release/steadymesh")).resolve()


class Failed(Exception):
    """What a check found."""


def expect(holds, message):
    if not holds:
        raise Failed(message)


def note(text):
    print(f"  {text}", flush=True)


def run(*command, env=None, cwd=PROJECT):
    """The command's output. It must succeed."""
    command = [str(part) for part in command]
    done = subprocess.run(command, cwd=cwd, env=env, text=True, stdin=subprocess.DEVNULL,
                          stdout=subprocess.PIPE, stderr=subprocess.PIPE, check=False)
    expect(done.returncode == 0, f"{' '.join(command)}\n{done.stdout}{done.stderr}".rstrip())
    return done.stdout


def clean_environment(**more):
    """This one's, without settings of Steadymesh."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith("STEADYMESH")}
    return {**kept, **more}


def read_yaml(file):
    return yaml.safe_load((DEPLOY / file).read_text())


def rules():
    groups = read_yaml("prometheus/alerts.yml")["groups"]
    return [rule for group in groups for rule in group["rules"]]


def rule(name):
    [found] = [rule for rule in rules() if rule["alert"] == name]
    return found


def unit():
    """The settings of the systemd unit, of those given twice the last."""
    lines = (DEPLOY / "systemd/steadymesh.service").read_text().splitlines()
    return dict(line.split("=", 1) for line in lines if "=" in line and not line.startswith("#"))


def dashboard():
    return json.loads((DEPLOY / "grafana/dashboards/steadymesh.json").read_text())


def panel(title):
    [found] = [panel for panel in dashboard()["panels"] if panel["title"] == title]
    return found


def queries(board):
    """Panel, expression and labels in its legend, for every query of the dashboard."""
    for shown in board["panels"]:
        for target in shown.get("targets", []):
            labels = set(re.findall(r"{{\s*(\w+)\s*}}", target["legendFormat"]))
            for source in (shown["datasource"], target["datasource"]):
                expected = {"type": "prometheus", "uid": "${datasource}"}
                expect(source == expected, f"{shown['title']} asks {source}")
            yield shown["title"], target["expr"], labels


def metric_names(text):
    """Names of metrics as the server writes them, those of a histogram by their base."""
    found = set(re.findall(r"\b(?:steadymesh|process)_[a-z_]+", text))
    return {re.sub(r"_(bucket|sum|count)$", "", name) for name in found}


@functools.cache
def defaults():
    """Every setting with its default, as the server prints them."""
    return tomllib.loads(run(STEADYMESH, "config", "--print-default", env=clean_environment()))
