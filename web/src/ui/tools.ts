/** What the view shows, and how. */

import { element } from "../base/dom";
import { CHANGE_REACH, VIEW_MODES, type ViewMode } from "../view/modes";
import { iconButton } from "./icons";

const LABELS: Record<ViewMode, string> = {
  color: "Colour",
  shaded: "Shaded",
  normals: "Normals",
  change: "Change",
};

export interface ToolActions {
  showMode(mode: ViewMode): void;
  toggleWireframe(): void;
  resetView(): void;
  toggleFullScreen(): void;
  toggleHelp(): void;
}

/** One of four kinds of surface. */
export class ModeChoice {
  readonly root: HTMLElement;
  private readonly inputs = new Map<ViewMode, HTMLInputElement>();

  constructor(onChoice: (mode: ViewMode) => void) {
    const choices = VIEW_MODES.map((mode, index) => {
      const input = element("input", { type: "radio", name: "mode", value: mode });
      input.dataset.mode = mode;
      input.addEventListener("change", () => onChoice(mode));
      this.inputs.set(mode, input);
      const label = element("label", { title: `${LABELS[mode]} (${index + 1})` }, [
        input,
        element("span", {}, [LABELS[mode]]),
      ]);
      return label;
    });
    this.root = element("div", { className: "modes", role: "radiogroup", ariaLabel: "Surface" });
    this.root.append(...choices);
  }

  update(mode: ViewMode): void {
    const input = this.inputs.get(mode);
    if (input !== undefined) input.checked = true;
  }
}

/** The column of buttons at the view's edge. */
export class ToolColumn {
  readonly root: HTMLElement;
  private readonly wireframe: HTMLButtonElement;

  constructor(actions: ToolActions) {
    this.wireframe = iconButton("wireframe", "Wireframe", "W", actions.toggleWireframe);
    this.wireframe.dataset.toggle = "wireframe";
    const full = iconButton("full", "Full screen", "F", actions.toggleFullScreen);
    // Some phones have none.
    full.hidden = !document.fullscreenEnabled;
    const help = iconButton("help", "Keys and gestures", "?", actions.toggleHelp);
    help.setAttribute("aria-haspopup", "dialog");
    this.root = element("div", { className: "tools", role: "toolbar", ariaLabel: "View" }, [
      this.wireframe,
      iconButton("reset", "Reset the view", "R", actions.resetView),
      full,
      help,
    ]);
    this.root.ariaOrientation = "vertical";
  }

  setWireframe(on: boolean): void {
    this.wireframe.ariaPressed = String(on);
  }
}

/** What the colours of the view of changes mean. */
export function changeLegend(): HTMLElement {
  const reach = `${CHANGE_REACH * 100} %`;
  const legend = element("div", { className: "change-legend", hidden: true }, [
    element("p", {}, ["Distance to the frame shown before, of the diagonal"]),
    element("div", { className: "ramp" }),
    element("div", { className: "scale" }, [
      element("span", {}, ["0"]),
      element("span", {}, [`${(CHANGE_REACH / 2) * 100} %`]),
      element("span", {}, [`${reach} and more`]),
    ]),
  ]);
  return legend;
}
