/** Where frames come from: a live stream or a recording, on one server. */

export interface Place {
  stream: string;
  /** The recording's id; a live stream has none. */
  recording?: string;
}

/** The path of a place, without a slash at its end. */
export function pathOf({ stream, recording }: Place): string {
  const name = encodeURIComponent(stream);
  return recording === undefined
    ? `/v1/streams/${name}`
    : `/v1/recordings/${name}/${encodeURIComponent(recording)}`;
}

/** An address that names no stream and no recording. */
export class AddressError extends Error {
  override name = "AddressError";
}

/**
 * Reads the address of a stream or a recording: `http://host/v1/streams/demo`, `http://host/watch/demo`,
 * `http://host/demo`, or `http://host/v1/recordings/demo/ID`. A relative one is of `base`.
 *
 * @throws {AddressError}
 */
export function parseAddress(address: string | URL, base?: string): { server: URL; place: Place } {
  const url = resolve(address, base);
  url.protocol = url.protocol.replace(/^ws/, "http");
  const parts = url.pathname.split("/").filter((part) => part !== "");
  const named = /^(.*?)\/(?:v1\/(recordings)\/([^/]+)\/([^/]+)|(?:v1\/streams|watch)\/([^/]+))\/?$/;
  const match = named.exec(url.pathname);
  const server = new URL(url);
  server.search = server.hash = "";
  server.pathname = match?.[1] ?? "";
  const place: Place | null =
    match?.[2] !== undefined
      ? { stream: decode(match[3]), recording: decode(match[4]) }
      : match?.[5] !== undefined
        ? { stream: decode(match[5]) }
        : parts.length === 1
          ? { stream: decode(parts[0]) }
          : null;
  if (place === null) throw new AddressError(`${url.href} names no stream and no recording`);
  return { server, place };
}

function resolve(address: string | URL, base: string | undefined): URL {
  try {
    return new URL(address, base ?? globalThis.location?.href);
  } catch {
    throw new AddressError(`${address} is not an address`);
  }
}

function decode(part: string | undefined): string {
  return decodeURIComponent(part ?? "");
}
