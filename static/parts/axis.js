// Round steps of a plot's axis.
import { withDigits } from '../format.js';

/** Three to six round numbers between two ends and how they read, all with as many digits as the step has. */
export function axisSteps(low, high) {
  const rough = (high - low) / 4;
  const power = Math.floor(Math.log10(rough));
  const of = [1, 2, 5, 10].find(of => of * 10 ** power >= rough);
  const step = of * 10 ** power;
  const read = withDigits(Math.max(0, -power - (of === 10)));
  const first = Math.ceil(low / step);
  return Array.from({ length: Math.floor(high / step) - first + 1 }, (_, i) => [(first + i) * step, read((first + i) * step)]);
}
