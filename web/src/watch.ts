/**
 * The watch page: a live stream, two of them side by side, or a recording.
 *
 * The address may carry `beside=` another stream, `mode=` of the surface, `wireframe=1`, and
 * `rotate=0` (no automatic rotation).
 */

import { DecoderPool, type FrameMetrics, type Place, TextureStore } from "steadymesh";
import { server, tokenForm } from "./base/access";
import * as format from "./base/format";
import type { Deck } from "./play/deck";
import { figuresOf } from "./play/figures";
import { LiveDeck } from "./play/live-deck";
import { Player, type PlayerEvents } from "./play/player";
import { RecordingDeck } from "./play/recording-deck";
import { type Actions, commands, listenToKeys } from "./ui/commands";
import { CompareChoice } from "./ui/compare";
import { HelpSheet } from "./ui/help";
import { Layout } from "./ui/layout";
import { NO_FIGURES, Panel } from "./ui/panel";
import { messageOf, statusOf } from "./ui/status";
import { changeLegend, ModeChoice, ToolColumn } from "./ui/tools";
import { SPEEDS, Transport } from "./ui/transport";
import { isViewMode, type ViewMode } from "./view/modes";
import { Viewer } from "./view/viewer";

const REFRESH_MS = 200;
/** Two rigs whose clocks differ by more are not of one capture. */
const MAX_CLOCK_DIFFERENCE_MS = 3000;

export function watch(root: HTMLElement, place: Place, parameters: URLSearchParams): void {
  new WatchPage(root, place, parameters).start();
}

class WatchPage {
  private readonly pool = new DecoderPool();
  private readonly textures = new TextureStore();
  private readonly layout: Layout;
  private readonly panel = new Panel();
  private readonly transport: Transport;
  private readonly tools: ToolColumn;
  private readonly modes: ModeChoice;
  private readonly legend = changeLegend();
  private readonly help: HelpSheet;
  private readonly compare: CompareChoice | null;
  private readonly viewer: Viewer | null;
  private readonly main: Player;
  private beside: { stream: string; player: Player<LiveDeck> } | null = null;
  private mode: ViewMode = "color";
  private wireframe = false;

  constructor(
    root: HTMLElement,
    private readonly place: Place,
    private readonly parameters: URLSearchParams,
  ) {
    const title = place.recording === undefined ? place.stream : `${place.stream}, recorded`;
    document.title = `${title} · Steadymesh`;
    const actions = this.actions();
    const list = commands(actions);
    listenToKeys(list);
    this.help = new HelpSheet(list);
    this.transport = new Transport({
      ...actions,
      seek: (atS) => this.control((deck) => deck.seek(atS)),
      setSpeed: (speed) => this.control((deck) => deck.setSpeed(speed)),
    });
    this.tools = new ToolColumn(actions);
    this.modes = new ModeChoice((mode) => this.showMode(mode));
    this.compare =
      place.recording === undefined
        ? new CompareChoice(server, place.stream, (other) => this.setBeside(other))
        : null;
    this.layout = new Layout(root, title, {
      besideTitle: this.compare === null ? [] : [this.compare.root],
      overView: [this.tools.root, this.legend],
      deck: [this.modes.root, this.transport.root],
      panel: this.panel.root,
      sheet: this.help.root,
    });
    this.viewer = this.createViewer();
    this.main = this.createPlayer(0, (events) => this.createDeck(events));
  }

  start(): void {
    const { parameters } = this;
    const mode = parameters.get("mode");
    this.showMode(isViewMode(mode) ? mode : "color");
    this.setWireframe(parameters.get("wireframe") === "1");
    document.addEventListener("visibilitychange", () => {
      for (const { deck } of this.players) deck.setHidden(document.hidden);
    });
    setInterval(() => this.refresh(), REFRESH_MS);
    if (this.viewer !== null) this.pool.preload();
    this.main.deck.start();
    const beside = parameters.get("beside");
    if (beside !== null && beside !== this.place.stream && this.compare !== null) {
      this.setBeside(beside);
    }
    this.refresh();
  }

  private get players(): Player[] {
    return this.beside === null ? [this.main] : [this.main, this.beside.player];
  }

  private createDeck(events: ConstructorParameters<typeof LiveDeck>[4]): Deck {
    const { stream, recording } = this.place;
    const { pool, textures } = this;
    return recording === undefined
      ? new LiveDeck(server, stream, pool, textures, events)
      : new RecordingDeck(server, stream, recording, pool, textures, events);
  }

  /** Without WebGL 2 the page still shows the numbers. */
  private createViewer(): Viewer | null {
    const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
    try {
      return new Viewer(this.layout.canvas, {
        autoRotate: this.parameters.get("rotate") !== "0" && !still,
        covered: this.layout.covered,
        beforeDraw: (nowMs) => {
          for (const { deck } of this.players) deck.tick(nowMs);
        },
      });
    } catch {
      setInterval(() => this.main.deck.tick(performance.now()), REFRESH_MS);
      return null;
    }
  }

