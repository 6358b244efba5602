/** What a deck is doing, in a word, and what stands in the place of the mesh. */

import type { Deck } from "../play/deck";

export type StatusKind = "live" | "waiting" | "problem" | "paused";

export interface Status {
  kind: StatusKind;
  text: string;
  /** Changes often and is not read out. */
  detail?: string;
}

/** A live stream that is silent for longer than this says so. */
const SILENCE_MS = 3000;

export function statusOf(deck: Deck): Status {
  const { state } = deck;
  switch (state.kind) {
    case "connecting":
      return { kind: "waiting", text: "Connecting" };
    case "absent":
      return { kind: "waiting", text: state.reason === "deleted" ? "Ended" : "Not live" };
    case "refused":
      return { kind: "problem", text: "No access" };
    case "reconnecting": {
      const seconds = Math.max(0, Math.ceil((state.retryAtMs - Date.now()) / 1000));
      return { kind: "problem", text: "Reconnecting", detail: ` in ${seconds} s` };
    }
    case "finished":
      return { kind: "paused", text: "At the end" };
    case "closed":
      return { kind: "waiting", text: "Closed" };
    case "open":
      return openStatus(deck);
  }
}

function openStatus(deck: Deck): Status {
  const { playing, live } = deck.position;
  if (!playing) return { kind: "paused", text: "Paused" };
  if (deck.kind === "recording") return { kind: "live", text: "Playing" };
  if (!live) return { kind: "paused", text: "Behind" };
  if (deck.silentMs === Infinity) return { kind: "waiting", text: "Waiting for a frame" };
  if (deck.silentMs < SILENCE_MS) return { kind: "live", text: "Live" };
  return {
    kind: "waiting",
    text: "Silent",
    detail: ` for ${Math.round(deck.silentMs / 1000)} s`,
  };
}

/** Shown over the mesh; nothing while there is one and all is well. */
export function messageOf(deck: Deck): string | null {
  if (deck.problem !== null) return deck.problem;
  const { state } = deck;
  if (state.kind === "refused") return `The server refuses access: ${state.detail}.`;
  if (state.kind === "absent") {
    if (deck.kind === "recording") return "There is no such recording.";
    return state.reason === "deleted"
      ? "This stream has ended. The page goes on when it is published again."
      : "Nobody publishes this stream yet. The page starts when somebody does.";
  }
  if (deck.numbers.metrics !== null) return null;
  return state.kind === "open" ? "Waiting for the first frame…" : "Connecting…";
}
