// Round steps for the axis of a plot.
import { withDigits } from '../../format.js';

/** Three to six round numbers between two ends with their labels, which all have as many decimals as the step. */
export function axisSteps(low, high) {
  const roughStep = (high - low) / 4;
  const power = Math.floor(Math.log10(roughStep));
  const factor = [1, 2, 5].find(one => one * 10 ** power >= roughStep) ?? 10;
  const step = factor * 10 ** power;
  const format = withDigits(Math.max(0, -power - Number(factor === 10)));
  const first = Math.ceil(low / step);
  return Array.from({ length: Math.floor(high / step) - first + 1 }, (_, i) => [(first + i) * step, format((first + i) * step)]);
}
