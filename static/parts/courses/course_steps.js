// The steps of a course plan that is being edited: each has a task, a requirement and a due date. Buttons move them, so
// that the keyboard can, too.
import { html, useEffect, useRef, useState } from '../../preact.js';
import { api } from '../../api.js';
import { href } from '../../router.js';
import { t } from '../../texts.js';
import { focusSoon } from '../forms/focus.js';
import { Field } from '../forms/form.js';
import { icons } from '../page/icons.js';
import { Announce } from '../page/notice.js';

const words = t.courses;
const USUAL_SESSIONS = 3;
let lastKey = 0;

/**
 * A step as the form holds it: the typed values, and a key that stays when the step moves.
 *
 * @param {{ task?: { id: string }, sessions?: number | null, within_days?: number | null }} [step]
 */
export const newStep = ({ task, sessions = null, within_days: within = null } = {}) => ({
  key: (lastKey += 1),
  task: task?.id ?? '',
  way: sessions === null ? 'standard' : 'sessions',
  sessions: String(sessions ?? USUAL_SESSIONS),
  within: String(within ?? ''),
});

/** The step as the REST API takes it. */
export const stepRequest = ({ task, way, sessions, within }) => ({
  task, sessions: way === 'sessions' ? Number(sessions) : undefined, within_days: within === '' ? undefined : Number(within),
});

/** `onChange(change)` gets a function from the old steps to the new ones. @param {Props} props */
export function CourseSteps({ steps, tasks, onChange }) {
  const standards = useStandards(steps.map(step => step.task));
  const [announcement, setAnnouncement] = useState('');
  const set = (key, more) => onChange(all => all.map(step => (step.key === key ? { ...step, ...more } : step)));
  const move = (at, by) => {
    onChange(all => all.map((step, i) => (i === at ? all[at + by] : i === at + by ? all[at] : step)));
    setAnnouncement(words.moved(at + 1, at + by + 1));
    const isAtEnd = at + by === 0 || at + by === steps.length - 1; // There the button that was pressed is disabled.
    const [same, other] = by < 0 ? ['up', 'down'] : ['down', 'up'];
    focusSoon(buttonOf(steps[at], isAtEnd ? other : same));
  };
  const drop = at => {
    onChange(all => all.filter((_, i) => i !== at));
    setAnnouncement(words.dropped(at + 1));
    focusSoon(fieldsOf(steps[at + 1] ?? steps[at - 1]));
  };
  const add = () => {
    const step = newStep();
    onChange(all => [...all, step]);
    focusSoon(fieldsOf(step));
  };
  return html`
    <${Announce}>${announcement}<//>
    <ol class="plan stack">${steps.map((step, at) => html`<li key=${step.key}>
      <${Step} step=${step} number=${at + 1} count=${steps.length} tasks=${tasks} hasStandard=${standards[step.task]}
        onChange=${more => set(step.key, more)} onMove=${by => move(at, by)} onDrop=${() => drop(at)} /></li>`)}</ol>
    <div><button class="button" type="button" onClick=${add}><${icons.add} />${words.addStep}</button></div>`;
}

const fieldsOf = step => `course-step-${step?.key}`;
const buttonOf = (step, way) => `${fieldsOf(step)}-${way}`;

/** @param {Props} props */
function Step({ step, number, count, tasks, hasStandard, onChange, onMove, onDrop }) {
  const input = name => event => onChange({ [name]: event.target.value });
  const ways = Object.entries(words.ways).filter(([way]) => way !== 'standard' || hasStandard !== false);
  useEffect(() => void (hasStandard === false && step.way === 'standard' && onChange({ way: 'sessions' })), [hasStandard, step.way]);
  const button = (way, by, isEnd, label, short) => html`<button class="button" type="button" id=${buttonOf(step, way)} disabled=${isEnd}
    aria-label=${label(number)} onClick=${() => onMove(by)}>${short}</button>`;
  return html`
    <fieldset class="plain target stack tight" id=${fieldsOf(step)} tabindex="-1">
      <legend class="label">${words.step(number)}</legend>
      <div class="fields">
        <${Field} type="select" label=${words.task} required value=${step.task} onInput=${input('task')}
          options=${[['', t.target.choose], ...tasks.map(task => [task.id, task.name])]} />
        <${Field} type="select" label=${words.asks} value=${step.way} options=${ways} onInput=${input('way')} key=${ways.length} />
        ${step.way === 'sessions' && html`<${Field} type="number" label=${words.sessions} hint=${words.sessionsHint} required min="1" max="200"
          step="1" value=${step.sessions} onInput=${input('sessions')} />`}
        <${Field} type="number" label=${words.within} hint=${words.withinHint} min="0" max="3650" step="1" value=${step.within}
          onInput=${input('within')} />
      </div>
      ${hasStandard === false && html`<p class="small muted">${words.noStandard} <a href=${href(['tasks', step.task])}>${words.setStandard}</a></p>`}
      <div class="row">
        ${button('up', -1, number === 1, words.up, words.upShort)}
        ${button('down', 1, number === count, words.down, words.downShort)}
        ${count > 1 && html`<button class="button bare" type="button" aria-label=${words.drop(number)} onClick=${onDrop}>${words.dropShort}</button>`}
      </div>
    </fieldset>`;
}

/** Whether these tasks have a standard, once that is known; each task is requested once. */
function useStandards(tasks) {
  const [known, setKnown] = useState({});
  const requested = useRef(new Set(['']));
  useEffect(() => {
    for (const task of tasks.filter(one => !requested.current.has(one))) {
      requested.current.add(task);
      const store = all => setKnown(before => ({ ...before, [task]: all.length > 0 }));
      // Not critical: the service checks it on saving.
      api.tasks.standards(task).then(store, () => requested.current.delete(task));
    }
  }, [tasks.join()]);
  return known;
}
