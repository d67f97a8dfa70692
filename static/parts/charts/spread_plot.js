// One dot per person on a line of values, one row per group; dots that would cover each other are stacked. A vertical
// line is the limit.
import { axisSteps } from './axis.js';
import { html } from '../../preact.js';
import { number, unit } from '../../format.js';
import { t } from '../../texts.js';
import { featureWithTool } from '../../translate.js';

const words = t.spread;
const [WIDTH, LEFT, RIGHT, ROW, BOTTOM, DOT] = [760, 150, 20, 96, 34, 4];

/** @param {Props} props */
export function SpreadPlot({ distribution, limit, range: [low, high] }) {
  const height = distribution.groups.length * ROW + BOTTOM;
  const x = value => LEFT + ((WIDTH - LEFT - RIGHT) * (value - low)) / (high - low);
  const count = distribution.groups.reduce((sum, group) => sum + group.values.length, 0);
  return html`
    <svg class="progress-plot spread" viewBox="0 0 ${WIDTH} ${height}" role="img"
      aria-label=${words.plot(featureWithTool(distribution), count)}>
      ${distribution.groups.map((group, at) => html`<g key=${group.cohort}>
        <text class="axis" x="0" y=${(at + 1) * ROW - 18}>${short(group.name ?? words.everybody)}</text>
        <text class="axis" x="0" y=${(at + 1) * ROW - 2}>${words.people(group.values.length)}</text>
        <line class="grid-line" x1=${LEFT} x2=${WIDTH - RIGHT} y1=${(at + 1) * ROW} y2=${(at + 1) * ROW} />
        ${stacked(group.values, x).map(([value, level], i) => html`<circle key=${i} class=${side(value, limit, distribution.better)} r=${DOT}
          cx=${x(value)} cy=${(at + 1) * ROW - DOT - 2 - level}><title>${number(value)} ${unit(distribution.unit)}</title></circle>`)}
      </g>`)}
      ${axisSteps(low, high).map(([value, label]) => html`<text key=${value} class="axis" x=${x(value)} y=${height - 14} text-anchor="middle">
        ${label}</text>`)}
      <text class="axis" x=${WIDTH - RIGHT} y=${height - 1} text-anchor="end">${unit(distribution.unit)}</text>
      ${limit !== null && html`<line class="limit" x1=${x(limit)} x2=${x(limit)} y1="14" y2=${height - BOTTOM} />
        <text class="axis" x=${x(limit)} y="10" text-anchor="middle">${words.line(`${number(limit)} ${unit(distribution.unit)}`.trim())}</text>`}
    </svg>`;
}

const short = text => (text.length > 20 ? `${text.slice(0, 19)}…` : text);

function side(value, limit, better) {
  if (limit === null) return 'dot';
  const keeps = better === 'higher' ? value >= limit : value <= limit;
  return keeps ? 'dot pass' : 'dot fail';
}

/** Each value with its height above the line: as low as the dots beside it allow. */
function stacked(values, x) {
  const placed = [];
  const maxLevel = ROW - 34;
  for (const value of values) {
    let level = 0;
    while (level < maxLevel && placed.some(([other, at]) => Math.hypot(x(other) - x(value), at - level) < 2 * DOT)) level += DOT;
    placed.push([value, level]);
  }
  return placed;
}
