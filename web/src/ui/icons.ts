/** The signs on buttons, drawn on 24 x 24. */

const SHAPES = {
  play: "M7 4.5v15l12-7.5z",
  pause: "M6.5 5h3.5v14H6.5zM14 5h3.5v14H14z",
  back: "M17 5.5v13L8.5 12zM6 5.5h2v13H6z",
  forward: "M7 5.5v13l8.5-6.5zM16 5.5h2v13h-2z",
  wireframe:
    "M12 2.6 20.5 7.3v9.4L12 21.4 3.5 16.7V7.3zm0 1.9L5.9 7.9 12 11.2l6.1-3.3zM5 9.1v6.7l6.2 3.4v-6.7zm14 0-6.2 3.4v6.7l6.2-3.4z",
  reset: "M12 5V1.8L7.2 6 12 10.2V6.8a5.4 5.4 0 1 1-5.3 6.4H4.9A7.2 7.2 0 1 0 12 5z",
  full: "M4 4h6v2H6v4H4zM14 4h6v6h-2V6h-4zM4 14h2v4h4v2H4zM18 14h2v6h-6v-2h4z",
  help: "M12 2.5a9.5 9.5 0 1 0 0 19 9.5 9.5 0 0 0 0-19zm-1 13.6h2v2h-2zm1-10.2a3.6 3.6 0 0 0-3.6 3.5h1.9a1.7 1.7 0 0 1 3.4 0c0 1.7-2.6 1.6-2.6 4.6H13c0-2 2.6-2.3 2.6-4.6A3.6 3.6 0 0 0 12 5.9z",
  close:
    "m6.4 5 5.6 5.6L17.6 5 19 6.4 13.4 12l5.6 5.6-1.4 1.4-5.6-5.6L6.4 19 5 17.6l5.6-5.6L5 6.4z",
} as const;

export type IconName = keyof typeof SHAPES;

const SVG = "http://www.w3.org/2000/svg";

/** A sign that is not read out: the button has a name of its own. */
export function icon(name: IconName): SVGSVGElement {
  const svg = document.createElementNS(SVG, "svg");
  svg.setAttribute("viewBox", "0 0 24 24");
  svg.setAttribute("aria-hidden", "true");
  svg.classList.add("icon");
  const path = document.createElementNS(SVG, "path");
  path.setAttribute("d", SHAPES[name]);
  path.setAttribute("fill-rule", "evenodd");
  svg.append(path);
  return svg;
}

/** A button with a sign; its name is read out and shown as a tip. */
export function iconButton(
  name: IconName,
  label: string,
  key: string,
  onClick: () => void,
): HTMLButtonElement {
  const button = document.createElement("button");
  button.type = "button";
  button.className = "icon-button";
  button.addEventListener("click", onClick);
  button.append(icon(name));
  nameButton(button, label, key);
  return button;
}

export function nameButton(button: HTMLButtonElement, label: string, key: string): void {
  if (button.ariaLabel === label) return;
  button.ariaLabel = label;
  button.title = `${label} (${key})`;
  button.setAttribute("aria-keyshortcuts", key);
}

export function changeIcon(button: HTMLButtonElement, name: IconName): void {
  if (button.dataset.icon === name) return;
  button.dataset.icon = name;
  button.replaceChildren(icon(name));
}
