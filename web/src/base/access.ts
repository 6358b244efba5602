/** The server that this page is from, and the token that it may want. */

import { Server } from "steadymesh";
import { element } from "./dom";

/** Forgotten with the tab. */
const KEY = "steadymesh-token";

export const server = new Server(location.origin, {
  token: () => sessionStorage.getItem(KEY),
});

/** Asks for a token and begins anew with it. */
export function tokenForm(): HTMLFormElement {
  const input = element("input", {
    type: "password",
    id: "token",
    autocomplete: "off",
    spellcheck: false,
    required: true,
  });
  const form = element("form", { className: "token-form" }, [
    element("label", { htmlFor: "token" }, ["Token"]),
    input,
    element("button", { type: "submit" }, ["Use it"]),
  ]);
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    sessionStorage.setItem(KEY, input.value.trim());
    location.reload();
  });
  return form;
}
