// The app: who is signed in, which page the address names, and the shell around every page.
import { html, render, useEffect, useErrorBoundary, useRef, useState } from './preact.js';
import { api, onSignedOut } from './api.js';
import { basePath } from './base_path.js';
/** @import { Problem } from './api.js' */
import { loadCentre } from './centre.js';
import { asProblem } from './data.js';
import { startLive, stopLive } from './live.js';
import { may } from './roles.js';
import { currentRoute, go, href, replace, useRoute } from './router.js';
import { matchPage } from './routes.js';
import { t } from './texts.js';
import { Empty, Loading, ProblemNotice } from './parts/page/notice.js';
import { Brand } from './parts/page/icons.js';
import { currentRecording, isRecording } from './record/current_recording.js';
import { isSending, nextPersonAddress, watchIdle } from './shared_device.js';
import { Shell } from './parts/page/shell.js';
import { SignIn } from './pages/sign_in.js';

/** How long style sheets may delay a page, ms: one that failed before this module ran fires no further event. */
const MAX_STYLE_WAIT_MS = 5_000;

/**
 * The style sheets that the first paint must not wait for. They are enabled before a page that may need them is shown.
 */
const stylesReady = Promise.all([.../** @type {NodeListOf<HTMLLinkElement>} */ (document.querySelectorAll('link[media="not all"]'))].map(async link => {
  if (!link.sheet) await waitUntilSettled(link);
  // Requests it again; nothing waits for that.
  if (!isLoaded(link)) link.after(Object.assign(link.cloneNode(), { media: 'all' }));
  link.media = 'all';
}));

function waitUntilSettled(link) {
  return new Promise(done => {
    Object.assign(link, { onload: done, onerror: done });
    setTimeout(done, MAX_STYLE_WAIT_MS);
  });
}

/** Whether a style sheet has loaded. After a failure, browsers keep none, an empty one, or one that cannot be read. */
function isLoaded(link) {
  try {
    return link.sheet?.cssRules.length > 0;
  } catch {
    return false;
  }
}

/** The address of a link for a password; the secret follows after `#`, which browsers do not send. */
const PASSWORD_LINK = 'choose-password';

/** The secret in the address of a link for a password, empty if it is missing there; null at other addresses. */
const secretInAddress = () => (currentRoute().path.join('/') === PASSWORD_LINK ? location.hash.slice(1) : null);

/** The address that the provider of single sign-on sends the browser back to. */
const PROVIDER_ANSWER = 'single-sign-on';

/** The provider's answer in the address; null at other addresses. */
const answerInAddress = () => (currentRoute().path.join('/') === PROVIDER_ANSWER ? currentRoute().query : null);

/** The public page of a certificate, which needs no sign-in. */
const VERIFY = 'verify';
const loadPublicCertificate = () => import('./pages/verify.js').then(module => module.PublicCertificate);

const loadProviderAnswer = () => import('./pages/single_sign_on.js').then(module => module.ProviderAnswer);
const loadPasswordByLink = () => import('./pages/choose_password.js').then(module => module.PasswordByLink);
const loadFirstPassword = () => import('./pages/choose_password.js').then(module => module.FirstPassword);

function App() {
  const [person, setPerson] = useState(undefined); // undefined: not known yet; null: not signed in
  const [problem, setProblem] = useState(null);
  const [expired, setExpired] = useState(false);
  const [linkSecret, setLinkSecret] = useState(secretInAddress);
  const [providerAnswer, setProviderAnswer] = useState(answerInAddress);
  const [typedPassword, setTypedPassword] = useState(''); // only until it is changed

  const loadPerson = async () => {
    const centre = loadCentre(); // Beside the person: the first page then shows the centre's name from the start.
    const show = await api.me().then(me => () => setPerson(me),
      error => () => (error.status === 401 ? setPerson(null) : setProblem(asProblem(error))));
    await centre;
    show();
  };
  useEffect(() => void loadPerson(), []);
  useEffect(
    () =>
      onSignedOut(() =>
        setPerson(before => {
          if (before) setExpired(true);
          return null;
        }),
      ),
    [],
  );
  const isAdmitted = Boolean(person && !person.must_change_password);
  useEffect(() => {
    if (!isAdmitted) return undefined;
    startLive(person.id);
    return stopLive;
  }, [person?.id, isAdmitted]);
  useEffect(() => {
    const change = () => setLinkSecret(secretInAddress());
    addEventListener('hashchange', change);
    return () => removeEventListener('hashchange', change);
  }, []);

  const enter = signedIn => {
    setTypedPassword('');
    setPerson(signedIn);
  };
  // The same as index.html has: Preact keeps what the first result does not replace.
  if (person === undefined && !problem) return html`<header class="top"><a class="brand" href=${href([])}><${Brand} />${t.product}</a></header>`;
  const [first, code] = currentRoute().path;
  if (first === VERIFY) return html`<${Gate} load=${loadPublicCertificate} code=${code} />`;
  if (linkSecret !== null) {
    const leave = signedIn => {
      replace([]);
      setLinkSecret(null);
      if (signedIn) enter(signedIn);
    };
    return html`<${Gate} key=${linkSecret} load=${loadPasswordByLink} secret=${linkSecret} onDone=${leave} />`;
  }
  if (providerAnswer) {
    const leave = (signedIn, next) => {
      history.replaceState(null, '', next ? `${basePath}${next}` : href(person ? ['account'] : []));
      setProviderAnswer(null);
      if (signedIn) enter(signedIn);
    };
    return html`<${Gate} load=${loadProviderAnswer} answer=${providerAnswer} onDone=${leave} />`;
  }
  if (problem) {
    const retry = () => (setProblem(null), loadPerson());
    return html`<main class="gate"><${ProblemNotice} problem=${problem} onRetry=${retry} /></main>`;
  }
  const welcome = (signedIn, password) => {
    if (signedIn.must_change_password) setTypedPassword(password);
    setPerson(signedIn);
  };
  if (!person) return html`<${SignIn} expired=${expired} onSignedIn=${welcome} />`;
  const signOut = async (path = [], query = {}) => {
    if (currentRecording) (await import('./record/recorder.js')).discardRecording();
    await import('./parts/recording/uploads.js').then(({ forgetUploads }) => forgetUploads(person.id), () => {});
    // Signed out on this page in any case; the cookie expires by itself.
    const ended = await (person.by_single_sign_on ? api.singleSignOn.signOut() : api.signOut()).catch(() => null);
    if (ended?.address) return void location.assign(ended.address); // The provider's sign-in ends, too.
    setExpired(false);
    enter(null);
    go(path, query);
  };
  if (!isAdmitted)
    return html`<${Gate} load=${loadFirstPassword} person=${person} typed=${typedPassword} onDone=${enter} onSignOut=${() => signOut()} />`;
  return html`<${Page} person=${person} onSignOut=${() => signOut()} onNextPerson=${signOutForNext(signOut)} />`;
}

