// The page that the provider of single sign-on sends the browser back to. It passes the provider's answer on, and shows
// the page where the person was, or why signing in did not work.
import { html, useEffect, useState } from '../preact.js';
import { api } from '../api.js';
import { asProblem } from '../data.js';
import { Brand } from '../parts/page/icons.js';
import { LanguageChoice } from '../parts/page/language.js';
import { Loading } from '../parts/page/notice.js';
import { ProviderProblem } from '../parts/people/provider_button.js';
import { t } from '../texts.js';
import { signedIn } from './sign_in.js';

const words = t.singleSignOn;

/**
 * `answer`: the query of the page's address. `onDone(person, address)`: the person is signed in; `address` is the page to
 * show. `onDone(null)`: back to where the person was.
 *
 * @param {Props} props
 */
export function ProviderAnswer({ answer, onDone }) {
  const [problem, setProblem] = useState(null);
  useEffect(() => {
    document.title = `${words.title} – ${t.product}`;
    finish(answer).then(({ next }) => signedIn().then(person => onDone(person, next))).catch(error => setProblem(asProblem(error)));
  }, []);
  return html`
    <main class="gate">
      <section class="card">
        <div class="body stack">
          <h1 class="brand"><${Brand} size=${36} />${t.product}</h1>
          ${!problem && html`<p>${words.busy}</p><${Loading} />`}
          <${ProviderProblem} problem=${problem} />
          ${problem && html`<div class="actions"><button class="button main" type="button" onClick=${() => onDone(null)}>${words.back}</button></div>`}
          <${LanguageChoice} />
        </div>
      </section>
    </main>`;
}

/** Passes the members of the answer on that the service knows; a provider may add others. */
const finish = answer =>
  api.singleSignOn.finish({
    state: answer.get('state') ?? '',
    ...Object.fromEntries(['code', 'error', 'iss'].filter(name => answer.has(name)).map(name => [name, answer.get(name)])),
  });
