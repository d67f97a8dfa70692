// One feature over a trainee's sessions: a small plot with its last value; each point leads to its session.
import { html } from './preact.js';
import { date, number, percent, unit } from '../format.js';
import { href } from '../router.js';
import { t } from '../texts.js';

const words = t.trainee;
const [WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM] = [300, 104, 44, 8, 10, 20];

/** `points`: `{ id, recorded_at, value }` in time order; `value` null where there was not enough to measure. */
export function Spark({ title, unit: name, points }) {
  const known = points.filter(point => point.value !== null);
  const last = known[known.length - 1];
  return html`
    <section class="card spark">
      <header><h4>${title}</h4><span class="last">${last ? `${number(last.value)} ${unit(name)}`
        : t.session.notEnough}</span></header>
      ${known.length > 0 && html`<${Curve} title=${title} name=${unit(name)} points=${points} known=${known} />`}
      <p class="small muted">${known.length > 1 && known.every(point => point.value > 0)
        ? words.change(change(known), date(known[0].recorded_at)) : '\u00a0'}</p>
    </section>`;
}

/** Only for positive values: a percentage of a negative or changing sign says nothing. */
function change(known) {
  const share = known[known.length - 1].value / known[0].value - 1;
  return `${share > 0 ? '+' : ''}${percent(share).replace('-', '−')}`;
}

function Curve({ title, name, points, known }) {
  const [low, high] = limits(known.map(point => point.value));
  const x = index => LEFT + ((WIDTH - LEFT - RIGHT) * index) / Math.max(1, points.length - 1);
  const y = value => TOP + (HEIGHT - TOP - BOTTOM) * (1 - (value - low) / (high - low));
  const line = points
    .map((point, i) =>
      point.value === null ? null : `${i && points[i - 1].value !== null ? 'L' : 'M'}${x(i)} ${y(point.value)}`,
    )
    .filter(Boolean)
    .join('');
  return html`
    <svg viewBox="0 0 ${WIDTH} ${HEIGHT}" role="group" aria-label=${words.spark(title, points.length)}>
      ${[low, (low + high) / 2, high].map(value => html`
        <line class="grid-line" x1=${LEFT} x2=${WIDTH - RIGHT} y1=${y(value)} y2=${y(value)} />
        <text class="axis" x=${LEFT - 6} y=${y(value) + 4} text-anchor="end">${number(value)}</text>`)}
      <text class="axis" x=${LEFT} y=${HEIGHT - 4}>1</text>
      <text class="axis" x=${WIDTH - RIGHT} y=${HEIGHT - 4} text-anchor="end">${points.length}</text>
      <path class="curve" d=${line} fill="none" />
      ${points.map(
        (point, i) =>
          point.value !== null &&
          html`
        <a key=${point.id} href=${href(['sessions', point.id])}
          aria-label=${`${date(point.recorded_at)}: ${number(point.value)} ${name}`}>
          <circle class="hit" cx=${x(i)} cy=${y(point.value)} r="12" /><circle class="dot" cx=${x(i)}
            cy=${y(point.value)} r="3.5"><title>
            ${`${date(point.recorded_at)}: ${number(point.value)} ${name}`}</title></circle>
        </a>`)}
    </svg>`;
}

/** Room above and below, and from zero where the values come near it: a curve that starts at its minimum exaggerates. */
function limits(values) {
  const [low, high] = [Math.min(...values), Math.max(...values)];
  const room = (high - low || Math.abs(high) || 1) * 0.15;
  const bottom = low >= 0 && low < high / 2 ? 0 : low - room;
  return [bottom, high + room];
}