/** Signs out, and leaves the address of the next person's recording: same page, box and task. */
const signOutForNext = signOut => () => {
  const { path, query } = nextPersonAddress(currentRoute());
  return signOut(path, query);
};

/** A page outside the shell. `load` returns its component; the other properties are the page's. @param {Props} props */
function Gate({ load, ...props }) {
  const [{ Show, problem }, setLoaded] = useState(/** @type {{ problem?: Problem, Show?: any }} */ ({}));
  useEffect(() => void load().then(component => setLoaded({ Show: component }), error => setLoaded({ problem: asProblem(error) })), []);
  if (Show) return html`<${Show} ...${props} />`;
  return html`<main class="gate"><${ProblemNotice} problem=${problem} onRetry=${() => location.reload()} /></main>`;
}

/** @param {Props} props */
function Page({ person, onSignOut, onNextPerson }) {
  const route = useRoute();
  const leave = useRef(onNextPerson);
  leave.current = onNextPerson;
  useEffect(() => watchIdle(() => leave.current(), () => isRecording() || isSending()), []);
  const address = route.path.join('/');
  const { page, params } = matchPage(route.path) ?? {};
  const entry = !page?.needs || may(person, page.needs) ? page : undefined;
  const [loaded, setLoaded] = useState(/** @type {{ entry?: object, problem?: Problem, Show?: any }} */ ({}));
  const [fault, clearFault] = useErrorBoundary(error => console.error(error));
  const first = useRef(true);

  useEffect(() => {
    clearFault();
    let stale = false;
    const fail = error => !stale && setLoaded({ entry, problem: asProblem(error) });
    if (entry) Promise.all([entry.load(), stylesReady]).then(([module]) => !stale && setLoaded({ entry, Show: module.default }), fail);
    return () => (stale = true);
  }, [entry]);

  // A screen reader announces the new page's title; a keyboard user starts at the top of the page.
  useEffect(() => {
    if (first.current) return void (first.current = false);
    scrollTo(0, 0);
    /** @type {HTMLElement | null} */
    const heading = document.querySelector('main h1') ?? document.querySelector('main');
    heading?.focus({ preventScroll: true });
  }, [address, loaded.Show]);

  const body = () => {
    if (fault) return html`<${ProblemNotice} problem=${asProblem(fault)} onRetry=${() => location.reload()} />`;
    if (!entry) return html`<${NotFound} />`;
    if (loaded.problem && loaded.entry === entry) return html`<${ProblemNotice} problem=${loaded.problem} />`;
    if (loaded.entry !== entry) return html`<${Loading} />`;
    return html`<${loaded.Show} key=${address} person=${person} route=${{ ...route, params }} onSignOut=${onSignOut} />`;
  };
  return html`<${Shell} person=${person} current=${entry?.nav} onNextPerson=${onNextPerson}>${body()}<//>`;
}

const NotFound = () => html`
  <h1 tabindex="-1" class="unseen">${t.notFound.title}</h1>
  <${Empty} title=${t.notFound.title} body=${t.notFound.body}>
    <a class="button main" href=${href([])}>${t.notFound.action}</a>
  <//>`;

// Loads the page's module while the user is being looked up; the page itself reports a failure.
matchPage(currentRoute().path)?.page.load().catch(() => {});
render(html`<${App} />`, /** @type {HTMLElement} */ (document.getElementById('app')));
