// A box's self-test: instructions, sending the recording, the resulting light, and the lights of earlier days.
import { html, useState } from '../../preact.js';
import { api } from '../../api.js';
import { date, dateTime, fixed } from '../../format.js';
import { isBare } from '../../setup/marks.js';
import { t } from '../../texts.js';
import { selfTestAdvice, selfTestFinding } from '../../translate.js';
import { Form } from '../forms/form.js';
import { jobIdOf, JobProgress } from '../forms/job.js';
import { Prose } from '../page/prose.js';

const words = t.selfTest;
/** Never colour alone: each light has a word, and in the row of days a sign. */
const TONES = { green: 'good', yellow: 'warn', red: 'bad', not_measured: '' };
const SIGNS = { green: '✓', yellow: '!', red: '✕', not_measured: '?' };
const MAX_DAYS = 28;

/** Needed only if the camera does not name the board that calibrated it. */
const BOARD = [
  { name: 'columns', label: t.box.columns, type: 'number', min: 3, max: 50, required: true },
  { name: 'rows', label: t.box.rows, type: 'number', min: 3, max: 50, required: true },
  { name: 'square', label: t.box.square, type: 'number', min: 0.1, max: 1000, step: 'any', required: true },
];
const FIELDS = [
  {
    name: 'video',
    label: words.video,
    hint: words.videoHint,
    type: 'file',
    accept: 'video/*,.mkv,.ts',
    required: true,
    wide: true,
  },
];

/** Of the steps, the one that prepares the rod. */
const ROD_STEP = 1;

/** The texts for a box with tape, or with bare tools only. */
function wordsFor(box) {
  if (!box.tools.length || !box.tools.every(isBare)) return words;
  const { rod, ...bare } = words.bare;
  return { ...words, ...bare, steps: words.steps.map((step, at) => (at === ROD_STEP ? rod : step)) };
}

const reachField = ({ reach, reachHint }) => ({ name: 'reach', label: reach, hint: reachHint, type: 'number', min: 0, max: 100, step: 'any' });

/** Today's light, in the head of the card and in the list of boxes. @param {Props} props */
export const TodaysLight = ({ test }) =>
  test ? html`<${LightPill} light=${test.light} />` : html`<span class="pill">${words.noneToday}</span>`;

const LightPill = ({ light, name }) => html`
  <span class=${`pill ${TONES[light]}`}>${name ? words.partLight(name, words.lights[light]) : words.lights[light]}</span>`;

/** @param {Props} props */
export function SelfTestSummary({ box, tests }) {
  const [last] = tests;
  if (!last) return html`<p class="muted">${wordsFor(box).none}</p>`;
  return html`
    <p class="small muted">${words.lastAt(dateTime(last.created_at), last.who)}</p>
    <ul class="stack tight" data-self-test=${last.light}>
      ${last.parts.map(part => html`<${Part} key=${part.part} part=${part} test=${last} />`)}
    </ul>
    ${last.holds.length > 0 && html`<details><summary>${words.holds(last.holds.length)}</summary>
      <${Holds} holds=${last.holds} /></details>`}
    <${Days} tests=${tests} />`;
}

/** @param {Props} props */
function Part({ part, test }) {
  const [finding, advice] = [selfTestFinding(part, test), selfTestAdvice(part)];
  return html`
    <li class="stack tight">
      <div><${LightPill} light=${part.light} name=${words.parts[part.part]} /></div>
      <p class="small"><${Prose} text=${finding.text} lang=${finding.lang} /></p>
      ${advice.text && html`<p class="small muted">${words.todo}: <span lang=${advice.lang}>${advice.text}</span></p>`}
    </li>`;
}

const mm = value => fixed(value, 2);

const Holds = ({ holds }) => html`
  <div class="scroll">
    <table class="table dense">
      <thead>
        <tr>
          <th scope="col">${t.session.tool}</th>
          <th scope="col" class="number">${words.from}</th>
          <th scope="col">${words.corner}</th>
          <th scope="col" class="number">${words.error}</th>
          <th scope="col" class="number">${words.along}</th>
          <th scope="col" class="number">${words.across}</th>
          <th scope="col">${words.stated}</th>
        </tr>
      </thead>
      <tbody>
        ${holds.map(hold => html`
          <tr key=${`${hold.tool} ${hold.from_s}`}>
            <th scope="row">${hold.tool}</th>
            <td class="number">${fixed(hold.from_s, 1)}</td>
            <td>${hold.not_counted ? words.notCounted[hold.not_counted]
              : words.cornerOf(hold.column, hold.row, hold.placement)}</td>
            <td class="number">${mm(hold.error_mm)}</td>
            <td class="number">${mm(hold.along_mm)}</td>
            <td class="number">${mm(hold.across_mm)}</td>
            <td>${hold.inside === null ? '–' : hold.inside ? words.inside : words.outside}</td>
          </tr>`)}
      </tbody>
    </table>
  </div>`;

/** The last test of each day, the newest last. @param {Props} props */
function Days({ tests }) {
  const days = new Map();
  for (const test of tests) {
    const day = date(test.created_at);
    if (!days.has(day)) days.set(day, test.light);
  }
  const shown = [...days].slice(0, MAX_DAYS).reverse();
  return html`
    <section class="stack tight">
      <h3>${words.days}</h3>
      <ol class="lights">
        ${shown.map(([day, light]) => html`
          <li key=${day} class=${TONES[light]} title=${words.dayLight(day, words.lights[light])}>
            <span aria-hidden="true">${SIGNS[light]}</span>
            <span class="unseen">${words.dayLight(day, words.lights[light])}</span>
          </li>`)}
      </ol>
    </section>`;
}

/** @param {Props} props */
export function SelfTestForm({ box, camera, isFirst, onChange }) {
  const [job, setJob] = useState(null);
  const namesBoard = Boolean(camera?.board && camera?.square_mm);
  const own = wordsFor(box);
  const fields = [...FIELDS, reachField(own), ...(namesBoard ? [] : BOARD)];
  const send = async ({ video: [file], reach, columns, rows, square }) => {
    const form = new FormData();
    form.append('video', file, file.name);
    if (reach !== undefined) form.append('reach_mm', String(reach));
    if (!namesBoard) {
      form.append('board', `${columns}x${rows}`);
      form.append('square_mm', String(square));
    }
    setJob(jobIdOf(await api.boxes.selfTest(box.id, form)));
  };
  return html`
    <section class="stack">
      <details open=${isFirst}>
        <summary>${words.howTo}</summary>
        <ol class="numbered">${own.steps.map(step => html`<li key=${step}>${step}</li>`)}</ol>
      </details>
      <h3>${words.send}</h3>
      <p class="small muted">${namesBoard ? words.boardKnown(camera.board.replace('x', ' × '), camera.square_mm) : words.boardUnknown}</p>
      <${Form} fields=${fields} onSave=${send} submit=${words.submit} busyWords=${t.box.sending} />
      ${job && html`<${JobProgress} key=${job} id=${job} done=${words.done} onDone=${onChange} />`}
    </section>`;
}
