/** Chooses the page by the address: `/watch/{stream}`, and the lists everywhere else. */

import { placeOfPage } from "./base/place";
import { showHome } from "./home/home";

const root = document.querySelector<HTMLElement>("#app");
const place = placeOfPage(location);

if (root !== null) {
  if (place === null) {
    showHome(root);
  } else {
    // three.js is loaded only where it is needed.
    const { watch } = await import("./watch");
    watch(root, place, new URLSearchParams(location.search));
  }
}
