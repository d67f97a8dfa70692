// All exams that the caller may see, with a filter by state; staff plan a new one here.
import { html, useState } from '../preact.js';
import { api } from '../api.js';
import { useData, usePages } from '../data.js';
import { may } from '../roles.js';
import { go, href, replace } from '../router.js';
import { t } from '../texts.js';
import { ExamList } from '../parts/exams/exam_list.js';
import { Dialog } from '../parts/forms/dialog.js';
import { Field, Form } from '../parts/forms/form.js';
import { Empty, Loading, PageHead, ProblemNotice } from '../parts/page/notice.js';

const words = t.exams;
const STATES = /** @type {const} */ (['planned', 'running', 'closed', 'cancelled']);

/** @param {Props} props */
export default function Exams({ person, route }) {
  const state = STATES.find(one => one === route.query.get('state'));
  const isStaff = may(person, 'edit_trainees');
  const [planning, setPlanning] = useState(isStaff && route.query.has('plan'));
  const list = usePages((cursor, signal) => api.exams.page({ state, cursor }, signal), [state]);
  return html`
    <${PageHead} title=${words.title} lead=${words.lead}>
      ${isStaff && html`<a class="button" href=${href(['trainees'])}>${t.nav.trainees}</a>
        <button class="button main" type="button" onClick=${() => setPlanning(true)}>${words.plan}</button>`}
    <//>
    <section class="card list">
      <div class="filters"><${Field} type="select" label=${words.state} value=${state ?? ''}
        options=${[['', words.all], ...STATES.map(one => [one, words.states[one]])]}
        onInput=${event => replace(['exams'], { state: event.target.value || undefined })} /></div>
      <${ProblemNotice} problem=${list.problem} onRetry=${list.more} />
      ${!list.items && !list.problem && html`<${Loading} />`}
      ${list.items?.length === 0 && html`<${Empty} title=${words.none} body=${isStaff ? words.noneBody : ''} />`}
      ${list.items && html`<${ExamList} exams=${list.items} withNames=${isStaff} />`}
      ${list.next && html`<p class="body"><button class="button" type="button" onClick=${list.more}>${words.more}</button></p>`}
    </section>
    ${planning && html`<${PlanDialog} trainee=${route.query.get('trainee')} onClose=${() => setPlanning(false)} />`}`;
}

/** @param {Props} props */
function PlanDialog({ trainee, onClose }) {
  const { data, problem, reload } = useData(async () => {
    const [trainees, tasks, boxes] = await Promise.all([api.trainees.all(), api.tasks.all(), api.boxes.all()]);
    return { trainees, tasks, boxes };
  }, []);
  const options = list => [['', t.target.choose], ...list.map(one => [one.id, one.name])];
  const fields = data && [
    { name: 'trainee', label: t.target.trainee, type: 'select', required: true, value: trainee ?? '', options: options(data.trainees) },
    { name: 'task', label: t.target.task, type: 'select', required: true, value: '', options: options(data.tasks), hint: words.taskHint },
    { name: 'box', label: t.target.box, type: 'select', required: true, value: '', options: options(data.boxes) },
    { name: 'attempts', label: words.allowed, type: 'select', value: '1', options: ['1', '2', '3'].map(one => [one, one]), hint: words.allowedHint },
    { name: 'day', label: words.day, hint: words.dayHint, type: 'date', optional: true },
  ];
  const save = async ({ attempts, day, ...ids }) => {
    const exam = await api.exams.plan({ ...ids, attempts: Number(attempts), ...(day && { day }) });
    go(['exams', exam.id]);
  };
  return html`
    <${Dialog} title=${words.plan} onClose=${onClose}>
      <p>${words.planBody}</p>
      <${ProblemNotice} problem=${problem} onRetry=${reload} />
      ${!data && !problem && html`<${Loading} />`}
      ${fields && html`<${Form} fields=${fields} submit=${words.plan} onSave=${save} onCancel=${onClose} />`}
    <//>`;
}
