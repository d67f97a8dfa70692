// A box's camera: its calibration, a calibration from photos or a video, and a camera.json from elsewhere.
import { html, useState } from '../../preact.js';
import { api, Problem } from '../../api.js';
import { dateTime, number } from '../../format.js';
import { serviceLang, t } from '../../texts.js';
import { Form } from '../forms/form.js';
import { CameraWarnings } from './camera_warnings.js';
import { jobIdOf, JobProgress } from '../forms/job.js';
import { Notice } from '../page/notice.js';

const words = t.box;
const BOARD_FIELDS = [
  { name: 'columns', label: words.columns, type: 'number', min: 3, max: 50, required: true, value: 9 },
  { name: 'rows', label: words.rows, type: 'number', min: 3, max: 50, required: true, value: 6 },
  { name: 'square', label: words.square, type: 'number', min: 0.1, max: 1000, step: 'any', required: true, value: 21 },
  {
    name: 'files',
    label: words.files,
    hint: words.filesHint,
    type: 'file',
    multiple: true,
    accept: 'image/*,video/*',
    required: true,
    wide: true,
  },
];
const FILE_FIELDS = [
  {
    name: 'file',
    label: 'camera.json',
    hint: words.putHint,
    type: 'file',
    accept: '.json,application/json',
    required: true,
  },
  { name: 'from', label: words.putFrom, hint: words.putFromHint, type: 'datetime-local' },
];

/** @param {Props} props */
export function CameraSummary({ camera, calibration }) {
  if (!camera) return html`<p class="muted">${words.noCamera}</p>`;
  const facts = [
    [words.rms, Number.isFinite(camera.rms_px) ? `${number(camera.rms_px)} px` : '–'],
    [words.picture, `${camera.width} × ${camera.height}`],
    [words.focal, `${number(camera.fx)} × ${number(camera.fy)} px`],
    [words.centre, `${number(camera.cx)}, ${number(camera.cy)} px`],
    [words.when, dateTime(camera.calibrated_at)],
    ...(camera.photos?.length
      ? [[words.photos, words.photosUsed(camera.photos.filter(photo => photo.used).length, camera.photos.length)]]
      : []),
  ];
  return html`
    <${CameraWarnings} calibration=${calibration} />
    <dl class="facts">${facts.map(([name, value]) => html`<dt key=${name}>${name}</dt><dd>${value}</dd>`)}</dl>
    ${camera.photos?.length > 0 && html`<details><summary>${words.photos}</summary>
      <${Photos} photos=${camera.photos} /></details>`}`;
}

const Photos = ({ photos }) => html`
  <div class="scroll">
    <table class="table dense">
      <thead><tr><th scope="col">${words.photo}</th><th scope="col">${words.used}</th><th scope="col" class="number">
        ${words.residual}</th><th scope="col">${words.reason}</th></tr></thead>
      <tbody>
        ${photos.map(photo => html`
          <tr key=${photo.file}>
            <th scope="row">${photo.file}</th>
            <td><span class=${`pill ${photo.used ? 'good' : 'warn'}`}>${photo.used ? words.used
              : words.left}</span></td>
            <td class="number">${number(photo.rms_px)}</td>
            <td lang=${serviceLang}>${photo.reason}</td>
          </tr>`)}
      </tbody>
    </table>
  </div>`;

/** @param {Props} props */
export function CameraForms({ box, onChange }) {
  const [job, setJob] = useState(null);
  const [saved, setSaved] = useState(false);
  const calibrate = async ({ columns, rows, square, files }) => {
    const form = new FormData();
    form.append('board', `${columns}x${rows}`);
    form.append('square_mm', String(square));
    for (const file of files) form.append(file.type.startsWith('video/') ? 'video' : 'photo', file, file.name);
    setSaved(false);
    setJob(jobIdOf(await api.boxes.calibrate(box.id, form)));
  };
  const put = async ({ file: [file], from }) => {
    await api.boxes.putCamera(box.id, await readJson(file), from ? new Date(from).toISOString() : undefined);
    setSaved(true);
    onChange();
  };
  return html`
    <div class="alternatives">
      <section class="stack">
        <h3>${words.calibrate}</h3>
        <${Form} fields=${BOARD_FIELDS} onSave=${calibrate} submit=${words.send} busyWords=${words.sending} />
        ${job && html`<${JobProgress} key=${job} id=${job} done=${words.saved} onDone=${onChange} />`}
      </section>
      <section class="stack">
        <h3>${words.put}</h3>
        <${Form} fields=${FILE_FIELDS} onSave=${put} submit=${words.putSend} />
        ${saved && html`<${Notice} tone="good" title=${words.saved} />`}
      </section>
    </div>`;
}

/** Parsed here, so that a wrong file is reported before anything is sent. */
export async function readJson(file) {
  if (!file) throw new Problem({ title: words.noFile, status: 0 });
  try {
    return JSON.parse(await file.text());
  } catch {
    throw new Problem({ title: words.notJson, status: 0 });
  }
}
