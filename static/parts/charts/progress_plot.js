// One feature over a trainee's sessions: values with their error bars, the limit, the learning curve with its band.
// Each point links to its session.
import { axisSteps } from './axis.js';
import { html } from '../../preact.js';
import { date, number, unit } from '../../format.js';
import { href } from '../../router.js';
import { t } from '../../texts.js';
import { featureWithTool } from '../../translate.js';

const words = t.trainee;
const [WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM] = [760, 300, 56, 16, 16, 34];

/**
 * `series` and `sessions` as the service returns them. `gaps`: sessions without a value, each with its reason, as shaded
 * columns. `changes`: sessions where another version begins, with its name. `plain`: no point is judged or set aside.
 *
 * @param {Props} props
 */
export function ProgressPlot({ series, sessions, gaps = [], changes = [], plain = false }) {
  const byNumber = new Map(sessions.map(session => [session.number, session]));
  const points = series.points.filter(point => point.value !== null);
  const line = series.learning.curve?.line ?? [];
  const first = sessions[0]?.number ?? 1;
  const last = sessions[sessions.length - 1]?.number ?? 1;
  const [low, high] = valueRange([
    ...points.flatMap(point => [point.value, point.low, point.high]),
    ...line.flatMap(at => [at.low, at.high]),
    series.target?.limit,
  ]);
  const x = session => LEFT + ((WIDTH - LEFT - RIGHT) * (session - first + 0.5)) / (last - first + 1);
  const y = value => TOP + (HEIGHT - TOP - BOTTOM) * (1 - (value - low) / (high - low));
  const path = valueOf => line.map((at, i) => `${i ? 'L' : 'M'}${x(at.session)} ${y(valueOf(at))}`).join('');
  const column = Math.min(GAP_PX, (WIDTH - LEFT - RIGHT) / (last - first + 1));
  const lowerEdge = [...line].reverse().map(at => `L${x(at.session)} ${y(at.low)}`).join('');
  return html`
    <svg class="progress-plot" viewBox="0 0 ${WIDTH} ${HEIGHT}" role="group"
      aria-label=${words.spark(featureWithTool(series), points.length)}>
      ${gaps.map(gap => html`<a key=${`gap ${gap.session}`} href=${href(['sessions', byNumber.get(gap.session)?.id ?? ''])}
        aria-label=${words.point(date(byNumber.get(gap.session)?.recorded_at), gap.label, '')}>
        <rect class="gap" x=${x(gap.session) - column / 2} width=${column} y=${TOP} height=${HEIGHT - TOP - BOTTOM}><title>${gap.label}</title></rect></a>`)}
      ${axisSteps(low, high).map(([value, label]) => html`<g key=${value}>
        <line class="grid-line" x1=${LEFT} x2=${WIDTH - RIGHT} y1=${y(value)} y2=${y(value)} />
        <text class="axis" x=${LEFT - 8} y=${y(value) + 4} text-anchor="end">${label}</text></g>`)}
      <text class="axis" x=${LEFT} y=${TOP - 5}>${unit(series.unit)}</text>
      <text class="axis" x=${x(first)} y=${HEIGHT - 18} text-anchor="middle">${first}</text>
      ${last > first && html`<text class="axis" x=${x(last)} y=${HEIGHT - 18} text-anchor="middle">${last}</text>`}
      <text class="axis" x=${(LEFT + WIDTH - RIGHT) / 2} y=${HEIGHT - 4} text-anchor="middle">${words.sessionAxis}</text>
      ${changes.map(change => html`<g key=${`change ${change.session}`}>
        <line class="change" x1=${x(change.session - 0.5)} x2=${x(change.session - 0.5)} y1=${TOP} y2=${HEIGHT - BOTTOM} />
        <text class="axis" x=${x(change.session - 0.5) + 4} y=${TOP - 5}>${change.label}</text></g>`)}
      ${line.length > 1 && html`<path class="band" d=${`${path(at => at.high)}${lowerEdge}Z`} />
        <path class="curve" d=${path(at => at.value)} fill="none" />`}
      ${series.target && html`<line class="limit" x1=${LEFT} x2=${WIDTH - RIGHT} y1=${y(series.target.limit)}
        y2=${y(series.target.limit)} /><${LimitLabel} text=${words.limit(number(series.target.limit), unit(series.unit))}
        at=${y(series.target.limit)} points=${points.map(point => pointBox(point, x(point.session), y))} />`}
      ${points.map(point => html`<${Dot} key=${point.session} point=${point} session=${byNumber.get(point.session)}
        x=${x(point.session)} y=${y} name=${unit(series.unit)} plain=${plain} />`)}
    </svg>`;
}

const DOT_PX = 6;
/** Largest width of a shaded column. */
const GAP_PX = 24;
/** A letter of the label at the largest size of the print, and the height of the label, in units of the plot. */
const [LETTER_PX, LABEL_PX] = [10, 20];

/** The space that a point takes with its error bar. */
const pointBox = (point, x, y) => ({
  left: x - DOT_PX,
  right: x + DOT_PX,
  top: (point.is_lower_bound ? TOP : y(point.high ?? point.value)) - DOT_PX,
  bottom: y(point.low ?? point.value) + DOT_PX,
});

/** The limit's name at its line: right or left, above or below, where it covers no point, else the fewest. */
function LimitLabel({ text, at, points }) {
  const width = text.length * LETTER_PX;
  const places = [['end', at - 5], ['end', at + 15], ['start', at - 5], ['start', at + 15]].map(([anchor, baseline]) => {
    const left = anchor === 'end' ? WIDTH - RIGHT - width : LEFT + 4;
    const covered = points.filter(point => point.right > left && point.left < left + width
      && point.bottom > baseline - LABEL_PX + 4 && point.top < baseline + 4).length;
    const isOutside = baseline < TOP || baseline > HEIGHT - BOTTOM;
    return { anchor, baseline, cost: covered + (isOutside ? points.length + 1 : 0) };
  });
  const best = places.reduce((found, place) => (place.cost < found.cost ? place : found));
  return html`<text class="axis limit-name" x=${best.anchor === 'end' ? WIDTH - RIGHT : LEFT + 4} y=${best.baseline}
    text-anchor=${best.anchor}>${text}</text>`;
}

/** @param {Props} props */
function Dot({ point, session, x, y, name, plain }) {
  const kind = session.set_aside && !plain ? 'aside' : (point.judgement ?? 'plain');
  const value = point.is_lower_bound ? t.session.atLeast(number(point.value)) : number(point.value);
  const label = words.point(date(session.recorded_at), `${value} ${name}`, words.judgements[kind]);
  return html`
    <a href=${href(['sessions', session.id])} aria-label=${label}>
      ${point.is_lower_bound && html`<line class="bar" x1=${x} x2=${x} y1=${y(point.value)} y2=${TOP} />`}
      ${point.low !== null && html`<line class="bar" x1=${x} x2=${x} y1=${y(point.low)} y2=${y(point.high)} />`}
      <circle class="hit" cx=${x} cy=${y(point.value)} r="9" />
      <circle class=${`dot ${kind}`} cx=${x} cy=${y(point.value)} r="4"><title>${label}</title></circle>
    </a>`;
}

/** Adds a margin above and below, and starts at zero if the values come near it. */
function valueRange(values) {
  const known = values.filter(value => Number.isFinite(value));
  if (!known.length) return [0, 1];
  const [low, high] = [Math.min(...known), Math.max(...known)];
  const margin = (high - low || Math.abs(high) || 1) * 0.08;
  return [low >= 0 && low < high / 2 ? 0 : low - margin, high + margin];
}
