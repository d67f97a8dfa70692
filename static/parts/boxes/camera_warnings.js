// What makes a box's camera doubtful, in words, with figure and limit.
import { html } from '../../preact.js';
import { number, percent } from '../../format.js';
import { t } from '../../texts.js';
import { Notice } from '../page/notice.js';

const words = t.setup.calibration;
/** Figures in pixels and counts; the others are shares. */
const PLAIN = ['residual', 'few_photos'];

/** @param {{ calibration: Schemas['CalibrationResponse'] | null | undefined }} props */
export function CameraWarnings({ calibration }) {
  const warnings = calibration?.warnings ?? [];
  if (!warnings.length) return null;
  return html`<${Notice} tone="warn" title=${words.warned}>
    ${warnings.map(warning => html`<span key=${warning.name} class="line">${warningText(warning)}<br /></span>`)}<//>`;
}

/** @param {Schemas['CameraWarning']} warning */
function warningText({ name, figure, limit }) {
  const show = PLAIN.includes(name) ? number : percent;
  return words.warnings[name](show(figure), show(limit));
}
