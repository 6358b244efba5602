/** What to do while nothing is live. */

import { element } from "../base/dom";

export function howToPublish(): HTMLElement {
  const url = `${location.origin}/v1/streams/demo`;
  const code = (text: string) => element("pre", {}, [element("code", {}, [text])]);
  return element("section", { className: "how-to" }, [
    element("p", {}, ["Publish the built-in animated figure:"]),
    code(`steadymesh publish ${url} --synthetic`),
    element("p", {}, ["or your own sequence of OBJ, PLY, GLB or Draco files:"]),
    code(`steadymesh publish ${url} FOLDER --fps 30 --loop`),
    element("p", { className: "hint" }, ["It appears here within two seconds."]),
  ]);
}
