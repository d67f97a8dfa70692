// Reference groups (cohorts): list, create, edit, delete. For administrators.
import { html, useState } from '../../preact.js';
import { api } from '../../api.js';
import { useData } from '../../data.js';
import { t } from '../../texts.js';
import { Confirm, Dialog } from '../forms/dialog.js';
import { Form } from '../forms/form.js';
import { AddButton, RowButtons } from '../forms/editing.js';
import { Empty, Loading, ProblemNotice } from '../page/notice.js';

const words = t.cohorts;
const withAny = names => [['', words.any], ...Object.entries(names)];

export function Cohorts({ groups }) {
  const { data, problem, reload } = useData(async () => {
    const [cohorts, trainees] = await Promise.all([api.cohorts.all(), api.trainees.all()]);
    return { cohorts, trainees };
  }, []);
  const [open, setOpen] = useState(null);
  const close = () => setOpen(null);
  const finish = () => (close(), reload());
  const change = async cohort => setOpen({ cohort, members: cohort.listed ? await api.cohorts.members(cohort.id) : [] });
  const save = values => {
    const sent = cohortRequest(values);
    return (open.cohort ? api.cohorts.replace(open.cohort.id, sent) : api.cohorts.create(sent)).then(finish);
  };
  const describeCohort = cohort => describe(cohort, groups);
  return html`
    <section class="card">
      <header><div><h2>${words.title}</h2><p class="small muted">${words.lead}</p></div>
        ${data && html`<${AddButton} label=${words.add} onClick=${() => setOpen({})} />`}</header>
      <${ProblemNotice} problem=${problem} onRetry=${reload} />
      ${!data && !problem && html`<${Loading} />`}
      ${data?.cohorts.length === 0 && html`<${Empty} title=${words.none} body=${words.noneBody} />`}
      ${data && data.cohorts.length > 0 && html`<div class="scroll"><table class="table">
        <thead><tr><th scope="col">${words.name}</th><th scope="col">${words.who}</th><th scope="col" class="number">${words.people}</th><td></td></tr></thead>
        <tbody>${data.cohorts.map(cohort => html`<tr key=${cohort.id}>
          <th scope="row">${cohort.name}<small class="code">${cohort.code}</small></th><td>${describeCohort(cohort)}</td>
          <td class="number">${cohort.people}</td>
          <td><${RowButtons} item=${cohort} onEdit=${change} onRemove=${() => setOpen({ removing: cohort })} /></td></tr>`)}</tbody>
      </table></div>`}
      ${data && open && !open.removing && html`<${Dialog} title=${open.cohort ? words.edit : words.add} onClose=${close}>
        <${Form} fields=${fields(open, data, groups)} onSave=${save} onCancel=${close} /><//>`}
      ${open?.removing && html`<${Confirm} title=${t.people.removeTitle(open.removing.name)} body=${words.removeBody} yes=${t.form.remove}
        onYes=${() => api.cohorts.remove(open.removing.id).then(reload)} onClose=${close} />`}
    </section>`;
}

function describe(cohort, groups) {
  if (cohort.listed) return words.listed;
  const group = groups.find(one => one.id === cohort.group)?.name;
  const parts = [t.trainees.levels[cohort.level], cohort.handedness && `${words.hand}: ${t.trainees.hands[cohort.handedness]}`, group];
  return parts.filter(Boolean).join(', ') || words.everybody;
}

const isListed = chosen => chosen.kind === 'listed';
const isDescribed = chosen => chosen.kind !== 'listed';

const fields = ({ cohort, members = [] }, { trainees }, groups) => [
  { name: 'name', label: words.name, required: true, maxlength: 100, value: cohort?.name },
  { name: 'code', label: words.code, hint: t.trainees.codeHint, maxlength: 60, value: cohort?.code },
  { name: 'kind', label: words.kind, type: 'select', options: Object.entries(words.kinds), value: cohort?.listed ? 'listed' : 'described', wide: true },
  { name: 'level', label: words.level, type: 'select', options: withAny(t.trainees.levels), value: cohort?.level ?? '', when: isDescribed },
  { name: 'handedness', label: words.hand, type: 'select', options: withAny(t.trainees.hands), value: cohort?.handedness ?? '', when: isDescribed },
  { name: 'group', label: words.group, type: 'select', options: [['', words.any], ...groups.map(one => [one.id, one.name])],
    value: cohort?.group ?? '', when: isDescribed },
  { name: 'members', label: words.members, type: 'checks', options: trainees.map(one => [one.id, one.name]), value: members, when: isListed },
];

/** A cohort is a list or a description, never both. */
function cohortRequest({ kind, name, code, members, ...description }) {
  return kind === 'listed' ? { name, code, members } : { name, code, ...description };
}
