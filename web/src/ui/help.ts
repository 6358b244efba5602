/** The sheet that says what keys and gestures do. */

import { element } from "../base/dom";
import { type Command, GESTURES } from "./commands";
import { iconButton } from "./icons";

export class HelpSheet {
  readonly root: HTMLDialogElement;

  constructor(list: Command[]) {
    const close = iconButton("close", "Close", "Escape", () => this.root.close());
    const title = element("h2", { id: "help-title" }, ["Keys and gestures"]);
    const groups = ["Playback", "View", "Page"] as const;
    this.root = element("dialog", { className: "help" }, [
      element("div", { className: "help-head" }, [title, close]),
      element("div", { className: "help-body" }, [
        ...groups.map((group) =>
          section(
            group,
            list
              .filter((command) => command.group === group)
              .map(({ shown, does }) => ({ keys: keys(shown), does })),
          ),
        ),
        section(
          "Pointer and camera",
          GESTURES.map(([how, does]) => ({ keys: [element("span", {}, [how])], does })),
        ),
      ]),
    ]);
    this.root.setAttribute("aria-labelledby", "help-title");
    // A click beside the sheet closes it.
    this.root.addEventListener("click", (event) => {
      if (event.target === this.root) this.root.close();
    });
  }

  toggle(): void {
    if (this.root.open) this.root.close();
    else this.root.showModal();
  }
}

function section(title: string, rows: { keys: Node[]; does: string }[]): HTMLElement {
  const list = element("dl", {});
  for (const row of rows) {
    const term = element("dt", {}, row.keys);
    list.append(element("div", {}, [term, element("dd", {}, [row.does])]));
  }
  return element("section", {}, [element("h3", {}, [title]), list]);
}

function keys(shown: string[]): Node[] {
  return shown.map((key) => element("kbd", {}, [key]));
}
