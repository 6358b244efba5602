/** The plotted figures, in percent: distances of the box's diagonal, shares of the whole. */

import type { DistanceStatistics, FrameMetrics } from "steadymesh";

export const DISTANCES = ["previous", "current"] as const;
export const PERSISTENCE = ["vertices", "edges"] as const;

export type Figure = (typeof DISTANCES)[number] | (typeof PERSISTENCE)[number];

export type Figures = Record<Figure, number | null>;

export function figuresOf({ surfaceDistance, consistency, bboxDiagonal }: FrameMetrics): Figures {
  return {
    previous: percentOfDiagonal(surfaceDistance.previous, bboxDiagonal),
    current: percentOfDiagonal(surfaceDistance.current, bboxDiagonal),
    vertices: percentOfShare(consistency.vertexPersistence),
    edges: percentOfShare(consistency.edgePersistence),
  };
}

/** `null` where either is not known. */
export function percentOfDiagonal(
  distance: DistanceStatistics | null,
  diagonal: number | null,
): number | null {
  if (distance === null || diagonal === null || diagonal <= 0) return null;
  return (distance.mean / diagonal) * 100;
}

export function percentOfShare(share: number | null): number | null {
  return share === null ? null : share * 100;
}
