// The signed-in person: name, login, language, a new password, signing out, other sign-ins, tokens.
import { html, useState } from '../preact.js';
import { api } from '../api.js';
import { useData } from '../data.js';
import { Confirm } from '../parts/forms/dialog.js';
import { Form } from '../parts/forms/form.js';
import { LanguageChoice } from '../parts/page/language.js';
import { Notice, PageHead, ProblemNotice } from '../parts/page/notice.js';
import { NEW_PASSWORD_FIELDS, newPassword } from '../parts/people/new_password.js';
import { AccessEntries } from '../parts/people/access_entries.js';
import { BoxPin } from '../parts/people/box_pin.js';
import { ConsentCard } from '../parts/people/consent.js';
import { OwnData } from '../parts/people/own_data.js';
import { SharedDevice } from '../parts/people/shared_device.js';
import { OwnSignIns, OwnTokens } from '../parts/people/own_access.js';
import { OwnIdentities } from '../parts/people/single_sign_on.js';
import { RetentionCard } from '../parts/people/retention.js';
import { traineeId } from '../parts/page/shell.js';
import { isRecording } from '../record/current_recording.js';
import { t } from '../texts.js';

const words = t.account;
const FIELDS = [
  { name: 'old', label: words.old, type: 'password', required: true, autocomplete: 'current-password' },
  ...NEW_PASSWORD_FIELDS,
];
/** Asked only of a person who has tokens. */
const TOKENS_FIELD = { name: 'tokens', label: words.ofTokens, hint: words.ofTokensHint, type: 'select', options: [['withdraw', words.withdrawTokens], ['keep', words.keepTokens]], value: 'withdraw' };

/** @param {Props} props */
export default function Account({ person, onSignOut }) {
  const [changed, setChanged] = useState(false);
  const [asking, setAsking] = useState(false);
  const { data, problem, reload } = useData(async signal => {
    const [signIns, tokens, identities] = await Promise.all([api.own.signIns(signal), api.own.tokens(signal), api.singleSignOn.own(signal)]);
    return { signIns: signIns.items, tokens: tokens.items, identities: identities.items };
  }, []);
  const change = async ({ old, tokens, ...values }, form) => {
    setChanged(false);
    await api.changePassword(old, newPassword(values), tokens === 'keep');
    form.reset();
    setChanged(true);
    reload(); // other sign-ins and withdrawn tokens are gone
  };
  return html`
    <${PageHead} title=${words.title}>
      <button class="button" type="button" onClick=${() => (isRecording() ? setAsking(true) : onSignOut())}>
        ${words.signOut}</button>
    <//>
    ${asking && html`<${Confirm} ...${t.record.leave} onYes=${onSignOut} onClose=${() => setAsking(false)} />`}
    <div class="columns">
      <section class="card">
        <div class="body">
          <dl class="facts">
            <dt>${words.name}</dt><dd>${person.name}</dd>
            <dt>${words.login}</dt><dd>${person.login}</dd>
            <dt>${words.role}</dt><dd>${t.roles[person.role] ?? person.role}</dd>
            <dt>${t.language}</dt><dd><${LanguageChoice} /></dd>
          </dl>
        </div>
      </section>
      ${person.has_password && html`<section class="card">
        <header><h2>${words.password}</h2></header>
        <div class="body stack">
          ${changed && html`<${Notice} tone="good" title=${words.changed} />`}
          <${Form} key=${Boolean(data?.tokens.length)} fields=${data?.tokens.length ? [...FIELDS, TOKENS_FIELD] : FIELDS}
            onSave=${change} submit=${words.change} />
        </div>
      </section>`}
      <${SharedDevice} />
      ${data && html`<${OwnIdentities} person=${person} items=${data.identities} onChange=${reload} />`}
      ${person.trainee && html`<${ConsentCard} trainee=${traineeId(person)} isOwn />
        <${BoxPin} trainee=${person.trainee} />
        <${RetentionCard} trainee=${traineeId(person)} />
        <${OwnData} trainee=${person.trainee} />`}
      <${ProblemNotice} problem=${problem} onRetry=${reload} />
      ${data && html`<${OwnSignIns} items=${data.signIns} onEnd=${id => api.own.endSignIn(id).then(reload, reload)} />
        <${OwnTokens} items=${data.tokens} onRemove=${id => api.own.removeToken(id).then(reload)} />`}
      ${person.trainee && html`<${AccessEntries} trainee=${traineeId(person)} isOwn />`}
    </div>`;
}
