// The button of the sign-in page that signs in with the provider of single sign-on, and why that did not work.
import { html, useEffect, useState } from '../../preact.js';
import { api } from '../../api.js';
import { basePath } from '../../base_path.js';
import { asProblem } from '../../data.js';
import { t } from '../../texts.js';
import { Notice, ProblemNotice } from '../page/notice.js';

const words = t.singleSignOn;
/** The service takes no longer address of a page to show afterwards. */
const MAX_NEXT = 1000;

/** Why signing in with the provider did not work: no fault of this page, unless it has no reason. @param {Props} props */
export function ProviderProblem({ problem }) {
  const [title, body] = words.reasons[problem?.reason] ?? [];
  return title ? html`<${Notice} tone="warn" title=${title}>${body}<//>` : html`<${ProblemNotice} problem=${problem} />`;
}

/** Whether single sign-on is set up; until the answer is there, and without one, it is not. */
export function useSetUp() {
  const [setUp, setSetUp] = useState(/** @type {Schemas['SingleSignOnResponse']} */ ({ is_set_up: false, name: null }));
  useEffect(() => void api.singleSignOn.describe().then(setSetUp, () => {}), []);
  return setUp;
}

/** Opens the provider's page. @param {Promise<{ address: string }>} begun */
export const openProvider = async begun => location.assign((await begun).address);

/** The button of the sign-in page: nothing if single sign-on is not set up. */
export function ProviderButton() {
  const { is_set_up: isSetUp, name } = useSetUp();
  const [problem, setProblem] = useState(null);
  if (!isSetUp) return null;
  const begin = () => {
    setProblem(null);
    const next = location.pathname.slice(basePath.length) + location.search;
    openProvider(api.singleSignOn.start(next.length > MAX_NEXT ? '/' : next)).catch(error => setProblem(asProblem(error)));
  };
  return html`
    <div class="stack">
      <${ProviderProblem} problem=${problem} />
      <button class="button" type="button" onClick=${begin}>${words.signIn(name)}</button>
    </div>`;
}