  private createPlayer<D extends Deck>(
    lane: 0 | 1,
    makeDeck: ConstructorParameters<typeof Player<D>>[0],
  ): Player<D> {
    const plot = (metrics: FrameMetrics) =>
      this.panel.plot(lane, {
        seq: metrics.seq,
        figures: figuresOf(metrics),
        reset: metrics.reset !== null,
      });
    const events: PlayerEvents = {
      onShown: () => {
        if (lane === 0) this.follow();
      },
      onReceived: plot,
      onHeld: (held) => {
        this.panel.clearPlot(lane);
        for (const metrics of held) plot(metrics);
      },
      onBreak: () => this.panel.plot(lane, { seq: null, figures: NO_FIGURES, reset: false }),
    };
    const player = new Player<D>(
      makeDeck,
      this.pool,
      (frame, change, refit) => {
        this.viewer?.show(lane, frame, change);
        if (refit) this.viewer?.resetView();
      },
      events,
    );
    player.measuresChange = this.mode === "change";
    return player;
  }

  private actions(): Actions {
    const jump = (seconds: number) =>
      this.control((deck) => {
        const { startS, endS, atS } = deck.position;
        deck.seek(Math.min(Math.max(atS + seconds, startS), endS));
      });
    return {
      togglePlay: () =>
        this.control((deck) => (deck.position.playing ? deck.pause() : deck.play())),
      step: (frames) => this.control((deck) => deck.step(frames)),
      jump,
      goLive: () => this.control((deck) => deck.goLive()),
      goToStart: () => this.control((deck) => deck.seek(deck.position.startS)),
      changeSpeed: (direction) =>
        this.control((deck) => {
          const at = SPEEDS.indexOf(deck.position.speed as (typeof SPEEDS)[number]);
          const speed = SPEEDS[at + direction];
          if (speed !== undefined) deck.setSpeed(speed);
        }),
      showMode: (mode) => this.showMode(mode),
      toggleNormals: () => this.showMode(this.mode === "normals" ? "color" : "normals"),
      toggleWireframe: () => this.setWireframe(!this.wireframe),
      resetView: () => this.viewer?.resetView(),
      toggleFullScreen: () => this.layout.toggleFullScreen(),
      toggleHelp: () => this.help.toggle(),
    };
  }

  private control(action: (deck: Deck) => void): void {
    action(this.main.deck);
    this.follow();
    this.refresh();
  }

  /** The stream beside stands where the first one does. */
  private follow(): void {
    if (this.beside === null) return;
    const { deck } = this.beside.player;
    const { metrics } = this.main.deck.numbers;
    if (this.main.deck.position.live) {
      if (!deck.position.live) deck.goLive();
    } else if (metrics !== null) deck.follow(metrics);
  }

  private setBeside(stream: string | null): void {
    this.beside?.player.close();
    this.panel.clearPlot(1);
    this.viewer?.setPanes(stream === null ? 1 : 2);
    this.beside = null;
    if (stream !== null) {
      const { pool, textures } = this;
      const player = this.createPlayer(
        1,
        (events) => new LiveDeck(server, stream, pool, textures, events),
      );
      this.beside = { stream, player };
      this.tie(player.deck);
      player.deck.start();
    }
    this.compare?.update(stream);
    this.viewer?.resetView();
    const address = new URL(location.href);
    if (stream === null) address.searchParams.delete("beside");
    else address.searchParams.set("beside", stream);
    history.replaceState(null, "", address);
    this.refresh();
  }

  /** Frames of one moment are shown at one moment, as late as the later of the two streams. */
  private tie(other: LiveDeck): void {
    const main = this.main.deck;
    if (!(main instanceof LiveDeck)) return;
    const shared = () => {
      const a = main.offsetMs;
      const b = other.offsetMs;
      if (a === null || b === null || Math.abs(a - b) > MAX_CLOCK_DIFFERENCE_MS) return null;
      return Math.max(a, b);
    };
    main.sharedOffsetMs = other.sharedOffsetMs = shared;
  }

  private showMode(mode: ViewMode): void {
    this.mode = mode;
    this.modes.update(mode);
    this.legend.hidden = mode !== "change";
    this.viewer?.setMode(mode);
    for (const player of this.players) player.measuresChange = mode === "change";
  }

  private setWireframe(on: boolean): void {
    this.wireframe = on;
    this.tools.setWireframe(on);
    this.viewer?.setEdges(on);
  }

  private refresh(): void {
    const { deck } = this.main;
    const numbers = this.players.map((player) => {
      const own = player.deck.numbers;
      return { ...own, skippedHere: own.skippedHere + player.undrawn };
    });
    const [first, second] = numbers;
    if (first === undefined) return;
    this.layout.setStatus(statusOf(deck));
    const refused = deck.state.kind === "refused" && deck.state.status === 401;
    const problem = this.viewer === null ? "This browser has no WebGL 2 to draw with." : null;
    this.layout.showMessage(problem ?? messageOf(deck), refused ? tokenForm : null);
    this.transport.update(deck);
    this.panel.update(first, second ?? null);
    const names = [this.place.stream, this.beside?.stream ?? ""];
    this.layout.setLabels(
      numbers.map(({ metrics, messageBytes }, index) =>
        [names[index], metrics?.tracking ?? "–", format.bytes(messageBytes)].join(" · "),
      ),
    );
    this.noteMemory();
  }

  /** For who looks for leaks. */
  private noteMemory(): void {
    if (this.viewer === null) return;
    const { geometries, textures } = this.viewer.memory;
    Object.assign(this.layout.canvas.dataset, { geometries, textures });
  }
}
