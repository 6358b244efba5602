/** Play, step, seek, speed, and back to the live edge. */

import { element } from "../base/dom";
import * as format from "../base/format";
import type { Deck } from "../play/deck";
import { changeIcon, iconButton, nameButton } from "./icons";

export const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4] as const;

/** Closer to the end than this is the live edge, where people mean it to be. */
const EDGE_S = 0.05;

export interface TransportActions {
  togglePlay(): void;
  step(frames: number): void;
  seek(atS: number): void;
  setSpeed(speed: number): void;
  goLive(): void;
}

export class Transport {
  readonly root: HTMLElement;

  private readonly playButton: HTMLButtonElement;
  private readonly timeline = element("input", {
    type: "range",
    className: "timeline",
    min: "0",
    max: "1",
    step: "any",
    value: "1",
    ariaLabel: "Position",
  });
  private readonly place = element("output", { className: "place" });
  private readonly speed: HTMLSelectElement;
  private readonly liveButton: HTMLButtonElement;
  private dragging = false;

  constructor(private readonly actions: TransportActions) {
    this.playButton = iconButton("pause", "Pause", "Space", actions.togglePlay);
    this.playButton.classList.add("play");
    this.speed = element(
      "select",
      { ariaLabel: "Speed", title: "Speed ([ and ])" },
      SPEEDS.map((speed) => element("option", { value: String(speed) }, [`${speed}×`])),
    );
    this.speed.value = "1";
    this.speed.addEventListener("change", () => actions.setSpeed(Number(this.speed.value)));
    this.liveButton = element("button", { type: "button", className: "live-button" }, ["Live"]);
    this.liveButton.title = "To the live edge (End)";
    this.liveButton.setAttribute("aria-keyshortcuts", "End");
    this.liveButton.addEventListener("click", actions.goLive);
    this.listenToTimeline();
    const group = (name: string, nodes: Node[]) => element("div", { className: name }, nodes);
    this.root = element("div", { className: "transport", role: "group", ariaLabel: "Playback" }, [
      this.timeline,
      group("controls", [
        iconButton("back", "One frame back", ",", () => actions.step(-1)),
        this.playButton,
        iconButton("forward", "One frame on", ".", () => actions.step(1)),
        this.place,
        this.speed,
        this.liveButton,
      ]),
    ]);
  }

  update(deck: Deck): void {
    const { startS, endS, atS, live, playing, speed } = deck.position;
    const lengthS = Math.max(endS - startS, 0.001);
    changeIcon(this.playButton, playing ? "pause" : "play");
    nameButton(this.playButton, playing ? "Pause" : "Play", "Space");
    this.playButton.dataset.playing = String(playing);
    if (this.speed.value !== String(speed)) this.speed.value = String(speed);
    this.liveButton.hidden = deck.kind !== "live";
    this.liveButton.ariaPressed = String(live && playing);
    this.timeline.min = String(startS);
    this.timeline.max = String(startS + lengthS);
    if (!this.dragging) this.timeline.value = String(atS);
    this.timeline.style.setProperty("--done", `${((atS - startS) / lengthS) * 100}%`);
    const text =
      deck.kind === "live"
        ? live && playing
          ? `${format.clock(endS - startS)} held`
          : behind(endS - atS)
        : `${format.clock(atS - startS)} / ${format.clock(lengthS)}`;
    if (this.place.textContent !== text) this.place.textContent = text;
    this.timeline.setAttribute("aria-valuetext", text);
  }

  private listenToTimeline(): void {
    const { timeline } = this;
    timeline.addEventListener("input", () => {
      const atS = Number(timeline.value);
      if (atS >= Number(timeline.max) - EDGE_S && !this.liveButton.hidden) this.actions.goLive();
      else this.actions.seek(atS);
    });
    // While a person holds it, it stays where it is held.
    timeline.addEventListener("pointerdown", () => {
      this.dragging = true;
    });
    for (const type of ["pointerup", "pointercancel", "blur"]) {
      timeline.addEventListener(type, () => {
        this.dragging = false;
      });
    }
    // By the browser, a step of "any" is a percent or so of all.
    timeline.addEventListener("keydown", (event) => {
      const frames = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1 }[event.key];
      if (frames === undefined) return;
      event.preventDefault();
      this.actions.step(frames);
    });
  }
}

function behind(seconds: number): string {
  return seconds < 0.0005 ? "Newest frame" : `−${seconds.toFixed(2)} s`;
}
