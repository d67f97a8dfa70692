// The frame of every page: skip link, product, navigation, language, theme, account.
import { html, useEffect, useState } from '../../preact.js';
import { href, useRoute } from '../../router.js';
import { may } from '../../roles.js';
import { chooseTheme, onThemeChange, themeChoice } from '../../theme.js';
import { t } from '../../texts.js';
import { isRecording, onRecording } from '../../record/current_recording.js';
import { isSending, onSharedChange, sharedIdleMinutes } from '../../shared_device.js';
import { useFollowed } from '../guide/followed.js';
import { FeedbackMark } from '../people/new_feedback.js';
import { useWaitingCount, WaitingMark } from '../waiting/waiting_count.js';
import { CentreMark } from './centre_mark.js';
import { icons } from './icons.js';
import { LanguageMenu } from './language.js';

const NEXT_THEME = { system: 'light', light: 'dark', dark: 'system' };
const THEME_ICON = { system: icons.system, light: icons.sun, dark: icons.moon };

/** @returns {[name: string, path: string[], needs?: string[]][]} */
function navEntries(person) {
  /** @type {[name: string, path: string[], needs?: string[]][]} */
  const all = [
    ['today', []],
    ['wall', ['live'], ['watch']],
    ['sessions', ['sessions']],
    ['record', ['record'], ['upload', 'upload_own']],
    ['upload', ['upload'], ['upload', 'upload_own']],
    ['waiting', ['waiting'], ['see_trainees']],
    ['trainees', ['trainees'], ['see_trainees']],
    ['groups', ['groups'], ['see_trainees']],
    ['tasks', ['tasks'], ['edit_tasks']],
    ['boxes', ['boxes'], ['see_boxes']],
    ['people', ['people'], ['people']],
  ];
  /** @type {[string, string[]][]} */
  const own = person.trainee ? [['own', ['trainees', traineeId(person)]]] : [];
  return [...all.filter(([, , needs]) => !needs || needs.some(action => may(person, action))), ...own];
}

/** `me` gives the trainee as an id or as an object, depending on the route that answered. */
export const traineeId = person => person.trainee?.id ?? person.trainee ?? null;

/** @param {Props} props */
export function Shell({ person, current, children, onNextPerson }) {
  const waiting = useWaitingCount(person);
  // Most of the time nothing waits, and the navigation of staff is long.
  const isShown = entry => entry[0] !== 'waiting' || waiting > 0 || current === 'waiting';
  return html`
    <a class="button skip" href="#main">${t.skip}</a>
    <header class="top">
      <a class="brand" href=${href([])}><${CentreMark} /></a>
      <nav aria-label=${t.nav.label}>
        <ul>
          ${navEntries(person).filter(isShown).map(([name, path]) => html`
              <li key=${name}><a href=${href(path)} aria-current=${isCurrent(name, current, person) ? 'page'
                : undefined}>${t.nav[name]}${name === 'record' && html`<${RecordingMark} />`}${
                name === 'today' && html`<${FeedbackMark} person=${person} />`}${
                name === 'waiting' && waiting > 0 && html`<${WaitingMark} count=${waiting} />`}</a></li>`)}
        </ul>
      </nav>
      <div class="account">
        <${LanguageMenu} />
        <${ThemeSwitch} />
        <${NextPerson} onNext=${onNextPerson} />
        <a class="who" href=${href(['account'])} aria-current=${current === 'account' ? 'page' : undefined}>
          ${person.name}<small>${t.roles[person.role] ?? person.role}</small>
        </a>
      </div>
    </header>
    <${Guide} person=${person} />
    <main id="main" tabindex="-1">${children}</main>`;
}

/** The pages that show the whole guide. */
const GUIDE_PAGES = ['', 'first-steps'];

/** The way through the first steps, for staff who follow the guide; its module is loaded then. */
function Guide({ person }) {
  const address = useRoute().path.join('/');
  const [state, setState] = useState(/** @type {{ Bar?: any }} */ ({}));
  const isFollowed = useFollowed();
  const isShown = isFollowed && may(person, 'see_trainees') && !GUIDE_PAGES.includes(address);
  useEffect(() => {
    if (isShown && !state.Bar) import('../guide/guide_bar.js').then(module => setState({ Bar: module.default }), () => {});
  }, [isShown]);
  return isShown && state.Bar && html`<${state.Bar} address=${address} />`;
}

/** On a device that several people use. A recording or upload comes to its end first. @param {Props} props */
function NextPerson({ onNext }) {
  const read = () => ({ isShared: sharedIdleMinutes() > 0, isBusy: isRecording() || isSending() });
  const [{ isShared, isBusy }, setState] = useState(read);
  useEffect(() => onSharedChange(() => setState(read())), []);
  useEffect(() => onRecording(() => setState(read())), []);
  return isShared && html`<button class="button" type="button" disabled=${isBusy} title=${isBusy ? t.shared.busy : undefined}
    onClick=${onNext}>${t.shared.next}</button>`;
}

/** Shows on every page that a recording is running. */
function RecordingMark() {
  const [isRunning, setRunning] = useState(isRecording);
  useEffect(() => onRecording(() => setRunning(isRecording())), []);
  return isRunning && html`<span class="runs"><span class="unseen">${t.record.runs}</span></span>`;
}

/** A trainee's own page lies under `trainees`, which a trainee's navigation calls "My progress". */
const isCurrent = (name, current, person) =>
  name === current || (name === 'own' && current === 'trainees' && person.role === 'trainee');

function ThemeSwitch() {
  const [choice, setChoice] = useState(themeChoice);
  useEffect(() => onThemeChange(() => setChoice(themeChoice())), []);
  const next = NEXT_THEME[choice];
  const label = t.theme.label(t.theme[next]);
  return html`
    <button class="button bare" type="button" aria-label=${label} title=${label} onClick=${() => chooseTheme(next)}>
      <${THEME_ICON[choice]} />
    </button>`;
}
