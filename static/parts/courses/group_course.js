// The course of a group: the plan that it follows, the progress of its trainees, and a dialog to choose another plan.
import { html, useState } from '../../preact.js';
import { api } from '../../api.js';
import { useData, useThrottled } from '../../data.js';
import { calendarDay } from '../../format.js';
import { useLive } from '../../live.js';
import { href } from '../../router.js';
import { t } from '../../texts.js';
import { CourseTable } from './course_table.js';
import { Confirm, Dialog } from '../forms/dialog.js';
import { Form } from '../forms/form.js';
import { Empty, Loading, ProblemNotice } from '../page/notice.js';

const words = t.courses;
const RELOAD_MS = 3_000;

/**
 * `plans`: those that can be chosen. `onChange()` runs when the group follows another plan, or none.
 *
 * @param {Props} props
 */
export function GroupCourse({ group, plans, onChange }) {
  const [open, setOpen] = useState(null);
  const close = () => setOpen(null);
  const { course } = group;
  return html`
    <section class="card course">
      <header>
        <div><h2>${words.ofGroup}</h2>
          ${course && html`<p class="small muted">${course.name} · ${words.firstDay(calendarDay(course.begins))}</p>`}</div>
        ${course && html`<div class="row">
          <button class="button" type="button" aria-label=${words.changeOf(course.name)} onClick=${() => setOpen('choose')}>${words.change}</button>
          <button class="button bare" type="button" aria-label=${words.endOf(course.name)} onClick=${() => setOpen('end')}>${words.end}</button>
        </div>`}
      </header>
      ${course ? html`<${CourseProgress} group=${group} key=${`${course.id} ${course.begins}`} />` : plans.length ? html`
        <${Empty} title=${words.notFollowed} body=${words.notFollowedBody}>
          <button class="button" type="button" onClick=${() => setOpen('choose')}>${words.follow}</button><//>` : html`
        <${Empty} title=${words.notFollowed} body=${words.noneBody}><a class="button" href=${href(['courses', 'new'])}>${words.add}</a><//>`}
    </section>
    ${open === 'choose' && html`<${FollowDialog} group=${group} plans=${plans} onSaved=${() => (close(), onChange())} onClose=${close} />`}
    ${open === 'end' && html`<${Confirm} title=${words.endTitle(course?.name)} body=${words.endBody} yes=${words.end}
      onYes=${() => api.groups.unfollow(group.id).then(onChange)} onClose=${close} />`}`;
}

/** @param {Props} props */
function CourseProgress({ group }) {
  const { data, problem, reload } = useData(signal => api.groups.course(group.id, signal), [group.id, group.trainees?.join()]);
  const reloadSoon = useThrottled(reload, RELOAD_MS);
  useLive('session', event => event.status === 'done' && reloadSoon());
  useLive('resync', reloadSoon);
  return html`
    <${ProblemNotice} problem=${problem} onRetry=${reload} />
    ${!data && !problem && html`<${Loading} />`}
    ${data?.rows.length === 0 && html`<${Empty} title=${t.groups.empty} body=${words.empty} />`}
    ${data && data.rows.length > 0 && html`<${CourseTable} group=${group} course=${data} />`}
    ${data?.more && html`<p class="body small muted">${t.groups.more(data.rows.length)}</p>`}`;
}

/** @param {Props} props */
function FollowDialog({ group, plans, onSaved, onClose }) {
  const { course } = group;
  const fields = [
    { name: 'course', label: words.plan, type: 'select', required: true, value: course?.id ?? '',
      options: [['', t.target.choose], ...plans.map(plan => [plan.id, plan.name])] },
    { name: 'begins', label: words.begins, hint: words.beginsHint, type: 'date', required: true, value: course?.begins ?? today() },
  ];
  const save = chosen => api.groups.follow(group.id, chosen).then(onSaved);
  return html`<${Dialog} title=${words.follow} onClose=${onClose}><${Form} fields=${fields} onSave=${save} onCancel=${onClose} /><//>`;
}

/** Today's date on the device, as a date input takes it. */
function today() {
  const now = new Date();
  return [now.getFullYear(), now.getMonth() + 1, now.getDate()].map(part => String(part).padStart(2, '0')).join('-');
}
