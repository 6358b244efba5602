/** Everything on the watch page except the two canvases' contents: status, numbers, buttons. */

import { element } from "./dom";
import * as format from "./format";
import iconUrl from "./icon.svg";
import type { FrameMetrics, StreamConfig } from "./protocol";
import { StageBar } from "./stages";

export type StatusKind = "live" | "waiting" | "problem" | "paused";

export interface Status {
  kind: StatusKind;
  text: string;
  /** Changes often and is not read out. */
  detail?: string;
}

export type Toggle = "wireframe" | "normals" | "pause";

export interface HudActions {
  onToggle(toggle: Toggle, on: boolean): void;
  onReset(): void;
}

export interface Numbers {
  /** Of the newest shown frame. */
  metrics: FrameMetrics | null;
  config: StreamConfig | null;
  messageBytes: number | null;
  receivedPerSecond: number;
  shownPerSecond: number;
  bitsPerSecond: number;
  endToEndUs: number | null;
  /** By the server and by this page together. */
  skipped: number;
  /** Of the newest shown frame. */
  percents: Percents | null;
}

/** The plotted figures, in percent: distances of the bounding-box diagonal, shares of the whole. */
export type Percents = Record<"previous" | "current" | "vertices" | "edges", number | null>;

const STATS = [
  ["fps", "Frame rate"],
  ["bytes", "Frame size"],
  ["bitrate", "Bit rate"],
  ["latency", "Latency"],
  ["endToEnd", "End to end"],
  ["tracking", "Tracking"],
  ["faces", "Faces"],
  ["vertices", "Vertices"],
  ["seq", "Frame"],
] as const;

type StatName = (typeof STATS)[number][0];

interface StatView {
  value: HTMLElement;
  note: HTMLElement;
}

export class Hud {
  readonly viewCanvas = element("canvas", { className: "view-canvas", tabIndex: 0 });
  readonly distanceCanvas = element("canvas", { className: "plot-canvas" });
  readonly persistenceCanvas = element("canvas", { className: "plot-canvas" });

  private readonly statusText = element("span");
  private readonly statusDetail = element("span", { ariaHidden: "true", className: "detail" });
  private readonly pill = element("p", { className: "pill", role: "status" }, [this.statusText]);
  private readonly message = element("p", { className: "message" });
  private readonly stats = new Map<StatName, StatView>();
  private readonly legend: Record<keyof Percents, HTMLOutputElement> = {
    previous: element("output"),
    current: element("output"),
    vertices: element("output"),
    edges: element("output"),
  };
  private readonly stageBar = new StageBar();
  private readonly toggles = new Map<Toggle, HTMLButtonElement>();

  constructor(
    root: HTMLElement,
    stream: string,
    private readonly actions: HudActions,
  ) {
    this.viewCanvas.setAttribute("role", "img");
    this.viewCanvas.ariaLabel = `Live mesh of stream ${stream}. Arrow keys turn it, plus and minus zoom.`;
    root.replaceChildren(
      element("div", { className: "watch" }, [
        this.buildHeader(stream),
        element("main", { className: "view" }, [
          this.viewCanvas,
          this.message,
          this.buildToolbar(),
        ]),
        this.buildPanel(),
      ]),
    );
    this.showMessage("Connecting…");
    window.addEventListener("keydown", this.onKey);
  }

  setStatus({ kind, text, detail }: Status): void {
    setText(this.statusText, text);
    setText(this.statusDetail, detail ?? "");
    this.pill.dataset.kind = kind;
  }

  /** Text in the place of the mesh; `null` takes it away. */
  showMessage(text: string | null): void {
    this.message.hidden = text === null;
    setText(this.message, text ?? "");
  }

  isOn(toggle: Toggle): boolean {
    return this.toggles.get(toggle)?.ariaPressed === "true";
  }

  toggle(toggle: Toggle): void {
    const button = this.toggles.get(toggle);
    if (button === undefined) return;
    const on = !this.isOn(toggle);
    button.ariaPressed = String(on);
    this.actions.onToggle(toggle, on);
  }

  update(numbers: Numbers): void {
    const { metrics, config } = numbers;
    this.set("fps", format.frameRate(numbers.receivedPerSecond), [
      `${numbers.shownPerSecond.toFixed(1)} shown`,
    ]);
    this.set("bytes", format.bytes(numbers.messageBytes), [
      prefixed("from ", format.bytes(metrics?.input.bytes ?? null)),
    ]);
    this.set("bitrate", format.bitRate(numbers.bitsPerSecond), ["received"]);
    this.set("latency", format.duration(metrics?.latencyUs ?? null), ["in the server"]);
    this.set("endToEnd", format.duration(numbers.endToEndUs), [
      numbers.endToEndUs === null ? "no capture time" : "capture to screen",
    ]);
    this.set("tracking", metrics?.tracking ?? config?.tracking ?? format.UNKNOWN, [
      metrics?.reset != null ? "reset: a first frame" : describeTarget(config),
    ]);
    this.set("faces", format.count(metrics?.output.faces ?? null), [
      prefixed("of ", format.count(metrics?.input.faces ?? null)),
    ]);
    this.set("vertices", format.count(metrics?.output.vertices ?? null), [
      prefixed("of ", format.count(metrics?.input.vertices ?? null)),
    ]);
    this.set("seq", format.count(metrics?.seq ?? null), [
      `${format.count(numbers.skipped)} skipped`,
    ]);
    for (const series of Object.keys(this.legend) as (keyof Percents)[]) {
      setText(this.legend[series], format.percent(numbers.percents?.[series] ?? null));
    }
    this.stageBar.update(metrics?.stages ?? []);
  }

