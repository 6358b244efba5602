/** What keys do: the table that the keyboard and the help sheet are made of. */

export interface Command {
  /** As `KeyboardEvent.key` says it, in lower case. */
  keys: string[];
  /** As they stand on the help sheet. */
  shown: string[];
  does: string;
  group: "Playback" | "View" | "Page";
  run(): void;
  /** Goes on while the key is held down. */
  repeats?: boolean;
}

/** What a person can ask for. */
export interface Actions {
  togglePlay(): void;
  step(frames: number): void;
  jump(seconds: number): void;
  goLive(): void;
  goToStart(): void;
  changeSpeed(direction: 1 | -1): void;
  showMode(mode: "color" | "shaded" | "normals" | "change"): void;
  toggleNormals(): void;
  toggleWireframe(): void;
  resetView(): void;
  toggleFullScreen(): void;
  toggleHelp(): void;
}

export function commands(actions: Actions): Command[] {
  const command = (
    group: Command["group"],
    keys: string[],
    shown: string[],
    does: string,
    run: () => void,
    repeats = false,
  ): Command => ({ group, keys, shown, does, run, repeats });
  return [
    command("Playback", [" ", "k"], ["Space", "K"], "Play or pause", actions.togglePlay),
    command("Playback", [","], [","], "One frame back", () => actions.step(-1), true),
    command("Playback", ["."], ["."], "One frame on", () => actions.step(1), true),
    command("Playback", ["j"], ["J"], "One second back", () => actions.jump(-1), true),
    command("Playback", ["l"], ["L"], "One second on", () => actions.jump(1), true),
    command("Playback", ["home"], ["Home"], "To the oldest frame", actions.goToStart),
    command("Playback", ["end", "e"], ["End", "E"], "To the live edge", actions.goLive),
    command("Playback", ["<", "["], ["["], "Slower", () => actions.changeSpeed(-1)),
    command("Playback", [">", "]"], ["]"], "Faster", () => actions.changeSpeed(1)),
    command("View", ["1"], ["1"], "Colour", () => actions.showMode("color")),
    command("View", ["2"], ["2"], "Shaded", () => actions.showMode("shaded")),
    command("View", ["3", "n"], ["3", "N"], "Normals", actions.toggleNormals),
    command("View", ["4"], ["4"], "Change to the frame before", () => actions.showMode("change")),
    command("View", ["w"], ["W"], "Wireframe", actions.toggleWireframe),
    command("View", ["r"], ["R"], "Reset the view", actions.resetView),
    command("Page", ["f"], ["F"], "Full screen", actions.toggleFullScreen),
    command("Page", ["?", "h"], ["?", "H"], "This sheet", actions.toggleHelp),
  ];
}

/** What else moves the view, with the canvas in focus or a pointer on it. */
export const GESTURES: [string, string][] = [
  ["Arrow keys, or drag", "Turn"],
  ["+ and −, wheel, or pinch", "Zoom"],
  ["Right button, or two fingers", "Move"],
  ["Double click", "Reset the view"],
];

/** Runs commands by the keyboard, unless a control needs the key itself. */
export function listenToKeys(list: Command[]): void {
  window.addEventListener("keydown", (event) => {
    if (event.defaultPrevented || event.ctrlKey || event.metaKey || event.altKey) return;
    const key = event.key.toLowerCase();
    const command = list.find(({ keys }) => keys.includes(key));
    if (command === undefined || (event.repeat && command.repeats !== true)) return;
    if (event.target instanceof HTMLElement && needsKey(event.target, key)) return;
    event.preventDefault();
    command.run();
  });
}

/** A focused button or link keeps the Space that presses it; what is typed into keeps all. */
function needsKey(target: HTMLElement, key: string): boolean {
  if (target.closest("input[type=password], input[type=text], select") !== null) return true;
  if (key === "home" || key === "end") return target.closest("input") !== null;
  return key === " " && target.closest("button, a, input") !== null;
}
