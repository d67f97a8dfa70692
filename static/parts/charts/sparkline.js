// The course of a few values, as large as a word: no axes, the newest with its error bar, the limit dashed.
import { html } from '../../preact.js';

const [WIDTH, HEIGHT, MARGIN] = [160, 36, 4];

/** `points` as the service returns them, each with a value. */
export function Sparkline({ points, limit, name }) {
  const all = points.flatMap(point => [point.value, point.low ?? point.value, point.high ?? point.value]);
  const known = Number.isFinite(limit) ? [...all, limit] : all;
  const [low, high] = [Math.min(...known), Math.max(...known)];
  const x = at => (points.length === 1 ? WIDTH / 2 : MARGIN + ((WIDTH - 2 * MARGIN) * at) / (points.length - 1));
  const y = value => HEIGHT - MARGIN - ((HEIGHT - 2 * MARGIN) * (value - low)) / (high - low || 1);
  const last = points[points.length - 1];
  const end = x(points.length - 1);
  return html`
    <svg class="spark" viewBox="0 0 ${WIDTH} ${HEIGHT}" role="img" aria-label=${name}>
      ${Number.isFinite(limit) && html`<line class="limit" x1="0" x2=${WIDTH} y1=${y(limit)} y2=${y(limit)} />`}
      ${last.is_lower_bound && html`<line class="bar" x1=${end} x2=${end} y1=${y(last.value)} y2="0" />`}
      ${last.low !== null && html`<line class="bar" x1=${end} x2=${end} y1=${y(last.low)} y2=${y(last.high)} />`}
      ${points.length > 1 && html`<polyline class="line" points=${points.map((point, at) => `${x(at)},${y(point.value)}`).join(' ')} />`}
      <circle class="end" cx=${end} cy=${y(last.value)} r="3" />
    </svg>`;
}
