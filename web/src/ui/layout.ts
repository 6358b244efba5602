/** Where everything on the watch page stands. */

import { element } from "../base/dom";
import iconUrl from "../icon.svg";
import { setText } from "./panel";
import type { Status } from "./status";

export class Layout {
  readonly root: HTMLElement;
  readonly canvas = element("canvas", { className: "view-canvas", tabIndex: 0 });
  /** What lies over the view's lower end. */
  readonly deck = element("div", { className: "deck" });

  private readonly bar: HTMLElement;
  private readonly statusText = element("span");
  private readonly statusDetail = element("span", { ariaHidden: "true", className: "detail" });
  private readonly pill: HTMLElement;
  private readonly message = element("div", { className: "message", hidden: true });
  private readonly labels = element("div", { className: "pane-labels", ariaHidden: "true" });

  constructor(
    parent: HTMLElement,
    title: string,
    parts: { besideTitle: Node[]; overView: Node[]; deck: Node[]; panel: Node; sheet: Node },
  ) {
    this.canvas.setAttribute("role", "img");
    this.canvas.ariaLabel = `Mesh of ${title}. Arrow keys turn it, plus and minus zoom.`;
    this.pill = element("p", { className: "pill", role: "status" }, [
      this.statusText,
      this.statusDetail,
    ]);
    this.bar = element("header", { className: "bar" }, [
      element(
        "a",
        { href: "/", className: "brand", title: "All streams", ariaLabel: "All streams" },
        [element("img", { src: iconUrl, alt: "", width: 24, height: 24 })],
      ),
      element("h1", {}, [title]),
      this.pill,
      ...parts.besideTitle,
    ]);
    this.deck.append(...parts.deck);
    this.root = element("div", { className: "watch" }, [
      this.bar,
      element("main", { className: "view" }, [
        this.canvas,
        this.labels,
        this.message,
        ...parts.overView,
        this.deck,
      ]),
      parts.panel,
      parts.sheet,
    ]);
    parent.replaceChildren(this.root);
  }

  /** What of the canvas is under the bar and the deck, in CSS pixels. */
  readonly covered = (): { top: number; bottom: number } => {
    const canvas = this.canvas.getBoundingClientRect();
    const bar = this.bar.getBoundingClientRect();
    const deck = this.deck.getBoundingClientRect();
    return {
      top: Math.max(0, bar.bottom - canvas.top),
      bottom: Math.max(0, canvas.bottom - deck.top),
    };
  };

  setStatus({ kind, text, detail }: Status): void {
    setText(this.statusText, text);
    setText(this.statusDetail, detail ?? "");
    this.pill.dataset.kind = kind;
  }

  /** In the place of the mesh; `null` takes it away. */
  showMessage(text: string | null, form: (() => HTMLElement) | null): void {
    if (this.message.dataset.text === (text ?? "")) return;
    this.message.dataset.text = text ?? "";
    this.message.hidden = text === null;
    this.message.replaceChildren(...(text === null ? [] : [element("p", {}, [text])]));
    if (text !== null && form !== null) this.message.append(form());
  }

  /** Over each of two streams; nothing over one. */
  setLabels(texts: string[]): void {
    this.labels.hidden = texts.length < 2;
    if (this.labels.childElementCount !== texts.length) {
      this.labels.replaceChildren(...texts.map(() => element("span")));
    }
    texts.forEach((text, index) => {
      setText(this.labels.children[index] as HTMLElement, text);
    });
  }

  toggleFullScreen(): void {
    if (document.fullscreenElement === null) void this.root.requestFullscreen();
    else void document.exitFullscreen();
  }
}
