// Links between accounts here and at the provider of single sign-on: those of the own account, and those of all people.
import { html, useState } from '../../preact.js';
import { api } from '../../api.js';
import { asProblem } from '../../data.js';
import { dateTime } from '../../format.js';
import { t } from '../../texts.js';
import { Confirm } from '../forms/dialog.js';
import { Form } from '../forms/form.js';
import { Empty, ProblemNotice } from '../page/notice.js';
import { openProvider, useSetUp } from './provider_button.js';

const words = t.singleSignOn;

/** Asked for again: a stranger at an open browser must not link an account. */
const PASSWORD = { name: 'password', label: words.ownPassword, type: 'password', required: true, autocomplete: 'current-password' };

/** The provider's accounts that sign in to the own account. @param {Props} props */
export function OwnIdentities({ person, items, onChange }) {
  const { is_set_up: isSetUp, name } = useSetUp();
  const [problem, setProblem] = useState(null);
  if (!isSetUp && items.length === 0) return null;
  const fail = error => setProblem(asProblem(error));
  return html`
    <section class="card">
      <header><h2>${words.title}</h2></header>
      <${ProblemNotice} problem=${problem} />
      ${items.length === 0 ? html`
        <div class="body stack"><p>${words.linkLead}</p>
          <${Form} fields=${person.has_password ? [PASSWORD] : []} submit=${words.link(name)}
            onSave=${({ password }) => openProvider(api.singleSignOn.startLink(password))} /></div>`
        : html`<${Identities} items=${items} nameOf=${identity => identity.label}
          onRemove=${person.has_password && (id => api.singleSignOn.removeOwn(id).then(onChange, fail))} />`}
    </section>`;
}

/** The links of all people, for administrators. @param {Props} props */
export function AllIdentities({ data, onChange }) {
  const { is_set_up: isSetUp } = useSetUp();
  const [problem, setProblem] = useState(null);
  if (!isSetUp && data.identities.length === 0) return null;
  const nameOf = identity => data.people.find(one => one.id === identity.person)?.name ?? identity.label;
  return html`
    <section class="card">
      <header><h2>${words.title}</h2></header>
      <${ProblemNotice} problem=${problem} />
      ${data.identities.length === 0 ? html`<${Empty} title=${words.none} body=${words.noneBody} />`
        : html`<${Identities} items=${data.identities} nameOf=${nameOf}
          onRemove=${id => api.singleSignOn.remove(id).then(onChange, error => setProblem(asProblem(error)))} />`}
    </section>`;
}

/** Without `onRemove`, they cannot be removed: the account could not sign in any more. @param {Props} props */
function Identities({ items, nameOf, onRemove }) {
  const [removing, setRemoving] = useState(null);
  return html`
    <ul class="queue">
      ${items.map(item => html`
        <li key=${item.id}>
          <div><strong>${nameOf(item)}</strong>
            <span class="small muted">${words.at(item.label, new URL(item.issuer).host)} ·
              ${' '}${item.follows_groups ? words.followsGroups : words.linked} ·
              ${' '}${item.last_used_at ? t.account.lastUsed(dateTime(item.last_used_at)) : t.account.neverUsed}</span></div>
          ${onRemove && html`<button class="button bare" type="button" aria-label=${`${words.remove}: ${nameOf(item)}`}
            onClick=${() => setRemoving(item)}>${words.remove}</button>`}
        </li>`)}
    </ul>
    ${removing && html`<${Confirm} title=${words.removeTitle(nameOf(removing))} body=${words.removeBody} yes=${words.remove}
      onYes=${() => onRemove(removing.id)} onClose=${() => setRemoving(null)} />`}`;
}
