// The exercises that are recorded.
import { html, useState } from '../preact.js';
import { api } from '../api.js';
import { useData } from '../data.js';
import { may } from '../roles.js';
import { href } from '../router.js';
import { t } from '../texts.js';
import { formTitle } from '../translate.js';
import { AddButton, RowButtons, saveChanges, useEditing } from '../parts/forms/editing.js';
import { ownerGroups, ownersField } from '../parts/forms/owners.js';
import { SkillModel } from '../parts/tasks/skill_model.js';
import { Empty, Loading, PageHead, ProblemNotice } from '../parts/page/notice.js';
import { RatersDialog } from '../parts/tasks/raters.js';

const words = t.tasks;

/** @param {Props} props */
export default function Tasks({ person }) {
  const { data, problem, reload } = useData(async () => {
    const [tasks, groups, forms] = await Promise.all([api.tasks.all(), ownerGroups(person), api.ratingForms()]);
    return { tasks, groups, forms };
  }, []);
  const tasks = data?.tasks;
  const mayEdit = may(person, 'edit_tasks');
  const [ratedTask, setRatedTask] = useState(null);
  const fields = item => [
    { name: 'name', label: words.name, required: true, maxlength: 100, value: item?.name },
    { name: 'code', label: words.code, hint: t.trainees.codeHint, maxlength: 60, value: item?.code },
    { name: 'description', label: words.description, type: 'textarea', value: item?.description, wide: true },
    { name: 'rating_forms', label: words.forms, hint: words.formsHint, type: 'checks',
      options: (data?.forms ?? []).map(form => [form.form, formTitle(form)]), value: item?.rating_forms ?? (data?.forms ?? []).map(form => form.form) },
    ...ownersField(data?.groups ?? [], item, person),
  ];
  const edit = useEditing({
    addTitle: words.add,
    editTitle: words.edit,
    removeTitle: t.people.removeTitle,
    fields,
    save: (item, values) => saveChanges(api.tasks, item, values),
    remove: item => api.tasks.remove(item.id),
    onChange: reload,
  });
  return html`
    <${PageHead} title=${words.title} lead=${words.lead}>${mayEdit && data && html`<${AddButton} label=${words.add}
      onClick=${edit.add} />`}<//>
    <${ProblemNotice} problem=${problem} onRetry=${reload} />
    <section class="card">
      ${!tasks && !problem && html`<${Loading} />`}
      ${tasks?.length === 0 && html`<${Empty} title=${words.none} body=${words.noneBody} />`}
      ${tasks && tasks.length > 0 && html`
        <div class="scroll">
          <table class="table">
            <thead><tr><th scope="col">${words.name}</th><th scope="col">${words.code}</th><th scope="col" class="third">
              ${words.description}</th><th scope="col">${words.model.title}</th><td></td></tr></thead>
            <tbody>
              ${tasks.map(task => html`
                <tr key=${task.id}>
                  <th scope="row"><a class="cover" href=${href(['tasks', task.id])}>${task.name}</a></th>
                  <td class="code">${task.code}</td>
                  <td class="muted third">${task.description}</td>
                  <td><${SkillModel} task=${task} mayTrain=${may(person, 'people')} /></td>
                  <td><div class="row ends">${may(person, 'rate') && html`<button class="button" type="button"
                    aria-label=${t.raters.title(task.name)} onClick=${() => setRatedTask(task)}>${t.raters.open}</button>`}
                    ${task.may_change && html`<${RowButtons} item=${task} onEdit=${edit.change}
                      onRemove=${may(person, 'people') && edit.remove} />`}</div></td>
                </tr>`)}
            </tbody>
          </table>
        </div>`}
    </section>
    ${ratedTask && html`<${RatersDialog} task=${ratedTask} onClose=${() => setRatedTask(null)} />`}
    ${edit.dialogs}`;
}
