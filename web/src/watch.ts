/**
 * The watch page: subscription -> newest wins -> decoder -> viewer, and the numbers beside it.
 *
 * The address may carry `rotate=0` (no automatic rotation), `wireframe=1` and `normals=1`.
 */

import { MeshDecoder } from "./decoder";
import { Hud, type Numbers, type Percents, type Status } from "./hud";
import { NewestWins } from "./newest";
import { Plot } from "./plot";
import {
  type ControlMessage,
  endToEndUs,
  type Frame,
  type FrameMetrics,
  percentOfDiagonal,
  percentOfShare,
  type StreamConfig,
} from "./protocol";
import { RateMeter } from "./rate";
import { type ConnectionState, Subscription } from "./subscription";
import { Viewer } from "./viewer";

const HUD_INTERVAL_MS = 200;
/** A live stream that is silent for longer than this says so. */
const SILENCE_MS = 3000;

export function watch(root: HTMLElement, stream: string, parameters: URLSearchParams): void {
  document.title = `${stream} · Steadymesh`;
  new WatchPage(root, stream, parameters).start();
}

class WatchPage {
  private readonly hud: Hud;
  private readonly distances: Plot<"previous" | "current">;
  private readonly persistence: Plot<"vertices" | "edges">;
  private readonly viewer: Viewer | null;
  private readonly decoder = new MeshDecoder();
  private readonly queue = new NewestWins<Frame>((frame) => this.show(frame));
  private readonly subscription: Subscription;
  private readonly received = new RateMeter();
  private readonly shown = new RateMeter();

  private state: ConnectionState = { kind: "connecting" };
  private config: StreamConfig | null = null;
  private newest: { frame: Frame; endToEndUs: number | null } | null = null;
  private lastFrameAtMs: number | null = null;
  private skippedByServer = 0;
  private problem: string | null = null;
  /** The next frame may be of another size than those before. */
  private refit = false;

  constructor(
    root: HTMLElement,
    stream: string,
    private readonly parameters: URLSearchParams,
  ) {
    this.hud = new Hud(root, stream, {
      onToggle: (toggle, on) => {
        if (toggle === "wireframe") this.viewer?.setEdges(on);
        else if (toggle === "normals") this.viewer?.setNormalColors(on);
        else this.holdOrRelease();
      },
      onReset: () => this.viewer?.resetView(),
    });
    this.distances = new Plot(this.hud.distanceCanvas, ["previous", "current"]);
    this.persistence = new Plot(this.hud.persistenceCanvas, ["vertices", "edges"]);
    this.viewer = this.createViewer();
    this.subscription = new Subscription(stream, {
      onState: (state) => this.onState(state),
      onControl: (message) => this.onControl(message),
      onFrame: (frame) => this.onFrame(frame),
    });
  }

  start(): void {
    if (this.parameters.get("wireframe") === "1") this.hud.toggle("wireframe");
    if (this.parameters.get("normals") === "1") this.hud.toggle("normals");
    document.addEventListener("visibilitychange", () => this.holdOrRelease());
    setInterval(() => this.refresh(), HUD_INTERVAL_MS);
    if (this.viewer !== null) this.decoder.preload();
    this.subscription.start();
    this.refresh();
  }

  /** Without WebGL 2 the page still shows the numbers. */
  private createViewer(): Viewer | null {
    const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
    try {
      return new Viewer(this.hud.viewCanvas, this.parameters.get("rotate") !== "0" && !still);
    } catch {
      this.problem = "This browser cannot draw the mesh: it has no WebGL 2.";
      return null;
    }
  }

  private onState(state: ConnectionState): void {
    const left = this.state.kind === "open" && state.kind !== "open";
    if (left && this.newest !== null) {
      const { seq } = this.newest.frame.metrics;
      this.distances.add({ seq, values: { previous: null, current: null }, reset: false });
      this.persistence.add({ seq, values: { vertices: null, edges: null }, reset: false });
    }
    if (state.kind === "absent") this.refit = true;
    if (state.kind !== "open") this.received.clear();
    this.state = state;
    this.refresh();
  }

  private onControl(message: ControlMessage): void {
    if (message.type === "hello") this.config = message.config;
    if (message.type === "skipped") this.skippedByServer += message.missed;
  }

