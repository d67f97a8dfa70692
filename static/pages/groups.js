// The groups that the signed-in person may see; for administrators also the cohorts that others are compared with.
import { html, useState } from '../preact.js';
import { api } from '../api.js';
import { useData } from '../data.js';
import { may } from '../roles.js';
import { href } from '../router.js';
import { t } from '../texts.js';
import { Cohorts } from '../parts/people/cohorts.js';
import { Confirm, Dialog } from '../parts/forms/dialog.js';
import { Form } from '../parts/forms/form.js';
import { AddButton } from '../parts/forms/editing.js';
import { Empty, Loading, PageHead, ProblemNotice } from '../parts/page/notice.js';

const words = t.groups;

/** @param {Props} props */
export default function GroupsPage({ person }) {
  const { data: groups, problem, reload } = useData(() => api.groups.all(), []);
  const [open, setOpen] = useState(null);
  const isAdministrator = may(person, 'people');
  const close = () => setOpen(null);
  const create = ({ name }) => api.groups.create({ name }).then(() => (close(), reload()));
  return html`
    <${PageHead} title=${words.title} lead=${words.lead}>
      <a class="button" href=${href(['courses'])}>${t.courses.open}</a>
      <a class="button" href=${href(['enrol'])}>${words.enrol}</a>
      <${AddButton} label=${words.add} onClick=${() => setOpen('new')} />
    <//>
    <div class="stack">
      <${ProblemNotice} problem=${problem} onRetry=${reload} />
      <section class="card">
        ${!groups && !problem && html`<${Loading} />`}
        ${groups?.length === 0 && html`<${Empty} title=${words.none} body=${isAdministrator ? words.noneBody : words.noneOfYours} />`}
        ${groups && groups.length > 0 && html`<${List} groups=${groups} onRemove=${isAdministrator && setOpen} />`}
      </section>
      ${isAdministrator && groups && html`<${Cohorts} groups=${groups} />`}
    </div>
    ${open === 'new' && html`<${Dialog} title=${words.add} onClose=${close}>
      <${Form} fields=${[{ name: 'name', label: words.name, required: true, maxlength: 100 }]} onSave=${create} onCancel=${close} /><//>`}
    ${open?.id && html`<${Confirm} title=${words.removeTitle(open.name)} body=${words.removeBody} yes=${words.remove}
      onYes=${() => api.groups.remove(open.id).then(reload)} onClose=${close} />`}`;
}

const List = ({ groups, onRemove }) => html`
  <div class="scroll"><table class="table">
    <thead><tr><th scope="col">${words.group}</th><th scope="col" class="number">${words.trainees}</th><th scope="col" class="second">${t.courses.ofGroup}</th>${onRemove && html`<td></td>`}</tr></thead>
    <tbody>${groups.map(group => html`<tr key=${group.id}>
      <th scope="row"><a class="cover" href=${href(['groups', group.id])}>${group.name}</a></th>
      <td class="number">${group.trainees.length}</td>
      <td class="second">${group.course ? html`<a href=${href(['courses', group.course.id])}>${group.course.name}</a>` : '–'}</td>
      ${onRemove && html`<td><div class="row ends"><button class="button bare" type="button" aria-label=${`${words.remove}: ${group.name}`}
        onClick=${() => onRemove(group)}>${words.remove}</button></div></td>`}</tr>`)}</tbody>
  </table></div>`;
