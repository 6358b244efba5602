/** Where a frame's time in the server went: one bar, one part for each pipeline stage. */

import { element } from "../base/dom";
import * as format from "../base/format";

/** How many stage colours the style sheet has. */
const COLOR_COUNT = 6;

export class StageBar {
  readonly root: HTMLElement;

  private readonly total = element("output");
  private readonly bar = element("div", { className: "stage-bar", ariaHidden: "true" });
  private readonly legend = element("ul", { className: "stage-legend" });
  private parts: { name: string; segment: HTMLElement; value: HTMLElement }[] = [];

  constructor() {
    this.root = element("section", { className: "card", hidden: true }, [
      element("h2", {}, ["Pipeline", this.total]),
      this.bar,
      this.legend,
    ]);
  }

  update(stages: { name: string; us: number }[]): void {
    this.root.hidden = stages.length === 0;
    const same = stages.length === this.parts.length;
    if (!same || stages.some(({ name }, i) => this.parts[i]?.name !== name)) this.rebuild(stages);
    stages.forEach(({ us }, i) => {
      const part = this.parts[i];
      if (part === undefined) return;
      part.segment.style.flexGrow = String(us);
      part.value.textContent = format.duration(us);
    });
    this.total.textContent = format.duration(stages.reduce((sum, { us }) => sum + us, 0));
  }

  private rebuild(stages: { name: string }[]): void {
    this.parts = stages.map(({ name }) => ({
      name,
      segment: element("span"),
      value: element("output"),
    }));
    this.bar.replaceChildren(...this.parts.map(({ segment }) => segment));
    this.legend.replaceChildren(
      ...this.parts.map(({ name, value }) => {
        const swatch = element("span", { className: "swatch", ariaHidden: "true" });
        return element("li", {}, [swatch, name, value]);
      }),
    );
    for (const list of [this.bar, this.legend]) {
      Array.from(list.children).forEach((child, i) => {
        (child as HTMLElement).dataset.color = String(i % COLOR_COUNT);
      });
    }
  }
}
