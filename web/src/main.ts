/** Chooses the page by the address: `/watch/{stream}`, and the list of streams everywhere else. */

import { showStreams } from "./streams";

const root = document.querySelector<HTMLElement>("#app");
const stream = /^\/watch\/([^/]+)\/?$/.exec(location.pathname)?.[1];

if (root !== null) {
  if (stream === undefined) {
    showStreams(root);
  } else {
    // three.js is loaded only where it is needed.
    const { watch } = await import("./watch");
    watch(root, decodeURIComponent(stream), new URLSearchParams(location.search));
  }
}
