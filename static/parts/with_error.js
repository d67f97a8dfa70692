// A value beside its error, as both are told: no digit of the value stands behind the last that the error leaves.
import { fixed, number, uncertain } from '../format.js';

const MOST_DIGITS = 3;

/** `[value, half]`, both to the second telling digit of half the error's range; beyond that, and where it is none, each by itself. */
export function withError(value, { low, high }) {
  const half = (high - low) / 2;
  const digits = 1 - Math.floor(Math.log10(half));
  if (!(digits >= 0 && digits <= MOST_DIGITS)) return [number(value), uncertain(half)];
  return [fixed(value, digits), fixed(half, digits)];
}
