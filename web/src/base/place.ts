/** Which stream or recording the page's address names, and addresses of others. */

import type { Place } from "steadymesh";

/** Of `/watch/{stream}` and `/watch/{stream}?recording={id}`; `null` on any other page. */
export function placeOfPage({ pathname, search }: Location | URL): Place | null {
  const stream = /^\/watch\/([^/]+)\/?$/.exec(pathname)?.[1];
  if (stream === undefined) return null;
  const recording = new URLSearchParams(search).get("recording");
  const name = decodeURIComponent(stream);
  return recording === null ? { stream: name } : { stream: name, recording };
}

export function pageOf({ stream, recording }: Place, beside?: string): string {
  const query = new URLSearchParams();
  if (recording !== undefined) query.set("recording", recording);
  if (beside !== undefined) query.set("beside", beside);
  const path = `/watch/${encodeURIComponent(stream)}`;
  return query.size === 0 ? path : `${path}?${query}`;
}
