// A person chooses a password before anything else: with a link from an administrator, or because another person or the
// program chose the one that they signed in with.
import { html, useEffect } from '../preact.js';
import { api } from '../api.js';
import { useData } from '../data.js';
import { CentreMark } from '../parts/page/centre_mark.js';
import { Form } from '../parts/forms/form.js';
import { LanguageChoice } from '../parts/page/language.js';
import { Loading, ProblemNotice } from '../parts/page/notice.js';
import { NEW_PASSWORD_FIELDS, newPassword } from '../parts/people/new_password.js';
import { t } from '../texts.js';
import { signIn } from './sign_in.js';

const words = t.choosePassword;
const GIVEN_FIELD = { name: 'old', label: words.given, type: 'password', required: true, autocomplete: 'current-password' };
/** Shows the sign-in name; a password manager stores the new password under it. */
const loginField = login => ({ name: 'login', label: t.signIn.login, value: login, required: true, readonly: true, autocomplete: 'username' });

/**
 * `secret`: the part of the link's address after `#`. `onDone(person)`: the password is set, and the person signed in if
 * the browser keeps the sign-in. `onDone()`: the link cannot be used.
 *
 * @param {Props} props
 */
export function PasswordByLink({ secret, onDone }) {
  const { data: account, problem, reload } = useData(signal => api.passwordLinks.open(secret, signal), [secret]);
  const send = async ({ login, ...values }) => {
    const fresh = newPassword(values);
    await api.passwordLinks.use(secret, fresh);
    onDone(await signIn(login, fresh).catch(() => undefined));
  };
  return html`
    <${GateCard}>
      ${!account && !problem && html`<${Loading} />`}
      <${ProblemNotice} problem=${problem} onRetry=${problem?.status === 410 ? undefined : reload} />
      ${problem?.status === 410 && html`<div class="actions"><button class="button main" type="button" onClick=${() => onDone()}>
        ${words.toSignIn}</button></div>`}
      ${account && html`<p>${words.byLink(account.name)}</p>
        <${Form} fields=${[loginField(account.login), ...NEW_PASSWORD_FIELDS]} onSave=${send} submit=${words.submit} busyWords=${words.busy} />`}
    <//>`;
}

/**
 * `typed`: the password that the person has just signed in with; empty after the page was loaded again.
 *
 * @param {Props} props
 */
export function FirstPassword({ person, typed, onDone, onSignOut }) {
  const send = async ({ old, ...values }) => {
    const fresh = newPassword(values);
    await api.changePassword(typed || old, fresh, false);
    onDone(await api.me().catch(() => null)); // without a cookie the person signs in
  };
  const fields = [loginField(person.login), ...(typed ? [] : [GIVEN_FIELD]), ...NEW_PASSWORD_FIELDS];
  return html`
    <${GateCard}>
      <p>${words.first}</p>
      <${Form} fields=${fields} onSave=${send} onCancel=${onSignOut} cancel=${t.account.signOut} submit=${words.submit} busyWords=${words.busy} />
    <//>`;
}

/** @param {Props} props */
function GateCard({ children }) {
  useEffect(() => {
    document.title = `${words.title} – ${t.product}`;
  }, []);
  return html`
    <main class="gate">
      <section class="card">
        <div class="body">
          <div class="brand"><${CentreMark} size=${36} /></div>
          <h1>${words.title}</h1>
          ${children}
          <${LanguageChoice} />
        </div>
      </section>
    </main>`;
}
