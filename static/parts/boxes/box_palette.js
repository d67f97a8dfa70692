// The colours of a box's tools: the learned palette, and learning from annotations with the clip or frames that they mark.
import { html, useState } from '../../preact.js';
import { api, Problem } from '../../api.js';
import { dateTime, number } from '../../format.js';
import { t } from '../../texts.js';
import { colourReason } from '../../translate.js';
import { readJson } from './box_camera.js';
import { isBare } from '../../setup/marks.js';
import { Form } from '../forms/form.js';
import { jobIdOf, JobProgress } from '../forms/job.js';

const words = t.box;
const FIELDS = [
  {
    name: 'annotations',
    label: words.annotations,
    hint: words.annotationsHint,
    type: 'file',
    accept: '.json,application/json',
    required: true,
  },
  { name: 'clip', label: words.clip, hint: words.clipHint, type: 'file', accept: 'video/*,.mkv,.ts' },
  { name: 'frames', label: words.frames, hint: words.framesHint, type: 'file', multiple: true, accept: 'image/*' },
  { name: 'empty', label: words.emptyBox, hint: words.emptyBoxHint, type: 'file', accept: 'image/*' },
];

export function PaletteSummary({ palette }) {
  if (!palette) return html`<p class="muted">${words.noPalette}</p>`;
  const hasSides = palette.tools.some(tool => sideOf(tool, palette.tools));
  const hasTape = !palette.tools.every(isBare);
  return html`
    <p class="small muted">${words.learnedAs(palette.version, dateTime(palette.created_at))}</p>
    <div class="columns">
      <table class="table dense">
        <thead>
          <tr>
            <th scope="col">${t.session.tool}</th>
            <th scope="col">${words.tape}</th>
            ${hasSides && html`<th scope="col">${words.hand}</th>`}
            <th scope="col" class="number">${words.diameter}</th>
            ${hasTape && html`<th scope="col" class="number">${words.band}</th>`}
          </tr>
        </thead>
        <tbody>${palette.tools.map(tool => html`<${Tool} key=${tool.name} tool=${tool} hasTape=${hasTape}
          side=${hasSides && (sideOf(tool, palette.tools) ?? '–')} />`)}</tbody>
      </table>
      <table class="table dense">
        <thead><tr><th scope="col">${words.label}</th><th scope="col" class="number">${words.samples}</th></tr></thead>
        <tbody>
          ${palette.counts.map(({ label, samples }) => html`
            <tr key=${label}><th scope="row">${labelOf(label, hasTape)}</th><td class="number">${samples}</td></tr>`)}
        </tbody>
      </table>
    </div>
    ${palette.verdicts && html`<${Verdicts} verdicts=${palette.verdicts} />`}`;
}

/** A label of the marks in words; the name of a tape's colour is the person's own. */
const labelOf = (label, hasTape) => (hasTape ? t.setup.colours : t.setup.colours.bare).labels[label] ?? label;

const GRADES = { good: 'good', at_risk: 'warn', bad: 'bad' };

/** The grades of the colours, before anything is recorded with them. */
export const Verdicts = ({ verdicts }) => html`
  <ul class="stack">
    ${verdicts.map(({ tool, grade, reasons, causes }) => html`
      <li key=${tool} data-grade=${grade}>
        <span class=${`pill ${GRADES[grade]}`}>${tool}: ${words.grades[grade]}</span>
        ${reasons.map((reason, at) => html`<${Reason} key=${reason} ...${colourReason(reason, causes?.[at])} />`)}
      </li>`)}
  </ul>`;

const Reason = ({ text, lang }) => html`<p class="small muted" lang=${lang}>${text}</p>`;

/** The service gives the tape's colour only if it is not the tool's name. */
const tapeOf = tool => tool.colour ?? tool.name;

/**
 * The side of a tool's hand: as stated; for two tools with the same tape, opposite to the other's, else by their order.
 */
function sideOf(tool, tools) {
  if (tool.side) return words.sides[tool.side];
  const pair = tools.filter(other => tapeOf(other) === tapeOf(tool));
  if (pair.length < 2) return null;
  const statedSide = pair.find(other => other.side)?.side;
  if (statedSide) return words.sides[statedSide === 'left' ? 'right' : 'left'];
  return words.byOrder(words.sides[tool === pair[0] ? 'left' : 'right']);
}

const Tool = ({ tool, side, hasTape }) => html`
  <tr>
    <th scope="row">${tool.name}</th>
    <td>${isBare(tool) ? words.bare : tapeOf(tool)}</td>
    ${side && html`<td>${side}</td>`}
    <td class="number">${number(tool.diameter_mm)} mm</td>
    ${hasTape && html`<td class="number">${tool.band_length_mm ? `${number(tool.band_length_mm)} mm` : '–'}</td>`}
  </tr>`;

/** @param {Props} props */
export function PaletteForm({ box, onChange }) {
  const [job, setJob] = useState(null);
  const learn = async ({ annotations: [file], clip: [clip], frames, empty: [empty] }) => {
    await readJson(file);
    const form = new FormData();
    form.append('annotations', file, 'annotations.json');
    if (clip) form.append('video', clip, clip.name);
    else for (const frame of frames) form.append(`frame_${frameNumber(frame.name)}`, frame, frame.name);
    if (empty) form.append('empty_box', empty, empty.name);
    setJob(jobIdOf(await api.boxes.learnPalette(box.id, form)));
  };
  return html`
    <section class="stack">
      <h3>${words.learn}</h3>
      <${Form} fields=${FIELDS} onSave=${learn} submit=${words.learn} busyWords=${words.sending} />
      ${job && html`<${JobProgress} key=${job} id=${job} done=${words.learned} onDone=${onChange} />`}
    </section>`;
}

/** `clip_frame_012.png` → 12: the annotations count frames by number. */
function frameNumber(name) {
  const numbers = name.replace(/\.[^.]*$/, '').match(/\d+/g);
  if (!numbers) throw new Problem({ title: words.noNumber(name), status: 0 });
  return Number(numbers[numbers.length - 1]);
}
