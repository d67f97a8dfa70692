// The trainees that the signed-in person may see.
import { html, useState } from '../preact.js';
import { api } from '../api.js';
import { useData } from '../data.js';
import { may } from '../roles.js';
import { href } from '../router.js';
import { t } from '../texts.js';
import { Field } from '../parts/forms/form.js';
import { AddButton, RowButtons, saveChanges, useEditing } from '../parts/forms/editing.js';
import { LacksConsent } from '../parts/people/consent.js';
import { EraseDialog, PendingErasures } from '../parts/people/erasures.js';
import { Empty, Loading, PageHead, ProblemNotice } from '../parts/page/notice.js';

const words = t.trainees;
const withUnset = names => [['', words.unset], ...Object.entries(names)];

/** @param {Props} props */
export default function Trainees({ person }) {
  const mayEdit = may(person, 'edit_trainees');
  const { data, problem, reload } = useData(async () => {
    // Instructors may not list groups.
    const [trainees, groups, pending] = await Promise.all([
      api.trainees.all(), api.groups.all().catch(() => []), mayEdit ? api.trainees.pending() : []]);
    return { trainees, groups, pending };
  }, []);
  const [searchText, setSearchText] = useState('');
  const [erasing, setErasing] = useState(null);
  const fields = item => [
    { name: 'name', label: words.name, required: true, maxlength: 100, value: item?.name },
    { name: 'code', label: words.code, hint: words.codeHint, maxlength: 60, value: item?.code },
    { name: 'level', label: words.level, type: 'select', options: withUnset(words.levels), value: item?.level },
    {
      name: 'handedness',
      label: words.handedness,
      type: 'select',
      options: withUnset(words.hands),
      value: item?.handedness,
    },
    ...(!item && data?.groups.length
      ? [
          {
            name: 'group',
            label: words.group,
            type: 'select',
            options: [['', words.unset], ...data.groups.map(group => [group.id, group.name])],
          },
        ]
      : []),
  ];
  const edit = useEditing({
    addTitle: words.add,
    editTitle: words.edit,
    fields,
    save: (item, values) => saveChanges(api.trainees, item, values),
    onChange: reload,
  });
  const shown =
    data?.trainees.filter(trainee => `${trainee.name} ${trainee.code}`.toLowerCase().includes(searchText.toLowerCase())) ??
    [];
  return html`
    <${PageHead} title=${words.title} lead=${words.lead}><a class="button" href=${href(['exams'])}>${t.exams.title}</a>
      <a class="button" href=${href(['certificates'])}>${t.certificates.open}</a>${mayEdit && html`<a class="button" href=${href(['invite'])}>${t.invitations.open}</a>`}${mayEdit && data && html`<${AddButton} label=${words.add}
      onClick=${edit.add} />`}<//>
    <${ProblemNotice} problem=${problem} onRetry=${reload} />
    <section class="card">
      ${!data && !problem && html`<${Loading} />`}
      ${data && data.trainees.length === 0 && html`<${Empty} title=${words.none} body=${words.noneBody} />`}
      ${data && data.trainees.length > 0 && html`
        <div class="filters"><${Field} label=${words.find} type="search" value=${searchText}
          onInput=${event => setSearchText(event.target.value)} /></div>
        <div class="scroll">
          <table class="table">
            <thead>
              <tr>
                <th scope="col">${words.name}</th><th scope="col">${words.code}</th><th scope="col">${words.level}</th>
                  <th scope="col">${words.handedness}</th>
                ${mayEdit && html`<td></td>`}
              </tr>
            </thead>
            <tbody>
              ${shown.map(trainee => html`
                <tr key=${trainee.id}>
                  <th scope="row"><a class="cover" href=${href(['trainees', trainee.id])}>${trainee.name}</a><${LacksConsent} state=${trainee.consent} /></th>
                  <td class="code">${trainee.code}</td>
                  <td>${(trainee.level && words.levels[trainee.level]) ?? '–'}</td>
                  <td>${(trainee.handedness && words.hands[trainee.handedness]) ?? '–'}</td>
                  ${mayEdit && html`<td><${RowButtons} item=${trainee} onEdit=${edit.change}
                    onRemove=${trainee.may_erase && setErasing} /></td>`}
                </tr>`)}
            </tbody>
          </table>
        </div>`}
    </section>
    ${data && html`<${PendingErasures} pending=${data.pending} onChange=${reload} />`}
    ${erasing && html`<${EraseDialog} trainee=${erasing} onErased=${reload} onClose=${() => setErasing(null)} />`}
    ${edit.dialogs}`;
}
