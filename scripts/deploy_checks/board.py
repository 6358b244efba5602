"""The dashboard: drawn well, and with data where all is well."""

import json
import re
import tempfile
import time
import urllib.parse

from .common import dashboard, expect, metric_names, note, queries, read_yaml, rules
from .live import ALONE, SCALED, Processes, eventually, get, start_all, webhook_endpoint

# Queries of the dashboard that have no data while all is well, each with the reason. None: the
# server records, has tokens and a webhook, one request is denied, and there are gateways and a worker.
EMPTY_IN_HEALTH = {}
# Metrics that tell operators nothing: address space is not memory.
NOT_SHOWN = {"process_virtual_memory_bytes"}


def the_dashboard_is_one():
    board = dashboard()
    expect((board["uid"], board["title"]) == ("steadymesh", "Steadymesh"), "it has another name")
    ids = [panel["id"] for panel in board["panels"]]
    expect(len(ids) == len(set(ids)), "two panels have one id")
    cells = set()
    for panel in board["panels"]:
        place = panel["gridPos"]
        taken = {(x, y) for x in range(place["x"], place["x"] + place["w"])
                 for y in range(place["y"], place["y"] + place["h"])}
        expect(place["x"] + place["w"] <= 24, f"{panel['title']} is too wide")
        expect(not cells & taken, f"{panel['title']} lies upon another panel")
        cells |= taken
        is_explained = panel["type"] == "row" or panel.get("description")
        expect(is_explained, f"{panel['title']} has no description")
        has_unit = panel["type"] not in ("timeseries", "stat") or panel["fieldConfig"]["defaults"]["unit"]
        expect(has_unit, f"{panel['title']} has no unit")
    source, stream = board["templating"]["list"]
    expect(source["current"]["value"] == "prometheus", "it looks for another Prometheus")
    expect(stream["multi"] and stream["includeAll"], "several streams cannot be chosen")


def ask(prometheus, path, **parameters):
    status, text = get(f"{prometheus}/api/v1/{path}?{urllib.parse.urlencode(parameters)}")
    answer = json.loads(text)
    expect(status == 200, f"{parameters.get('query', path)}\n{answer.get('error')}")
    return answer["data"]


def values(prometheus, query):
    """Labels and value of all series that have a number."""
    found = ask(prometheus, "query", query=query)["result"]
    return [(sample["metric"], float(sample["value"][1])) for sample in found
            if sample["value"][1] != "NaN"]


def samples(prometheus, query):
    return [labels for labels, _ in values(prometheus, query)]


def filled_in(expression, stream=".*"):
    query = expression.replace("$stream", stream).replace("$__rate_interval", "10s")
    expect("$" not in query, f"there is no variable for {query}")
    return query


def missing_data(prometheus, board):
    """Every query that gives nothing or too much, and why that is wrong."""
    missing = []
    tables = {panel["title"] for panel in board["panels"] if panel["type"] == "table"}
    for title, expression, labels in queries(board):
        query = filled_in(expression)
        found = samples(prometheus, query)
        if expression in EMPTY_IN_HEALTH:
            continue
        if not found:
            missing.append(f"{title}: no data: {query}")
        elif not labels <= found[0].keys():
            missing.append(f"{title}: the legend has {sorted(labels)}, the data {sorted(found[0])}")
        elif title not in tables:
            legends = [tuple(series.get(label) for label in sorted(labels)) for series in found]
            if len(set(legends)) < len(legends):
                missing.append(f"{title}: several lines have one legend: {query}")
    return missing


def frames_are_counted_once(prometheus, board):
    """Two gateways tell of each frame of a stream."""
    asked = {title: expression for title, expression, _ in queries(board)}

    def as_many():
        [(_, came)] = values(prometheus, filled_in(asked["Frames in"], SCALED))
        [(_, went)] = values(prometheus, filled_in(asked["Frames out"], SCALED))
        return went < 1.5 * came

    # Rates of a stream that has just begun are rough.
    eventually("as many frames come out as come in, not twice as many", 20, as_many)


def the_autoscaler_is_told(prometheus):
    """What prometheus-adapter would answer, with and without streams."""
    [rule] = read_yaml("kubernetes/prometheus-adapter.yaml")["externalRules"]
    # Namespaces are Kubernetes's.
    series = rule["seriesQuery"].replace('namespace!="",', "")
    expect(samples(prometheus, series), f"it looks for {series}")
    for matchers, most in (('job="steadymesh"', 32), ('job="nobody"', 0)):
        query = rule["metricsQuery"].replace("<<.LabelMatchers>>", matchers)
        [(_, value)] = values(prometheus, query)
        expect(0 <= value <= most, f"{value} frames wait: {query}")


def the_alerts_know_what_is_there(prometheus, nodes):
    scraped = "\n".join(get(f"{node.operations}/metrics")[1] for node in nodes)
    there = metric_names("\n".join(re.findall(r"^# TYPE (\w+)", scraped, re.M)))
    for rule in rules():
        unknown = metric_names(rule["expr"]) - there
        expect(not unknown, f"{rule['alert']} asks for {sorted(unknown)}, which are not there")
        found = samples(prometheus, rule["expr"])
        expect(not found, f"{rule['alert']} is true although all is well: {found}")
    loaded = {rule["name"] for group in ask(prometheus, "rules")["groups"] for rule in group["rules"]}
    expect(loaded == {rule["alert"] for rule in rules()}, "not every rule is loaded")
    return there


def the_dashboard_and_the_alerts_have_data():
    board = dashboard()
    with (tempfile.TemporaryDirectory() as folder, webhook_endpoint() as hook,
          Processes(folder) as processes):
        prometheus, nodes = start_all(processes, hook)
        end = time.monotonic() + 60
        while missing := missing_data(prometheus, board):
            processes.expect_alive()
            expect(time.monotonic() < end, "\n".join(missing))
            time.sleep(1)
        definition = board["templating"]["list"][1]["query"]["query"]
        label = re.fullmatch(r"label_values\((\w+), (\w+)\)", definition)
        choice = ask(prometheus, f"label/{label[2]}/values", **{"match[]": label[1]})
        expect(choice == [ALONE, SCALED], f"the streams to choose from are {choice}")
        marks = [mark["expr"] for mark in board["annotations"]["list"] if "expr" in mark]
        for expression in marks:
            samples(prometheus, expression)
        frames_are_counted_once(prometheus, board)
        the_autoscaler_is_told(prometheus)
        there = the_alerts_know_what_is_there(prometheus, nodes)
        shown = metric_names(" ".join(expression for _, expression, _ in queries(board)))
        hidden = sorted(there - shown - NOT_SHOWN)
        if hidden:
            note(f"not on the dashboard: {', '.join(hidden)}")


CHECKS = [the_dashboard_is_one, the_dashboard_and_the_alerts_have_data]
