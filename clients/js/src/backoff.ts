/** How long to wait before another try. */

const FIRST_RETRY_MS = 500;
const MAX_RETRY_MS = 10_000;

/**
 * Delay before retry number `attempt` (from 0): doubling, capped, and spread over its upper half
 * so that the readers of a restarted server do not return all at once. `random` is in [0, 1).
 */
export function retryDelayMs(attempt: number, random: number): number {
  const ceiling = Math.min(MAX_RETRY_MS, FIRST_RETRY_MS * 2 ** attempt);
  return ceiling * (0.5 + random / 2);
}
