// A group's table: course of the values, newest value with its error, judgement by the standard. Sortable, but not a
// ranking.
import { html, useState } from '../../preact.js';
import { csvTime } from '../../csv.js';
import { date, unit } from '../../format.js';
import { href } from '../../router.js';
import { language, t } from '../../texts.js';
import { featureWithTool } from '../../translate.js';
import { Sparkline } from '../charts/sparkline.js';
import { SaveTable } from '../page/save_table.js';
import { limitText } from '../tasks/standard.js';
import { pointText } from '../../with_error.js';

const words = t.groups;
const newest = row => row.points[row.points.length - 1];
const TONES = { pass: 'good', fail: 'bad' };

/** The sort key of each column; text is sorted in the page's language. */
const KEYS = {
  name: row => row.person.name,
  value: row => newest(row)?.value ?? null,
  state: row => stateOf(row)?.words ?? null,
  sessions: row => row.sessions,
  last: row => row.last_at,
};

/** @param {{ progress: Schemas['GroupProgress'] }} props */
export function GroupTable({ progress }) {
  const [by, setBy] = useState({ key: 'name', falling: false });
  const all = progress.rows.map(row => ({ ...row, person: progress.trainees.find(one => one.id === row.trainee) })).filter(row => row.person);
  const rows = sorted(all, by);
  const sort = key => setBy({ key, falling: by.key === key && !by.falling });
  const head = (key, name, kind) => html`<${Head} name=${name} kind=${kind} order=${by.key === key ? (by.falling ? 'falling' : 'rising') : null}
    onSort=${() => sort(key)} />`;
  return html`
    <p class="body small muted">${progress.target ? words.limitIs(limitText(progress.target), featureWithTool(progress.target)) : words.noLimit} ${
      by.key === 'value' ? words.byValue : words.byName}</p>
    <div class="scroll"><table class="table group-table">
      <thead><tr>
        ${head('name', words.name)}<th scope="col">${words.course}</th>
        ${head('value', `${words.newest}${unit(progress.unit) ? `, ${unit(progress.unit)}` : ''}`, 'number')}
        <th scope="col">${words.target}</th>${head('state', words.state)}
        ${head('sessions', words.sessions, 'number wide')}${head('last', words.last, 'wide')}
      </tr></thead>
      <tbody>${rows.map(row => html`<${Row} key=${row.trainee} row=${row} progress=${progress} />`)}</tbody>
    </table></div>
    <${SaveTable} name=${`${progress.group.name} ${progress.task.name}`} rows=${() => tableRows(rows, progress)} />`;
}

/** The table for a spreadsheet. */
const tableRows = (rows, { unit: of }) => [
  [words.name, ...[words.newest, t.saveTable.low, t.saveTable.high].map(name => (unit(of) ? `${name}, ${unit(of)}` : name)),
    words.target, words.state, words.sessions, words.last],
  ...rows.map(row => {
    const point = newest(row);
    return [row.person.name, point?.value, point?.low, point?.high, point?.judgement ? judgementWords(point.judgement) : null,
      stateOf(row)?.words ?? words.noStandard, row.sessions, csvTime(row.last_at)];
  }),
];

const judgementWords = judgement => words.judgements[judgement] ?? t.trainee.judgements[judgement];

function sorted(rows, { key, falling }) {
  const sortKeyOf = KEYS[key];
  const compare = (one, other) => {
    const [a, b] = [sortKeyOf(one), sortKeyOf(other)];
    // Rows without a value come last in both directions.
    if (a === null || b === null) return Number(a === null) - Number(b === null);
    const order = typeof a === 'string' ? a.localeCompare(b, language) : a - b;
    return falling ? -order : order;
  };
  return [...rows].sort(compare);
}

const Head = ({ name, kind, order, onSort }) => html`
  <th scope="col" class=${kind} aria-sort=${order === 'falling' ? 'descending' : order ? 'ascending' : undefined}>
    <button class="sorted" type="button" data-by=${order} title=${words.sort(name)} onClick=${onSort}>${name}</button></th>`;

/** @param {{ row: any, progress: Schemas['GroupProgress'] }} props */
function Row({ row, progress }) {
  const point = newest(row);
  const state = stateOf(row);
  const name = row.person.name;
  return html`
    <tr>
      <th scope="row"><a class="cover" href=${href(['trainees', row.trainee], { task: progress.task.id })}>${name}</a>
        <span class="narrow small muted">${words.trained(row.sessions, row.last_at ? date(row.last_at) : words.never)}</span></th>
      <td>${row.points.length > 0 && html`<${Sparkline} points=${row.points} limit=${progress.target?.limit} name=${words.spark(name, row.points.length)} />`}</td>
      <td class="number">${point ? html`<a href=${href(['sessions', row.newest])}>${pointText(point)}</a>` : '–'}</td>
      <td>${judgementCell(point)}</td>
      <td>${state ? html`<span class=${`pill ${state.tone}`}>${state.words}</span>` : words.noStandard}</td>
      <td class="number wide">${row.sessions}</td>
      <td class="when wide">${row.last_at ? date(row.last_at) : words.never}</td>
    </tr>`;
}

function judgementCell(point) {
  if (!point?.judgement) return '–';
  const text = words.judgements[point.judgement];
  if (text) return html`<span class=${`pill ${TONES[point.judgement]}`}>${text}</span>`;
  return html`<span class="small muted">${t.trainee.judgements[point.judgement]}</span>`;
}

/** A relapse outweighs that the rule was met once. Without a standard there is no state. */
function stateOf({ passed, rule, standing }) {
  if (standing === 'relapsed') return { words: words.standing.relapsed, tone: 'bad' };
  if (passed) return { words: words.passed, tone: 'good' };
  if (rule?.state === 'out_of_reach') return { words: words.outOfReach, tone: 'bad' };
  if (rule && rule.have_in_a_row < rule.in_a_row) return { words: words.open(rule.have_in_a_row, rule.in_a_row), tone: '' };
  if (rule) return { words: words.openMore(rule.have_more, rule.then_more), tone: '' };
  return standing ? { words: words.standing[standing], tone: '' } : null;
}
