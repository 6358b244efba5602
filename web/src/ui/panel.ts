/** The column of measurements: numbers, plots, and where the server's time went. */

import { element } from "../base/dom";
import * as format from "../base/format";
import type { DeckNumbers } from "../play/deck";
import { DISTANCES, type Figure, type Figures, figuresOf, PERSISTENCE } from "../play/figures";
import { Plot } from "./plot";
import { StageBar } from "./stages";
import { Stats } from "./stats";

/** What a plot adds for one frame. */
export interface PlottedFrame {
  seq: number | null;
  figures: Figures;
  /** The frame has nothing to do with the one before. */
  reset: boolean;
}

export const NO_FIGURES: Figures = { previous: null, current: null, vertices: null, edges: null };

const LABELS: Record<Figure, string> = {
  previous: "to the frame before, registered",
  current: "to the frame itself",
  vertices: "vertices that were there before",
  edges: "edges that are there again",
};

export class Panel {
  readonly root: HTMLElement;

  private readonly stats = new Stats();
  private readonly stageBar = new StageBar();
  private readonly values = new Map<Figure, [HTMLOutputElement, HTMLOutputElement]>();
  private readonly distances: Plot<"previous" | "current">;
  private readonly persistence: Plot<"vertices" | "edges">;

  constructor() {
    const distanceCanvas = element("canvas", { className: "plot-canvas" });
    const persistenceCanvas = element("canvas", { className: "plot-canvas" });
    this.root = element("aside", { className: "panel", ariaLabel: "Measurements" }, [
      this.stats.root,
      this.plotCard("Surface distance", "mean, % of the diagonal", DISTANCES, distanceCanvas),
      this.plotCard("Persistence", "what comes back, %", PERSISTENCE, persistenceCanvas),
      this.stageBar.root,
    ]);
    this.distances = new Plot(distanceCanvas, DISTANCES);
    this.persistence = new Plot(persistenceCanvas, PERSISTENCE);
  }

  /** A frame of the stream, or of the one beside it. */
  plot(lane: 0 | 1, { seq, figures, reset }: PlottedFrame): void {
    const { previous, current, vertices, edges } = figures;
    this.distances.add(lane, { seq, values: { previous, current }, reset });
    this.persistence.add(lane, { seq, values: { vertices, edges }, reset });
  }

  clearPlot(lane: 0 | 1): void {
    this.distances.clear(lane);
    this.persistence.clear(lane);
  }

  update(numbers: DeckNumbers, beside: DeckNumbers | null): void {
    this.stats.update(numbers);
    this.stageBar.update(numbers.metrics?.stages ?? []);
    const first = numbers.metrics === null ? NO_FIGURES : figuresOf(numbers.metrics);
    const second = beside?.metrics ? figuresOf(beside.metrics) : NO_FIGURES;
    for (const [figure, [value, other]] of this.values) {
      setText(value, format.percent(first[figure]));
      other.hidden = beside === null;
      setText(other, format.percent(second[figure]));
    }
  }

  private plotCard(
    title: string,
    unit: string,
    figures: readonly Figure[],
    canvas: HTMLCanvasElement,
  ): HTMLElement {
    canvas.setAttribute("role", "img");
    canvas.ariaLabel = `${title} over the last 150 frames, as the legend says for the newest`;
    canvas.title = "A dashed line: a frame that has nothing to do with the one before";
    const entries = figures.map((figure) => {
      const swatch = element("span", { className: "swatch", ariaHidden: "true" });
      const value = element("output");
      const other = element("output", { className: "beside", hidden: true });
      this.values.set(figure, [value, other]);
      const item = element("li", {}, [
        swatch,
        element("span", { className: "label" }, [LABELS[figure]]),
        value,
        other,
      ]);
      item.dataset.series = figure;
      return item;
    });
    return element("section", { className: "card" }, [
      element("h2", {}, [title, element("span", { className: "unit" }, [unit])]),
      element("ul", { className: "legend" }, entries),
      canvas,
    ]);
  }
}

/** Leaves an unchanged text alone: a live region would be read out again. */
export function setText(node: HTMLElement, text: string): void {
  if (node.textContent !== text) node.textContent = text;
}
