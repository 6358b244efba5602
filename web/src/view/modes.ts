/** What the surface shows. */

export const VIEW_MODES = ["color", "shaded", "normals", "change"] as const;

export type ViewMode = (typeof VIEW_MODES)[number];

/** The end of the scale of changes, as a share of the bounding box's diagonal. */
export const CHANGE_REACH = 0.01;

/** The scale's colours from no change to `CHANGE_REACH`, sRGB; the style sheet has the same. */
export const CHANGE_RAMP = [
  [0x1c, 0x2a, 0x44],
  [0x2f, 0x6f, 0xa8],
  [0x6f, 0xc7, 0xb0],
  [0xf6, 0xd3, 0x65],
  [0xe8, 0x5d, 0x4a],
] as const;

export function isViewMode(text: string | null): text is ViewMode {
  return VIEW_MODES.some((mode) => mode === text);
}
