// Sign in. The address stays, so that a deep link works across it.
import { html, useEffect } from '../preact.js';
import { api } from '../api.js';
import { Brand } from '../parts/page/icons.js';
import { Form } from '../parts/forms/form.js';
import { LanguageChoice } from '../parts/page/language.js';
import { Notice } from '../parts/page/notice.js';
import { t } from '../texts.js';

const FIELDS = [
  {
    name: 'login',
    label: t.signIn.login,
    required: true,
    autocomplete: 'username',
    autocapitalize: 'none',
    spellcheck: false,
    autofocus: true,
  },
  { name: 'password', label: t.signIn.password, type: 'password', required: true, autocomplete: 'current-password' },
];

export function SignIn({ expired, onSignedIn }) {
  useEffect(() => {
    document.title = `${t.signIn.title} – ${t.product}`;
  }, []);
  const send = async ({ login, password }) => {
    const answer = await api.signIn(login, password);
    onSignedIn(await api.me().catch(() => answer.person));
  };
  return html`
    <main class="gate">
      <section class="card">
        <div class="body">
          <h1 class="brand"><${Brand} size=${36} />${t.product}</h1>
          <p>${t.signIn.lead}</p>
          ${expired && html`<${Notice} tone="warn" title=${t.signIn.again} />`}
          <${Form} fields=${FIELDS} onSave=${send} submit=${t.signIn.submit} busyWords=${t.signIn.busy} />
          <${LanguageChoice} />
        </div>
      </section>
    </main>`;
}
