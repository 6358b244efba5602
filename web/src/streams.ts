/** The list of live streams, and the page that shows it. */

import { element } from "./dom";
import { count } from "./format";
import iconUrl from "./icon.svg";
import { parseStreamList, type StreamConfig, type StreamSummary } from "./protocol";

const POLL_MS = 2000;
const TIMEOUT_MS = 5000;

/** A server that answered, and not with a list. */
export class ListError extends Error {
  override name = "ListError";
  constructor(readonly status: number) {
    super(`the server answered ${status}`);
  }
}

/** @throws {ListError} on an HTTP error, `TypeError` or `DOMException` if nobody answers. */
export async function fetchStreams(): Promise<StreamSummary[]> {
  const response = await fetch("/v1/streams", {
    headers: { Accept: "application/json" },
    cache: "no-store",
    signal: AbortSignal.timeout(TIMEOUT_MS),
  });
  if (!response.ok) throw new ListError(response.status);
  return parseStreamList(await response.json());
}

/** Shows the streams and keeps the list fresh for as long as the page is open. */
export function showStreams(root: HTMLElement): void {
  const status = element("p", { className: "list-status", role: "status" });
  const list = element("ul", { className: "stream-list" });
  const publish = howToPublish();
  root.replaceChildren(
    element("main", { className: "home" }, [
      element("header", {}, [
        element("h1", {}, [element("img", { src: iconUrl, alt: "" }), "Steadymesh"]),
        element("p", { className: "tagline" }, ["Live volumetric video, steady frame by frame."]),
      ]),
      element("h2", {}, ["Live streams"]),
      status,
      list,
      publish,
    ]),
  );
  publish.hidden = true;
  status.textContent = "Asking the server…";

  const cards = new Map<string, StreamCard>();
  const refresh = async () => {
    // A hidden page asks nothing; the interval goes on.
    if (document.hidden) return;
    try {
      const streams = await fetchStreams();
      updateCards(list, cards, streams);
      publish.hidden = streams.length > 0;
      status.textContent = streams.length > 0 ? "" : "Nothing is live yet.";
    } catch (error) {
      status.textContent =
        error instanceof ListError
          ? `The server answered ${error.status}. Trying again…`
          : "The server does not answer. Trying again…";
    }
  };
  void refresh();
  setInterval(refresh, POLL_MS);
  document.addEventListener("visibilitychange", refresh);
}

interface StreamCard {
  item: HTMLElement;
  update(summary: StreamSummary): void;
}

/** Changes the cards in place, so that a link keeps its focus while the numbers move. */
function updateCards(
  list: HTMLElement,
  cards: Map<string, StreamCard>,
  streams: StreamSummary[],
): void {
  const live = new Set(streams.map((summary) => summary.stream));
  for (const [stream, card] of cards) {
    if (live.has(stream)) continue;
    card.item.remove();
    cards.delete(stream);
  }
  for (const summary of streams) {
    let card = cards.get(summary.stream);
    if (card === undefined) {
      card = createCard(summary.stream);
      cards.set(summary.stream, card);
      list.append(card.item);
    }
    card.update(summary);
  }
}

function createCard(stream: string): StreamCard {
  const state = element("span", { className: "pill" });
  const facts = element("span", { className: "facts" });
  const link = element("a", { href: `/watch/${encodeURIComponent(stream)}` }, [
    element("span", { className: "name" }, [stream]),
    state,
    facts,
  ]);
  return {
    item: element("li", {}, [link]),
    update(summary) {
      state.textContent = summary.state ?? "live";
      state.dataset.kind = summary.state === null || summary.state === "live" ? "live" : "idle";
      facts.textContent = [
        describeTarget(summary.config),
        summary.config.tracking === null ? null : `${summary.config.tracking} tracking`,
        summary.published === null ? null : `${count(summary.published)} frames`,
        summary.subscribers === null ? null : `${count(summary.subscribers)} watching`,
      ]
        .filter((fact) => fact !== null)
        .join(" · ");
    },
  };
}

function describeTarget(config: StreamConfig): string | null {
  if (config.targetFaces !== null) return `${count(config.targetFaces)} faces`;
  if (config.targetRatio !== null) return `${(config.targetRatio * 100).toPrecision(2)} % of faces`;
  return null;
}

function howToPublish(): HTMLElement {
  const url = `${location.origin}/v1/streams/demo`;
  return element("section", { className: "how-to" }, [
    element("p", {}, ["Publish the built-in animated figure:"]),
    element("pre", {}, [element("code", {}, [`steadymesh publish ${url} --synthetic`])]),
    element("p", {}, ["or your own sequence of OBJ, PLY, GLB or Draco files:"]),
    element("pre", {}, [element("code", {}, [`steadymesh publish ${url} FOLDER --fps 30 --loop`])]),
    element("p", { className: "hint" }, ["It appears here within two seconds."]),
  ]);
}
