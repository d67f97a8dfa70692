// Groups (which instructor sees which trainees) and tokens (programs that sign in without a password).
import { html, useState } from '../../preact.js';
import { api } from '../../api.js';
import { href } from '../../router.js';
import { t } from '../../texts.js';
import { Confirm, Dialog } from '../forms/dialog.js';
import { Form } from '../forms/form.js';
import { icons } from '../page/icons.js';
import { Empty } from '../page/notice.js';
import { TokenDates } from './own_access.js';

const words = t.people;
const idOf = member => member?.id ?? member;

export function Groups({ data, onChange }) {
  const [open, setOpen] = useState(null);
  const close = () => setOpen(null);
  const finish = () => (close(), onChange());
  const create = ({ name }) => api.groups.create({ name }).then(finish);
  return html`
    <section class="card">
      <header><h2>${words.group}</h2><button class="button" type="button" onClick=${() => setOpen('new')}>
        <${icons.add} />${words.addGroup}</button></header>
      ${data.groups.length === 0 ? html`<${Empty} title=${words.noGroups} body=${words.noGroupsBody} />` : html`
        <ul class="queue">
          ${data.groups.map(group => html`
            <li key=${group.id}><div><a href=${href(['groups', group.id])}>${group.name}</a></div>
              <button class="button" type="button" aria-label=${`${words.members}: ${group.name}`}
                onClick=${() => setOpen(group)}>${words.members}</button></li>`)}
        </ul>`}
      ${open === 'new' && html`<${Dialog} title=${words.addGroup} onClose=${close}>
        <${Form} fields=${[{ name: 'name', label: words.name, required: true }]} onSave=${create}
        onCancel=${close} /><//>`}
      ${open && open !== 'new' && html`<${MembersDialog} group=${open} data=${data} onSaved=${finish} onClose=${close} />`}
    </section>`;
}

/** Who is in a group, all at once. `data`: the people and trainees to choose from. @param {Props} props */
export function MembersDialog({ group, data, onSaved, onClose }) {
  const save = ({ instructors, trainees }) => api.groups.setMembers(group.id, { instructors, trainees }).then(onSaved);
  return html`
    <${Dialog} title=${`${words.members}: ${group.name}`} onClose=${onClose}>
      <${Form} fields=${memberFields(group, data)} onSave=${save} onCancel=${onClose} />
    <//>`;
}

const memberFields = (group, { people, trainees }) => [
  {
    name: 'instructors',
    label: words.instructors,
    type: 'checks',
    options: people.filter(one => one.role === 'instructor').map(one => [one.id, one.name]),
    value: (group.instructors ?? []).map(idOf),
  },
  {
    name: 'trainees',
    label: t.trainees.title,
    type: 'checks',
    options: trainees.map(one => [one.id, one.name]),
    value: (group.trainees ?? []).map(idOf),
  },
];

export function Tokens({ data, onChange }) {
  const [open, setOpen] = useState(null);
  const close = () => (setOpen(null), onChange());
  const create = async ({ name, role, box, expires }) => {
    const made = await api.tokens.create({
      name,
      role,
      box,
      expires_at: expires ? new Date(expires).toISOString() : undefined,
    });
    setOpen({ made });
  };
  const fields = [
    { name: 'name', label: words.name, required: true },
    {
      name: 'role',
      label: words.role,
      type: 'select',
      options: [
        ['agent', words.agent],
        ['instructor', t.roles.instructor],
        ['administrator', t.roles.administrator],
      ],
      value: 'agent',
    },
    {
      name: 'box',
      label: words.box,
      type: 'select',
      required: true,
      options: [['', t.target.choose], ...data.boxes.map(box => [box.id, box.name])],
      when: chosen => chosen.role === 'agent',
    },
    { name: 'expires', label: words.expires, type: 'datetime-local', hint: words.expiresHint },
  ];
  return html`
    <section class="card">
      <header><h2>${words.tokens}</h2><button class="button" type="button" onClick=${() => setOpen('new')}>
        <${icons.add} />${words.addToken}</button></header>
      ${data.tokens.length === 0 ? html`<${Empty} title=${words.noTokens} body=${words.noTokensBody} />` : html`
        <ul class="queue">
          ${data.tokens.map(token => html`
            <li key=${token.id}>
              <div><strong>${token.name}</strong><span class="small muted">${t.roles[token.role] ?? words.agent} ·
                ${' '}<${TokenDates} token=${token} /></span></div>
              <button class="button bare" type="button" aria-label=${`${words.remove}: ${token.name}`}
                onClick=${() => setOpen({ removing: token })}>${words.remove}</button>
            </li>`)}
        </ul>`}
      ${open === 'new' && html`<${Dialog} title=${words.addToken} onClose=${() => setOpen(null)}>
        <${Form} fields=${fields} onSave=${create} onCancel=${() => setOpen(null)} submit=${words.addToken} /><//>`}
      ${open?.made && html`
        <${Dialog} title=${open.made.name} onClose=${close}>
          <p>${words.tokenOnce}</p><div class="secret">${open.made.token}</div>
          <div class="actions"><button class="button main" type="button" onClick=${close}>${t.form.close}</button></div>
        <//>`}
      ${open?.removing && html`<${Confirm} title=${words.removeTitle(open.removing.name)} body=${t.account.removeToken}
        yes=${words.remove} onYes=${() => api.tokens.remove(open.removing.id)} onClose=${close} />`}
    </section>`;
}
