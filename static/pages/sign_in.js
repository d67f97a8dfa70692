// Sign in. The address stays, so that a deep link works across it.
import { html, useEffect } from '../preact.js';
import { api, Problem } from '../api.js';
import { CentreMark } from '../parts/page/centre_mark.js';
import { Form } from '../parts/forms/form.js';
import { LanguageChoice } from '../parts/page/language.js';
import { Notice } from '../parts/page/notice.js';
import { ProviderButton } from '../parts/people/provider_button.js';
import { t } from '../texts.js';

const words = t.signIn;
const FIELDS = [
  {
    name: 'login',
    label: words.login,
    required: true,
    autocomplete: 'username',
    autocapitalize: 'none',
    spellcheck: false,
    autofocus: true,
  },
  { name: 'password', label: words.password, type: 'password', required: true, autocomplete: 'current-password' },
];

/** Signs in, and returns the person. */
export async function signIn(login, password) {
  await api.signIn(login, password);
  return signedIn();
}

/** The person who has just signed in. */
export const signedIn = () =>
  api.me().catch(error => {
    if (error.status !== 401) throw error;
    throw new Problem({ title: words.noCookie, detail: isSecureContext ? words.noCookieBody : words.notSecureBody, status: 0 });
  });

/** `onSignedIn(person, password)` is called when a person has signed in. */
export function SignIn({ expired, onSignedIn }) {
  useEffect(() => {
    document.title = `${words.title} – ${t.product}`;
  }, []);
  const send = async ({ login, password }) => onSignedIn(await signIn(login, password), password);
  return html`
    <main class="gate">
      <section class="card">
        <div class="body">
          <h1 class="brand"><${CentreMark} size=${36} /></h1>
          <p>${words.lead}</p>
          ${!isSecureContext && html`<${Notice} tone="warn" title=${words.notSecure}>${words.notSecureBody}<//>`}
          ${expired && html`<${Notice} tone="warn" title=${words.again} />`}
          <${Form} fields=${FIELDS} onSave=${send} submit=${words.submit} busyWords=${words.busy} />
          <${ProviderButton} />
          <${LanguageChoice} />
        </div>
      </section>
    </main>`;
}
