// The app: who is signed in, which page the address names, and the shell around every page.
import { html, render, useEffect, useErrorBoundary, useRef, useState } from './parts/preact.js';
import { api, onSignedOut } from './api.js';
import { asProblem } from './data.js';
import { startLive, stopLive } from './live.js';
import { currentRoute, go, href, useRoute } from './router.js';
import { may } from './roles.js';
import { t } from './texts.js';
import { Empty, Loading, ProblemNotice } from './parts/notice.js';
import { Brand } from './parts/icons.js';
import { currentRecording } from './record/current_recording.js';
import { Shell } from './parts/shell.js';
import { SignIn } from './pages/sign_in.js';

/**
 * Every page: its entry in the navigation, its address, its module (loaded on first use) and the permission it needs.
 */
const PAGES = [
  { name: 'today', at: path => path.length === 0, load: () => import('./pages/today.js') },
  {
    name: 'sessions',
    at: path => path[0] === 'sessions' && path.length === 1,
    load: () => import('./pages/sessions.js'),
  },
  {
    name: 'sessions',
    at: path => path[0] === 'sessions' && path.length === 2,
    load: () => import('./pages/session.js'),
  },
  {
    name: 'sessions',
    at: path => path[0] === 'sessions' && path.length === 3 && path[2] === 'report',
    load: () => import('./pages/session_report.js'),
  },
  { name: 'wall', at: path => path[0] === 'live', load: () => import('./pages/live_overview.js'), needs: 'watch' },
  { name: 'upload', at: path => path[0] === 'upload', load: () => import('./pages/upload.js') },
  { name: 'record', at: path => path[0] === 'record', load: () => import('./pages/record.js') },
  {
    name: 'trainees',
    at: path => path[0] === 'trainees' && path.length === 1,
    load: () => import('./pages/trainees.js'),
    needs: 'see_trainees',
  },
  {
    name: 'trainees',
    at: path => path[0] === 'trainees' && path.length === 2,
    load: () => import('./pages/trainee.js'),
  },
  {
    name: 'trainees',
    at: path => path[0] === 'trainees' && path.length === 3 && path[2] === 'report',
    load: () => import('./pages/trainee_report.js'),
  },
  {
    name: 'trainees',
    at: path => path[0] === 'trainees' && path.length === 3 && path[2] === 'certificate',
    load: () => import('./pages/certificate.js'),
  },
  {
    name: 'tasks',
    at: path => path[0] === 'tasks' && path.length === 1,
    load: () => import('./pages/tasks.js'),
    needs: 'edit_tasks',
  },
  {
    name: 'tasks',
    at: path => path[0] === 'tasks' && path.length === 2,
    load: () => import('./pages/task.js'),
    needs: 'edit_tasks',
  },
  {
    name: 'groups',
    at: path => path[0] === 'groups' && path.length === 1,
    load: () => import('./pages/groups.js'),
    needs: 'see_trainees',
  },
  {
    name: 'groups',
    at: path => path[0] === 'groups' && path.length === 2,
    load: () => import('./pages/group.js'),
    needs: 'see_trainees',
  },
  {
    name: 'groups',
    at: path => path[0] === 'enrol' && path.length === 1,
    load: () => import('./pages/enrol.js'),
    needs: 'edit_trainees',
  },
  {
    name: 'groups',
    at: path => path[0] === 'courses' && path.length === 1,
    load: () => import('./pages/courses.js'),
    needs: 'edit_courses',
  },
  {
    name: 'groups',
    at: path => path[0] === 'courses' && path.length === 2,
    load: () => import('./pages/course.js'),
    needs: 'edit_courses',
  },
  { name: 'people', at: path => path[0] === 'service', load: () => import('./pages/service.js'), needs: 'people' },
  {
    name: 'boxes',
    at: path => path[0] === 'boxes' && path.length === 1,
    load: () => import('./pages/boxes.js'),
    needs: 'see_boxes',
  },
  {
    name: 'boxes',
    at: path => path[0] === 'boxes' && path.length === 2,
    load: () => import('./pages/box.js'),
    needs: 'see_boxes',
  },
  {
    name: 'boxes',
    at: path => path[0] === 'boxes' && path.length === 3 && path[2] === 'setup',
    load: () => import('./pages/setup.js'),
    needs: 'edit_boxes',
  },
  { name: 'people', at: path => path[0] === 'people', load: () => import('./pages/people.js'), needs: 'people' },
  { name: 'account', at: path => path[0] === 'account', load: () => import('./pages/account.js') },
];

/** How long style sheets may delay a page, ms: one that failed before this module ran fires no further event. */
const MAX_STYLE_WAIT_MS = 5_000;

/**
 * The style sheets that the first paint must not wait for. They are enabled before a page that may need them is shown.
 */
const stylesReady = Promise.all([...document.querySelectorAll('link[media="not all"]')].map(async link => {
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

/** The page that belongs to an address. */
const pageAt = path => PAGES.find(page => page.at(path));

function App() {
  const [person, setPerson] = useState(undefined); // undefined: not known yet; null: not signed in
  const [problem, setProblem] = useState(null);
  const [expired, setExpired] = useState(false);

  const loadPerson = () =>
    api.me().then(setPerson, error => (error.status === 401 ? setPerson(null) : setProblem(asProblem(error))));
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
  useEffect(() => {
    if (!person) return undefined;
    startLive();
    return stopLive;
  }, [person?.id]);

  if (problem) {
    const retry = () => (setProblem(null), loadPerson());
    return html`<main class="gate"><${ProblemNotice} problem=${problem} onRetry=${retry} /></main>`;
  }
  if (person === undefined) return html`<header class="top"><a class="brand" href=${href([])}><${Brand} />${t.product}</a></header>`;
  if (!person) return html`<${SignIn} expired=${expired} onSignedIn=${setPerson} />`;
  const signOut = async () => {
    if (currentRecording) (await import('./record/recorder.js')).discardRecording();
    await api.signOut().catch(() => {}); // Signed out on this page in any case; the cookie expires by itself.
    setExpired(false);
    setPerson(null);
    go([]);
  };
  return html`<${Page} person=${person} onSignOut=${signOut} />`;
}

function Page({ person, onSignOut }) {
  const route = useRoute();
  const address = route.path.join('/');
  const matched = pageAt(route.path);
  const entry = !matched?.needs || may(person, matched.needs) ? matched : undefined;
  const [loaded, setLoaded] = useState({});
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
    const heading = document.querySelector('main h1');
    (heading ?? document.querySelector('main'))?.focus({ preventScroll: true });
  }, [address, loaded.Show]);

  const body = () => {
    if (fault) return html`<${ProblemNotice} problem=${asProblem(fault)} onRetry=${() => location.reload()} />`;
    if (!entry) return html`<${NotFound} />`;
    if (loaded.problem && loaded.entry === entry) return html`<${ProblemNotice} problem=${loaded.problem} />`;
    if (loaded.entry !== entry) return html`<${Loading} />`;
    return html`<${loaded.Show} key=${address} person=${person} route=${route} onSignOut=${onSignOut} />`;
  };
  return html`<${Shell} person=${person} current=${entry?.name}>${body()}<//>`;
}

const NotFound = () => html`
  <h1 tabindex="-1" class="unseen">${t.notFound.title}</h1>
  <${Empty} title=${t.notFound.title} body=${t.notFound.body}>
    <a class="button main" href=${href([])}>${t.notFound.action}</a>
  <//>`;

// Loads the page's module while the user is being looked up; the page itself reports a failure.
pageAt(currentRoute().path)?.load().catch(() => {});
render(html`<${App} />`, document.getElementById('app'));
