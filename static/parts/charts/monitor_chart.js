// The charts that monitor a trainee's sessions: LC-CUSUM until proficiency, CUSUM from then on, each with its limit.
// Sessions are judged in the order of arrival. Their numbers follow the stated times, and may jump.
import { html } from '../../preact.js';
import { number } from '../../format.js';
import { t } from '../../texts.js';
import { Empty } from '../page/notice.js';

const words = t.monitor;
const [WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM] = [760, 190, 44, 110, 16, 34];

/** @param {Props} props */
export function MonitorCharts({ charts }) {
  const points = charts.path.flatMap(point => point ?? []);
  const parts = [
    { name: words.learning, explain: words.explain, limit: charts.declares_at, line: words.declares, event: 'declared', points: points.filter(point => point.learning) },
    { name: words.keeping, explain: words.explainKeeping, limit: charts.alarms_at, line: words.alarms, event: 'relapsed', points: points.filter(point => !point.learning) },
  ].filter(part => part.points.length);
  return html`
    <section class="card">
      <header><h2>${words.title}</h2></header>
      ${parts.length === 0 ? html`<${Empty} title=${words.none} body=${words.noneBody} />` : html`<div class="body stack">
        ${parts.map(part => html`<div key=${part.event} class="stack tight"><h3>${part.name}</h3><${Chart} part=${part} charts=${charts} />
          <p class="small muted">${part.explain}</p></div>`)}
      </div>`}
    </section>`;
}

/** @param {Props} props */
function Chart({ part: { name, points, limit, line, event }, charts }) {
  const isInOrder = points.every((point, at) => at === 0 || points[at - 1].session < point.session);
  const placeOf = session => (isInOrder ? session : points.findIndex(point => point.session === session));
  const ends = [points[0].session, points[points.length - 1].session];
  const [first, last] = ends.map(placeOf);
  const top = Math.max(limit, ...points.map(point => point.score)) * 1.1 || 1;
  const x = session => LEFT + ((WIDTH - LEFT - RIGHT) * (placeOf(session) - first + 0.5)) / (last - first + 1);
  const y = score => HEIGHT - BOTTOM - ((HEIGHT - TOP - BOTTOM) * score) / top;
  const eventSessions = new Set(charts.events.filter(one => one.event === event).map(one => one.session));
  return html`
    <svg class="monitor" viewBox="0 0 ${WIDTH} ${HEIGHT}" role="img" aria-label=${words.chart(name, points.length)}>
      <line class="grid-line" x1=${LEFT} x2=${WIDTH - RIGHT} y1=${y(0)} y2=${y(0)} />
      <text class="axis" x=${LEFT - 8} y=${y(0) + 4} text-anchor="end">0</text>
      <line class="limit" x1=${LEFT} x2=${WIDTH - RIGHT} y1=${y(limit)} y2=${y(limit)} />
      <text class="axis" x=${LEFT - 8} y=${y(limit) + 4} text-anchor="end">${number(limit)}</text>
      <text class="axis" x=${WIDTH - RIGHT + 6} y=${y(limit) + 4}>${line}</text>
      ${runsOf(charts.path, points[0].learning).map(run => html`<polyline key=${run[0].session} class="path" points=${run.map(point => `${x(point.session)},${y(point.score)}`).join(' ')} />`)}
      ${points.map(point => html`<circle key=${point.session} class=${eventSessions.has(point.session) ? 'event' : 'dot'} r=${eventSessions.has(point.session) ? 6 : 2.5}
        cx=${x(point.session)} cy=${y(point.score)}><title>${`${words.axis} ${point.session}: ${number(point.score)}`}</title></circle>`)}
      <text class="axis" x=${x(ends[0])} y=${HEIGHT - 18} text-anchor="middle">${ends[0]}</text>
      ${last > first && html`<text class="axis" x=${x(ends[1])} y=${HEIGHT - 18} text-anchor="middle">${ends[1]}</text>`}
      <text class="axis" x=${(LEFT + WIDTH - RIGHT) / 2} y=${HEIGHT - 4} text-anchor="middle">${isInOrder ? words.axis : words.axisByArrival}</text>
    </svg>`;
}

/** Stretches of one chart without a session of the other chart between: a chart starts again after each event. */
function runsOf(path, learning) {
  /** @type {{ session: number, score: number }[][]} */
  const parts = [[]];
  for (const point of path) {
    if (point && point.learning === learning) parts[parts.length - 1].push(point);
    else if (point) parts.push([]); // A session that could not be judged (null) ends nothing.
  }
  return parts.filter(part => part.length);
}
