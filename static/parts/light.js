// Has the light moved while a session arrives? Judged as the whole recording will be.
import { percent } from '../format.js';
import { t } from '../texts.js';

const words = t.watch.light;
/** `Cause::Exposure`, `Cause::WhiteBalance` in src/pipeline/quality/limits.rs; src/http/dashboard.rs has a test of it. */
const MOST_EXPOSURE = 0.15;
const MOST_WHITE_BALANCE = 4;
/** Codes that the shares of `chroma_shift` are of, as in src/pipeline/quality/session.rs. */
const CODES = 224;

/** What is wrong with the light, in words; null while nothing is. */
export function lightFault(light) {
  if (!light) return null;
  const change = light.luma_ratio - 1;
  const codes = CODES * Math.hypot(...light.chroma_shift);
  const whole = percent(Math.round(100 * Math.abs(change)) / 100);
  const faults = [
    Math.abs(change) > MOST_EXPOSURE && (change > 0 ? words.brighter : words.darker)(whole),
    codes > MOST_WHITE_BALANCE && words.colour,
  ].filter(Boolean);
  return faults.length ? { title: faults.join(', '), advice: words.advice } : null;
}
