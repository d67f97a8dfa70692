// A value with its error: the value shows no digit beyond the last digit of the error.
import { fixed, number, uncertainty } from './format.js';
import { t } from './texts.js';

const MAX_DIGITS = 3;

/** A session's value as text: with its error, or as a lower bound. */
export function pointText({ value, low, high, is_lower_bound: isLowerBound }) {
  if (isLowerBound) return t.session.atLeast(number(value));
  return low === null ? number(value) : withError(value, { low, high }).join(' ± ');
}

/**
 * `[value, half]`, both to the second significant digit of half the error's range; beyond 0 to 3 decimals, or without a
 * range, each by itself.
 */
export function withError(value, { low, high }) {
  const half = (high - low) / 2;
  const digits = 1 - Math.floor(Math.log10(half));
  if (!(digits >= 0 && digits <= MAX_DIGITS)) return [number(value), uncertainty(half)];
  return [fixed(value, digits), fixed(half, digits)];
}
