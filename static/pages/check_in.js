// Check in at a box: the page behind the QR code that the box's screen shows. The code is the part of the address after
// `#`, so that no log has it.
import { html, useState } from '../preact.js';
import { api } from '../api.js';
import { asProblem, useData } from '../data.js';
import { href } from '../router.js';
import { t } from '../texts.js';
import { Field } from '../parts/forms/form.js';
import { Loading, Notice, PageHead, ProblemNotice } from '../parts/page/notice.js';
import { traineeId } from '../parts/page/shell.js';

const words = t.checkIn;

/** @param {Props} props */
export default function CheckIn({ person, route }) {
  const [code] = useState(location.hash.slice(1));
  const key = route.query.get('box') ?? '';
  const { data, problem } = useData(async () => {
    const [box, tasks] = await Promise.all([api.boxes.get(key), api.tasks.all()]);
    return { box, tasks };
  }, [key]);
  const [task, setTask] = useState('');
  const [refused, setRefused] = useState(null);
  const [isIn, setIn] = useState(false);
  const [busy, setBusy] = useState(false);
  if (traineeId(person) === null)
    return html`<${PageHead} title=${words.title} /><${Notice} tone="warn" title=${words.onlyTrainees}>
      <a href=${href(['boxes'])}>${t.nav.boxes}</a><//>`;
  if (!data) return html`<${PageHead} title=${words.title} />${problem ? html`<${ProblemNotice} problem=${problem} />` : html`<${Loading} />`}`;
  const { box, tasks } = data;
  const send = async (request, after) => {
    setBusy(true);
    setRefused(null);
    await request().then(() => setIn(after), error => setRefused(asProblem(error)));
    setBusy(false);
  };
  const checkIn = event => {
    event.preventDefault();
    send(() => api.boxes.checkIn(box.id, { code, task: task || undefined }), true);
  };
  if (refused?.type.endsWith('/consent-missing'))
    return html`<${PageHead} title=${words.title} lead=${box.name} />
      <${Notice} tone="warn" title=${words.noConsent}>${words.noConsentBody} <a href=${href(['account'])}>${words.toConsent}</a><//>`;
  if (isIn)
    return html`<${PageHead} title=${words.title} lead=${box.name} />
      <div class="stack">
        <${ProblemNotice} problem=${refused} />
        <${Notice} tone="good" title=${words.done(box.name)}>${words.doneBody}<//>
        <p><button class="button" type="button" disabled=${busy} onClick=${() => send(() => api.boxes.checkOut(box.id), false)}>${words.leave}</button></p>
      </div>`;
  return html`
    <${PageHead} title=${words.title} lead=${words.lead(box.name)} />
    <form class="stack" onSubmit=${checkIn}>
      <${ProblemNotice} problem=${refused} />
      <${Field} type="select" label=${words.task} hint=${words.taskHint} value=${task}
        options=${[['', words.later], ...tasks.map(one => [one.id, one.name])]} onInput=${event => setTask(event.target.value)} />
      <p><button class="button main" disabled=${busy}>${words.submit}</button></p>
    </form>`;
}
