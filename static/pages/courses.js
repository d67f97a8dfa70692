// The centre's course plans, and which groups follow them.
import { html, useState } from '../preact.js';
import { api } from '../api.js';
import { useData } from '../data.js';
import { may } from '../roles.js';
import { go, href } from '../router.js';
import { t } from '../texts.js';
import { Confirm } from '../parts/forms/dialog.js';
import { RowButtons } from '../parts/forms/editing.js';
import { icons } from '../parts/page/icons.js';
import { Empty, Loading, PageHead, ProblemNotice } from '../parts/page/notice.js';

const words = t.courses;

/** @param {Props} props */
export default function CoursesPage({ person }) {
  const { data, problem, reload } = useData(async () => {
    const [courses, groups] = await Promise.all([api.courses.all(), api.groups.all()]);
    return { courses, groups };
  }, []);
  const [removing, setRemoving] = useState(null);
  // Only administrators see other people's groups.
  const noneText = may(person, 'people') ? words.nobody : words.noneOfYours;
  const add = html`<a class="button main" href=${href(['courses', 'new'])}><${icons.add} />${words.add}</a>`;
  return html`
    <${PageHead} title=${words.title} lead=${words.lead}>
      <a class="button" href=${href(['groups'])}>${t.groups.all}</a>
      ${data && data.courses.length > 0 && add}
    <//>
    <${ProblemNotice} problem=${problem} onRetry=${reload} />
    <section class="card">
      ${!data && !problem && html`<${Loading} />`}
      ${data?.courses.length === 0 && html`<${Empty} title=${words.none} body=${words.noneBody}>${add}<//>`}
      ${data && data.courses.length > 0 && html`<${List} ...${data} noneText=${noneText} onRemove=${setRemoving} />`}
    </section>
    ${removing && html`<${Confirm} title=${t.people.removeTitle(removing.name)} body=${words.removeBody} yes=${t.form.remove}
      onYes=${() => api.courses.remove(removing.id).then(reload)} onClose=${() => setRemoving(null)} />`}`;
}

const List = ({ courses, groups, noneText, onRemove }) => html`
  <div class="scroll"><table class="table">
    <thead><tr><th scope="col">${words.plan}</th><th scope="col" class="third">${words.steps}</th>
      <th scope="col">${words.followers}</th><td></td></tr></thead>
    <tbody>${courses.map(course => html`<tr key=${course.id}>
      <th scope="row"><a class="cover" href=${href(['courses', course.id])}>${course.name}</a></th>
      <td class="third">${course.steps.map(step => step.task.name).join(', ')}</td>
      <td><${Followers} groups=${groups.filter(group => group.course?.id === course.id)} noneText=${noneText} /></td>
      <td><${RowButtons} item=${course} onEdit=${course.may_change && (() => go(['courses', course.id]))}
        onRemove=${course.may_change && onRemove} /></td></tr>`)}</tbody>
  </table></div>`;

const Followers = ({ groups, noneText }) =>
  groups.length ? html`<ul>${groups.map(group => html`<li key=${group.id}><a href=${href(['groups', group.id])}>${group.name}</a></li>`)}</ul>`
    : html`<span class="muted">${noneText}</span>`;
