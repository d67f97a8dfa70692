// Whether the light has changed while a session arrives, judged with the limits for whole recordings.
import { percent } from '../../format.js';
import { t } from '../../texts.js';

const words = t.watch.light;
/**
 * `QualityCause::Exposure` and `QualityCause::WhiteBalance` in measurement/src/motion/quality/limits.rs; a test in
 * src/http/dashboard.rs compares them.
 */
const MAX_EXPOSURE = 0.15;
const MAX_WHITE_BALANCE = 4;
/** The number of codes that `chroma_shift` is a share of, as in measurement/src/motion/quality/session.rs. */
const CODES = 224;

/** What is wrong with the light, in words; null while nothing is. */
export function lightFault(light) {
  if (!light) return null;
  const change = light.luma_ratio - 1;
  const codes = CODES * Math.hypot(...light.chroma_shift);
  const whole = percent(Math.round(100 * Math.abs(change)) / 100);
  const faults = [
    Math.abs(change) > MAX_EXPOSURE && (change > 0 ? words.brighter : words.darker)(whole),
    codes > MAX_WHITE_BALANCE && words.colour,
  ].filter(Boolean);
  return faults.length ? { title: faults.join(', '), advice: words.advice } : null;
}
