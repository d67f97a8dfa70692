// Administration of people, groups and tokens.
import { html, useState } from '../preact.js';
import { api } from '../api.js';
import { useData } from '../data.js';
import { href } from '../router.js';
import { t } from '../texts.js';
import { Groups, Tokens } from '../parts/people/groups_tokens.js';
import { refuseRepeats } from '../parts/people/new_password.js';
import { NewLinkDialog, PasswordLinks } from '../parts/people/password_links.js';
import { AllIdentities } from '../parts/people/single_sign_on.js';
import { AddButton, RowButtons, saveChanges, useEditing } from '../parts/forms/editing.js';
import { Empty, Loading, PageHead, ProblemNotice } from '../parts/page/notice.js';

const words = t.people;

const isTrainee = chosen => chosen.role === 'trainee';
/** What a person still has to do about the password; an own password needs no words. */
const passwordWords = ({ id, password }, identities) => {
  if (password === 'own') return null;
  if (password !== 'missing') return words.passwordStates.change;
  return identities.some(identity => identity.person === id) ? t.singleSignOn.title : words.passwordStates.missing;
};

/** The account of a trainee keeps its role: it belongs to the trainee whose recordings it shows. */
function rolesFor(item) {
  const all = Object.entries(t.roles);
  if (!item) return all;
  return all.filter(([role]) => (item.role === 'trainee') === (role === 'trainee'));
}

/** @param {Props} props */
export default function People({ person }) {
  const [linked, setLinked] = useState(null); // the person who gets a link
  const { data, problem, reload } = useData(async () => {
    const [people, groups, tokens, trainees, boxes, links, identities] = await Promise.all([
      api.people.all(),
      api.groups.all(),
      api.tokens.all(),
      api.trainees.all(),
      api.boxes.all(),
      api.passwordLinks.all(),
      api.singleSignOn.all(),
    ]);
    return { people, groups, tokens, trainees, boxes, links, identities };
  }, []);
  const fields = item => [
    { name: 'name', label: words.name, required: true, maxlength: 100, value: item?.name, autocomplete: 'off' },
    ...(item
      ? []
      : [
          {
            name: 'login',
            label: words.login,
            required: true,
            autocapitalize: 'none',
            autocomplete: 'off',
            spellcheck: false,
          },
        ]),
    {
      name: 'role',
      label: words.role,
      type: 'select',
      hint: item && !isTrainee(item) ? words.roleHint : undefined,
      options: rolesFor(item),
      value: item?.role ?? 'instructor',
    },
    ...(item
      ? []
      : [
          {
            name: 'access',
            label: words.access,
            type: 'select',
            options: [['link', words.byLink], ['password', words.byPassword]],
            value: 'link',
          },
        ]),
    {
      name: 'password',
      when: chosen => item || chosen.access === 'password',
      label: item ? words.newPassword : words.password,
      type: 'password',
      hint: item ? (item.id === person.id ? words.ownPasswordHint : words.newPasswordHint) : words.passwordHint,
      required: !item,
      minlength: 10,
      autocomplete: 'new-password',
    },
    ...(item
      ? []
      : [
          {
            name: 'trainee',
            label: words.trainee,
            type: 'select',
            required: true,
            options: [['', t.target.choose], ...(data?.trainees ?? []).map(one => [one.id, one.name])],
            when: isTrainee,
          },
        ]),
    ...(!item && data?.groups.length
      ? [
          {
            name: 'groups',
            when: chosen => chosen.role === 'instructor',
            label: words.groups,
            type: 'checks',
            options: data.groups.map(group => [group.id, group.name]),
          },
        ]
      : []),
  ];
  const edit = useEditing({
    addTitle: words.add,
    editTitle: words.edit,
    removeTitle: words.removeTitle,
    removeBody: words.removeAccountBody,
    fields,
    save: async (item, { access, ...values }) => {
      if (values.password) refuseRepeats(values.password);
      const chosenFor = values.password && item?.id !== person.id ? { must_change_password: true } : {};
      const saved = await saveChanges(api.people, item, { ...values, ...chosenFor });
      if (access === 'link') setLinked(saved);
    },
    remove: item => api.people.remove(item.id),
    onChange: reload,
  });
  return html`
    <${PageHead} title=${words.title} lead=${words.lead}><a class="button" href=${href(['consent'])}>${t.consentTexts.title}</a><a class="button" href=${href(['service'])}>${t.nav.service}</a>${data && html`<${AddButton} label=${words.add}
      onClick=${edit.add} />`}<//>
    <${ProblemNotice} problem=${problem} onRetry=${reload} />
    ${!data && !problem && html`<${Loading} />`}
    ${data && html`
      <div class="stack">
        <section class="card">
          ${data.people.length === 0 ? html`<${Empty} title=${words.none} body=${words.noneBody} />` : html`
            <div class="scroll">
              <table class="table">
                <thead><tr><th scope="col">${words.name}</th><th scope="col">${words.login}</th><th scope="col">
                  ${words.role}</th><td></td></tr></thead>
                <tbody>
                  ${data.people.map(one => html`
                    <tr key=${one.id}>
                      <th scope="row">${one.name}${passwordWords(one, data.identities) && html` <span class="pill">${passwordWords(one, data.identities)}</span>`}</th><td class="code">${one.login}</td><td>
                        ${t.roles[one.role] ?? one.role}</td>
                      <td><div class="row ends"><button class="button" type="button" aria-label=${words.linkOf(one.name)}
                        onClick=${() => setLinked(one)}>${words.link}</button>
                        <${RowButtons} item=${one} onEdit=${edit.change} onRemove=${edit.remove} /></div></td>
                    </tr>`)}
                </tbody>
              </table>
            </div>`}
        </section>
        <div class="columns">
          <${Groups} data=${data} onChange=${reload} />
          <${Tokens} data=${data} onChange=${reload} />
          <${PasswordLinks} data=${data} onChange=${reload} />
          <${AllIdentities} data=${data} onChange=${reload} />
        </div>
      </div>`}
    ${edit.dialogs}
    ${linked && html`<${NewLinkDialog} of=${linked} onClose=${() => (setLinked(null), reload())} />`}`;
}
