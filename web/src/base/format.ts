/** Numbers as people read them. Unknown values are an en dash. */

export const UNKNOWN = "–";

const integer = new Intl.NumberFormat("en", { maximumFractionDigits: 0 });

export function count(value: number | null): string {
  return value === null ? UNKNOWN : integer.format(value);
}

/** Decimal units, as networks are measured in. */
export function bytes(value: number | null): string {
  return scaled(value, ["B", "kB", "MB", "GB"]);
}

export function bitRate(bitsPerSecond: number | null): string {
  return scaled(bitsPerSecond, ["bit/s", "kbit/s", "Mbit/s", "Gbit/s"]);
}

export function duration(microseconds: number | null): string {
  if (microseconds === null) return UNKNOWN;
  if (microseconds < 1000) return `${Math.round(microseconds)} µs`;
  if (microseconds < 1e6) return `${threeDigits(microseconds / 1000)} ms`;
  return `${threeDigits(microseconds / 1e6)} s`;
}

export function frameRate(perSecond: number): string {
  return `${perSecond.toFixed(1)} fps`;
}

/** With as many decimals as small distances need. */
export function percent(value: number | null): string {
  if (value === null) return UNKNOWN;
  const decimals = value < 0.1 ? 4 : value < 10 ? 3 : 1;
  return `${value.toFixed(decimals)} %`;
}

function scaled(value: number | null, units: [string, ...string[]]): string {
  if (value === null) return UNKNOWN;
  let rest = value;
  let unit = units[0];
  for (const larger of units.slice(1)) {
    if (rest < 1000) break;
    rest /= 1000;
    unit = larger;
  }
  return `${unit === units[0] ? Math.round(rest) : threeDigits(rest)} ${unit}`;
}

function threeDigits(value: number): string {
  if (value < 10) return value.toFixed(2);
  return value < 100 ? value.toFixed(1) : value.toFixed(0);
}

/** Minutes, seconds and tenths, as players show a position. */
export function clock(seconds: number): string {
  const tenths = Math.max(0, Math.round(seconds * 10));
  const minutes = Math.floor(tenths / 600);
  const rest = (tenths % 600) / 10;
  return `${minutes}:${rest.toFixed(1).padStart(4, "0")}`;
}
