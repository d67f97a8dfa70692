// Advice on tapes for a box, from a picture of it before any tape is wound: tapes and pairs, best first.
import { html, useState } from '../../preact.js';
import { api } from '../../api.js';
import { number, percent } from '../../format.js';
import { t } from '../../texts.js';
import { Form } from '../forms/form.js';
import { jobIdOf, JobProgress } from '../forms/job.js';
import { Notice } from '../page/notice.js';

const words = t.box.advice;
const GRADES = { good: 'good', at_risk: 'warn', bad: 'bad' };
const PAIRS_SHOWN = 5;
const FIELDS = [
  { name: 'picture', label: words.picture, hint: words.pictureHint, type: 'file', accept: 'image/*,video/*', required: true },
];

/** @param {Props} props */
export function PaletteAdvice({ box }) {
  const [job, setJob] = useState(null);
  const [advice, setAdvice] = useState(null);
  const ask = async ({ picture: [file] }) => {
    const form = new FormData();
    form.append('picture', file, file.name);
    setAdvice(null);
    setJob(jobIdOf(await api.boxes.advise(box.id, form)));
  };
  const read = async () => setAdvice((await api.jobs.get(job)).advice);
  return html`
    <details class="stack">
      <summary>${words.title}</summary>
      <div class="stack">
        <${Form} fields=${FIELDS} onSave=${ask} submit=${words.ask} busyWords=${t.box.sending} />
        ${job && !advice && html`<${JobProgress} key=${job} id=${job} done=${words.ranked} onDone=${read} />`}
        ${advice && html`<${Ranked} advice=${advice} />`}
      </div>
    </details>`;
}

function Ranked({ advice: { tapes, pairs, warnings } }) {
  const colours = new Map(tapes.map(({ tape, srgb }) => [tape, srgb]));
  const best = pairs[0]?.grade === 'good' && pairs[0].tapes;
  return html`
    <${Notice} tone=${best ? 'good' : 'warn'} title=${best ? words.best(best) : words.none}>${!best && words.noneBody}<//>
    ${warnings.length > 0 && html`<${Notice} tone="warn" title=${words.avoid}>
      <ul>${warnings.map(warning => html`<li key=${warning}>${warning}</li>`)}</ul><//>`}
    <div class="columns">
      <table class="table dense">
        <caption class="small muted">${words.tapes}</caption>
        <thead>
          <tr>
            <th scope="col">${t.box.tape}</th>
            <th scope="col" class="number">RAL</th>
            <th scope="col" class="number">${words.margin}</th>
            <th scope="col" class="number">${words.inBox}</th>
            <th scope="col">${words.verdict}</th>
          </tr>
        </thead>
        <tbody>
          ${tapes.map(({ tape, ral, srgb, margin_steps, in_box, grade }) => html`
            <tr key=${tape}>
              <th scope="row"><${Swatch} srgb=${srgb} /> ${tape}</th>
              <td class="number muted">${ral}</td>
              <td class="number">${number(margin_steps)}</td>
              <td class="number">${percent(in_box)}</td>
              <td><${Grade} grade=${grade} /></td>
            </tr>`)}
        </tbody>
      </table>
      <table class="table dense">
        <caption class="small muted">${words.pairs}</caption>
        <thead>
          <tr>
            <th scope="col">${words.two}</th>
            <th scope="col" class="number">${words.margin}</th>
            <th scope="col">${words.verdict}</th>
          </tr>
        </thead>
        <tbody>
          ${pairs.slice(0, PAIRS_SHOWN).map(pair => html`
            <tr key=${pair.tapes.join()}>
              <th scope="row">${pair.tapes.map(tape => html`<${Swatch} key=${tape} srgb=${colours.get(tape)} />`)}
                ${' '}${words.and(pair.tapes)}</th>
              <td class="number">${number(pair.margin_steps)}</td>
              <td><${Grade} grade=${pair.grade} /></td>
            </tr>`)}
        </tbody>
      </table>
    </div>`;
}

const Swatch = ({ srgb }) => html`<span class="tape-swatch" aria-hidden="true" style=${{ background: srgb }}></span>`;

const Grade = ({ grade }) => html`<span class=${`pill ${GRADES[grade]}`}>${t.box.grades[grade]}</span>`;