  private onFrame(frame: Frame): void {
    this.lastFrameAtMs = performance.now();
    this.received.add(this.lastFrameAtMs, frame.messageBytes);
    if (!this.hud.isOn("pause")) {
      const { seq } = frame.metrics;
      const reset = frame.metrics.reset !== null;
      const { previous, current, vertices, edges } = percents(frame.metrics);
      this.distances.add({ seq, values: { previous, current }, reset });
      this.persistence.add({ seq, values: { vertices, edges }, reset });
    }
    this.queue.offer(frame);
  }

  private async show(frame: Frame): Promise<void> {
    if (this.viewer !== null) {
      try {
        const mesh = await this.decoder.decode(frame.mesh);
        this.viewer.show(mesh);
        this.problem = null;
      } catch (error) {
        this.problem = `Frame ${frame.metrics.seq ?? ""} cannot be shown: ${describe(error)}.`;
        return;
      }
      if (this.refit) this.viewer.resetView();
      this.refit = false;
      this.shown.add(performance.now(), 0);
    }
    const delay = endToEndUs(frame.metrics.captureTimeUs, Date.now());
    this.newest = { frame, endToEndUs: delay };
  }

  private holdOrRelease(): void {
    if (this.hud.isOn("pause") || document.hidden) this.queue.hold();
    else this.queue.release();
    this.refresh();
  }

  private refresh(): void {
    this.hud.setStatus(this.status());
    this.hud.showMessage(this.message());
    this.hud.update(this.numbers());
  }

  private numbers(): Numbers {
    const nowMs = performance.now();
    const metrics = this.newest?.frame.metrics ?? null;
    const rates = this.received.measure(nowMs);
    return {
      metrics,
      config: this.config,
      messageBytes: this.newest?.frame.messageBytes ?? null,
      receivedPerSecond: rates.perSecond,
      bitsPerSecond: rates.bitsPerSecond,
      shownPerSecond: this.shown.measure(nowMs).perSecond,
      endToEndUs: this.newest?.endToEndUs ?? null,
      skipped: this.skippedByServer + this.queue.skipped,
      percents: metrics === null ? null : percents(metrics),
    };
  }

  private status(): Status {
    switch (this.state.kind) {
      case "connecting":
        return { kind: "waiting", text: "Connecting" };
      case "absent":
        return this.state.reason === "deleted"
          ? { kind: "waiting", text: "Ended" }
          : { kind: "waiting", text: "Not live" };
      case "reconnecting": {
        const seconds = Math.max(0, Math.ceil((this.state.retryAtMs - Date.now()) / 1000));
        return { kind: "problem", text: "Reconnecting", detail: ` in ${seconds} s` };
      }
      case "open":
        return this.openStatus();
    }
  }

  private openStatus(): Status {
    if (this.hud.isOn("pause")) return { kind: "paused", text: "Paused" };
    if (this.lastFrameAtMs === null) return { kind: "waiting", text: "Waiting for a frame" };
    const silence = performance.now() - this.lastFrameAtMs;
    if (silence < SILENCE_MS) return { kind: "live", text: "Live" };
    return { kind: "waiting", text: "Silent", detail: ` for ${Math.round(silence / 1000)} s` };
  }

  /** Shown over the mesh; nothing while there is one and all is well. */
  private message(): string | null {
    if (this.problem !== null) return this.problem;
    if (this.state.kind === "absent") {
      return this.state.reason === "deleted"
        ? "This stream has ended. The page goes on when it is published again."
        : "Nobody publishes this stream yet. The page starts when somebody does.";
    }
    if (this.newest !== null) return null;
    return this.state.kind === "open" ? "Waiting for the first frame…" : "Connecting…";
  }
}

/** What the plots show of a frame. */
function percents({ surfaceDistance, consistency, bboxDiagonal }: FrameMetrics): Percents {
  return {
    previous: percentOfDiagonal(surfaceDistance.previous, bboxDiagonal),
    current: percentOfDiagonal(surfaceDistance.current, bboxDiagonal),
    vertices: percentOfShare(consistency.vertexPersistence),
    edges: percentOfShare(consistency.edgePersistence),
  };
}

function describe(error: unknown): string {
  return error instanceof Error ? error.message : String(error);
}