  private set(name: StatName, value: string, [note]: [string]): void {
    const view = this.stats.get(name);
    if (view === undefined) return;
    setText(view.value, value);
    setText(view.note, note);
  }

  private buildHeader(stream: string): HTMLElement {
    this.pill.append(this.statusDetail);
    return element("header", { className: "bar" }, [
      element("a", { href: "/", className: "brand", title: "All streams" }, [
        element("img", { src: iconUrl, alt: "", width: 24, height: 24 }),
        "Steadymesh",
      ]),
      element("h1", {}, [stream]),
      this.pill,
    ]);
  }

  private buildToolbar(): HTMLElement {
    const toolbar = element("div", { className: "toolbar", role: "toolbar", ariaLabel: "View" }, [
      this.buildToggle("wireframe", "Wireframe", "W"),
      this.buildToggle("normals", "Normals", "N"),
      button("Reset view", "R", () => this.actions.onReset()),
      this.buildToggle("pause", "Pause", "Space"),
    ]);
    return toolbar;
  }

  private buildToggle(toggle: Toggle, label: string, key: string): HTMLButtonElement {
    const node = button(label, key, () => this.toggle(toggle));
    node.dataset.toggle = toggle;
    node.ariaPressed = "false";
    this.toggles.set(toggle, node);
    return node;
  }

  private buildPanel(): HTMLElement {
    const list = element("dl", { className: "stats" });
    for (const [name, label] of STATS) {
      const value = element("dd", { className: "value" }, [format.UNKNOWN]);
      value.dataset.stat = name;
      const note = element("dd", { className: "note" });
      this.stats.set(name, { value, note });
      list.append(element("div", {}, [element("dt", {}, [label]), value, note]));
    }
    return element("aside", { className: "panel", ariaLabel: "Measurements" }, [
      list,
      this.buildDistanceCard(),
      this.buildPersistenceCard(),
      this.stageBar.root,
    ]);
  }

  private buildDistanceCard(): HTMLElement {
    this.distanceCanvas.ariaLabel =
      "Mean surface distance over the last 150 frames, as the legend above says for the newest";
    return this.buildPlotCard(
      "Surface distance",
      "mean, % of the bounding-box diagonal",
      { previous: "to the previous frame, registered", current: "to the current frame" },
      this.distanceCanvas,
    );
  }

  private buildPersistenceCard(): HTMLElement {
    this.persistenceCanvas.ariaLabel =
      "Persistence over the last 150 frames, as the legend above says for the newest";
    return this.buildPlotCard(
      "Persistence",
      "what comes back of the previous mesh, %",
      { vertices: "vertices that were there before", edges: "edges that are there again" },
      this.persistenceCanvas,
    );
  }

  private buildPlotCard(
    title: string,
    unit: string,
    labels: Partial<Record<keyof Percents, string>>,
    canvas: HTMLCanvasElement,
  ): HTMLElement {
    canvas.setAttribute("role", "img");
    canvas.title = "A dashed line: a frame that has nothing to do with the one before";
    const entries = (Object.keys(labels) as (keyof Percents)[]).map((series) => {
      const swatch = element("span", { className: "swatch", ariaHidden: "true" });
      const item = element("li", {}, [swatch, labels[series] ?? "", this.legend[series]]);
      item.dataset.series = series;
      return item;
    });
    return element("section", { className: "card" }, [
      element("h2", {}, [title]),
      element("p", { className: "unit" }, [unit]),
      element("ul", { className: "legend" }, entries),
      canvas,
    ]);
  }

  private readonly onKey = (event: KeyboardEvent): void => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.repeat) return;
    const key = event.key.toLowerCase();
    // A focused button or link keeps the Space that presses it.
    const onControl = event.target instanceof HTMLElement && event.target.closest("button, a");
    if (key === " " && onControl) return;
    if (key === "w") this.toggle("wireframe");
    else if (key === "n") this.toggle("normals");
    else if (key === "r") this.actions.onReset();
    else if (key === " ") this.toggle("pause");
    else return;
    event.preventDefault();
  };
}

function button(label: string, key: string, onClick: () => void): HTMLButtonElement {
  const hint = element("kbd", { ariaHidden: "true" }, [key]);
  const node = element("button", { type: "button", onclick: onClick }, [label, hint]);
  node.setAttribute("aria-keyshortcuts", key);
  return node;
}

function describeTarget(config: StreamConfig | null): string {
  if (config?.targetFaces != null) return `target ${format.count(config.targetFaces)}`;
  if (config?.targetRatio != null) return `target ${(config.targetRatio * 100).toPrecision(2)} %`;
  return "";
}

function prefixed(prefix: string, text: string): string {
  return text === format.UNKNOWN ? "" : prefix + text;
}

/** Leaves an unchanged text alone: a live region would be read out again. */
function setText(node: HTMLElement, text: string): void {
  if (node.textContent !== text) node.textContent = text;
}
