/** The first page: what is live, and what has been recorded. */

import { ProblemError } from "steadymesh";
import { server, tokenForm } from "../base/access";
import { element } from "../base/dom";
import iconUrl from "../icon.svg";
import { type CardContent, CardList } from "./cards";
import { howToPublish } from "./how-to";
import { recordingCards } from "./recordings";
import { streamCards } from "./streams";

const POLL_MS = 2000;

const SECTIONS = {
  live: {
    title: "Live",
    load: async () => streamCards(await server.streams()),
    empty: "Nothing is live yet.",
  },
  recordings: {
    title: "Recordings",
    load: async () => recordingCards(await server.recordings()),
    empty: "Nothing has been recorded yet.",
  },
} as const;

type SectionName = keyof typeof SECTIONS;

/** Shows the lists and keeps them fresh for as long as the page is open. */
export function showHome(root: HTMLElement): void {
  const status = element("p", { className: "list-status", role: "status" });
  const access = element("div", { className: "access" });
  const cards = new CardList();
  const howTo = howToPublish();
  howTo.hidden = true;
  const links = (Object.keys(SECTIONS) as SectionName[]).map((name) => {
    const href = name === "live" ? "#" : `#${name}`;
    return { name, link: element("a", { href }, [SECTIONS[name].title]) };
  });
  root.replaceChildren(
    element("main", { className: "home" }, [
      element("header", {}, [
        element("h1", {}, [element("img", { src: iconUrl, alt: "" }), "Steadymesh"]),
        element("p", { className: "tagline" }, ["Live volumetric video, steady frame by frame."]),
      ]),
      element(
        "nav",
        { className: "tabs", ariaLabel: "Lists" },
        links.map(({ link }) => link),
      ),
      status,
      access,
      cards.root,
      howTo,
    ]),
  );
  const section = (): SectionName => (location.hash === "#recordings" ? "recordings" : "live");
  const refresh = async () => {
    // A hidden page asks nothing; the interval goes on.
    if (document.hidden || access.childElementCount > 0) return;
    const name = section();
    const found = await ask(SECTIONS[name].load);
    if (name !== section()) return;
    const content = found.cards ?? [];
    cards.update(content);
    howTo.hidden = name !== "live" || found.cards === null || content.length > 0;
    status.textContent = found.problem ?? (content.length > 0 ? "" : SECTIONS[name].empty);
    if (found.wantsToken) access.replaceChildren(tokenForm());
  };
  const show = () => {
    for (const { name, link } of links) link.ariaCurrent = name === section() ? "page" : null;
    status.textContent = "Asking the server…";
    cards.update([]);
    howTo.hidden = true;
    void refresh();
  };
  window.addEventListener("hashchange", show);
  document.addEventListener("visibilitychange", () => void refresh());
  setInterval(() => void refresh(), POLL_MS);
  show();
}

interface Found {
  /** `null` if the server did not say. */
  cards: CardContent[] | null;
  problem: string | null;
  wantsToken: boolean;
}

async function ask(load: () => Promise<CardContent[]>): Promise<Found> {
  try {
    return { cards: await load(), problem: null, wantsToken: false };
  } catch (error) {
    const known = error instanceof ProblemError;
    const wantsToken = known && error.status === 401;
    return { cards: null, problem: describe(error, wantsToken), wantsToken };
  }
}

function describe(error: unknown, wantsToken: boolean): string {
  if (wantsToken) return "This server wants a token.";
  if (!(error instanceof ProblemError)) return "The server does not answer. Trying again…";
  if (error.status === 404) return "This server keeps no recordings: it has no place for them.";
  return `The server answered ${error.status}. Trying again…`;
}
