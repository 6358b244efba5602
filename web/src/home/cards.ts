/** Cards that lead to streams and recordings, with a picture each. */

import type { Place } from "steadymesh";
import { element } from "../base/dom";
import { Pictures } from "./pictures";

/** Pixels of a picture; shown at about half of that. */
export const PICTURE = { width: 480, height: 300 } as const;

export interface CardContent {
  /** What stays the same as long as it is the same card. */
  key: string;
  href: string;
  name: string;
  state: { text: string; kind: "live" | "idle" };
  facts: string[];
  /** Which frame stands for it; without one there is no picture. */
  picture: { place: Place; seq: number; changes: boolean } | null;
}

interface Card {
  item: HTMLElement;
  canvas: HTMLCanvasElement;
  update(content: CardContent): void;
}

export class CardList {
  readonly root = element("ul", { className: "cards" });
  private readonly cards = new Map<string, Card>();
  private readonly pictures = new Pictures();

  /** Changes the cards in place, so that a link keeps its focus while the numbers move. */
  update(contents: CardContent[]): void {
    const wanted = new Set(contents.map(({ key }) => key));
    for (const [key, card] of this.cards) {
      if (wanted.has(key)) continue;
      card.item.remove();
      this.cards.delete(key);
      this.pictures.forget(key);
    }
    contents.forEach((content, index) => {
      let card = this.cards.get(content.key);
      if (card === undefined) {
        card = createCard(content.href);
        this.cards.set(content.key, card);
      }
      // In the server's order, without moving what stands right.
      const there = this.root.children[index];
      if (there !== card.item) this.root.insertBefore(card.item, there ?? null);
      card.update(content);
      this.pictures.want(content, card.canvas);
    });
  }
}

function createCard(href: string): Card {
  const canvas = element("canvas", { className: "picture", ...PICTURE, ariaHidden: "true" });
  const name = element("span", { className: "name" });
  const state = element("span", { className: "pill" });
  const facts = element("span", { className: "facts" });
  const link = element("a", { href }, [canvas, name, state, facts]);
  return {
    item: element("li", {}, [link]),
    canvas,
    update(content) {
      setText(name, content.name);
      setText(state, content.state.text);
      state.dataset.kind = content.state.kind;
      setText(facts, content.facts.join(" · "));
    },
  };
}

function setText(node: HTMLElement, text: string): void {
  if (node.textContent !== text) node.textContent = text;
}
