/** The choice of a second stream to be shown beside the first. */

import type { Server } from "steadymesh";
import { element } from "../base/dom";

export class CompareChoice {
  readonly root: HTMLElement;
  private readonly select = element("select", { ariaLabel: "Compare with" });

  constructor(
    private readonly server: Server,
    private readonly stream: string,
    onChoice: (other: string | null) => void,
  ) {
    this.root = element("label", { className: "compare", title: "Compare with another stream" }, [
      this.select,
    ]);
    this.fill([], null);
    this.select.addEventListener("change", () => onChoice(this.select.value || null));
    // The list is as fresh as the wish to see it.
    for (const type of ["focus", "pointerdown"]) {
      this.select.addEventListener(type, () => void this.refresh());
    }
  }

  update(other: string | null): void {
    this.fill(this.names(), other);
    void this.refresh();
  }

  private async refresh(): Promise<void> {
    const streams = await this.server.streams().catch(() => []);
    const others = streams.map(({ stream }) => stream).filter((name) => name !== this.stream);
    if (others.join() !== this.names().join()) this.fill(others, this.select.value || null);
  }

  private names(): string[] {
    return [...this.select.options].map(({ value }) => value).filter((value) => value !== "");
  }

  /** Streams of the same family first, such as `demo-off` beside `demo-robust`. */
  private fill(names: string[], chosen: string | null): void {
    const family = (name: string) => name.split("-")[0] === this.stream.split("-")[0];
    const listed = chosen === null || names.includes(chosen) ? names : [chosen, ...names];
    const sorted = [...listed].sort((a, b) => Number(family(b)) - Number(family(a)));
    this.select.replaceChildren(
      element("option", { value: "" }, [chosen === null ? "Compare…" : "One stream only"]),
      ...sorted.map((name) => element("option", { value: name }, [name])),
    );
    this.select.value = chosen ?? "";
  }
}
